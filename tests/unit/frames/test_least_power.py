"""Levels of least power against answers in closed form."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from gi_core.frames.held_light import CERTAIN, Requirements, least_power

BOTH = np.ones(2, bool)


def requirements(linear, offset, target, asked, noise=None, squares=None) -> Requirements:
    linear = np.asarray(linear, float)
    none = np.zeros_like(linear)
    noise, squares = (none if a is None else np.asarray(a, float) for a in (noise, squares))
    return Requirements(linear, np.asarray(offset, float), noise, squares, np.asarray(target), np.asarray(asked, float))


def at_least(linear, lux, **more) -> Requirements:
    """Return requirements of `lux` (m,) at points of light `linear` (m, G), each a target of its own."""
    m, G = np.shape(linear)
    asked = np.hstack([np.zeros((m, G)), np.reshape(lux, (m, 1))])
    return requirements(linear, -np.asarray(lux, float), np.arange(m), asked, **more)


def test_two_lamps_meet_two_points():
    """300 a + 100 b = 200 and 100 a + 200 b = 150: a = b = 1/2, and both duals are 0.1 W per lx."""
    found = least_power(at_least([[300, 100], [100, 200]], [200, 150]), np.array([40.0, 30.0]), BOTH, 2)
    np.testing.assert_allclose(found.factors, (0.5, 0.5), atol=1e-9)
    assert found.power == pytest.approx(35) and not found.missing.any()
    np.testing.assert_allclose(found.prices, (0.2, 0.15), atol=1e-9)  # 1 % of 200 and of 150 lx


def test_the_lamp_of_most_light_per_watt_comes_first():
    """One point: 10 and 5 lx per W. The first alone gives 300 of 400 lx, and the other the rest."""
    found = least_power(at_least([[300, 200]], [400]), np.array([30.0, 40.0]), BOTH, 1)
    np.testing.assert_allclose(found.factors, (1.0, 0.5), atol=1e-9)
    assert found.prices[0] == pytest.approx(0.01 * 400 / 5)


def test_a_fixed_lamp_counts_and_costs_nothing():
    found = least_power(at_least([[300, 200]], [400]), np.array([30.0, 40.0]), np.array([True, False]), 1)
    np.testing.assert_allclose(found.factors, (200 / 300, 1.0), atol=1e-9)
    assert found.power == pytest.approx(20)


def test_noise_raises_levels_by_its_standard_errors():
    """One lamp: (a - 2.05 s) c = t. Two equal lamps at equal levels: their noise adds in squares."""
    found = least_power(at_least([[500]], [300], noise=[[20]]), np.ones(1), BOTH[:1], 1)
    assert found.factors[0] == pytest.approx(300 / (500 - CERTAIN * 20), rel=1e-3)
    two = at_least([[500, 500]], [600], noise=[[20, 20]])
    found = least_power(two, np.ones(2), BOTH, 1)
    assert found.power == pytest.approx(600 / (500 - CERTAIN * 20 / math.sqrt(2)), rel=1e-3)


def test_glare_is_a_cone():
    """4 c^2 <= 2 c + 1 lets a lamp shine at 0.809 at most: more cannot be asked for."""
    most = (2 + math.sqrt(4 + 16)) / 8  # of c
    for asked, meets in ((most - 1e-3, True), (most + 1e-3, False)):
        both = requirements([[1.0], [2.0]], [-asked, 1.0], [0, 1], [[0, asked], [0, 1]], squares=[[0], [4]])
        assert least_power(both, np.ones(1), BOTH[:1], 2).missing.any() != meets


def test_what_is_missing_is_said():
    """Both lamps on give 400 of 500 lx: a fifth is missing, and prices have no meaning."""
    found = least_power(at_least([[300, 100]], [500]), np.array([40.0, 30.0]), BOTH, 1)
    np.testing.assert_allclose(found.factors, 1.0)
    assert found.missing[0] == pytest.approx(0.2) and np.isnan(found.prices).all()


def test_nothing_to_hold_switches_all_off():
    found = least_power(at_least(np.zeros((0, 2)), np.zeros(0)), np.ones(2), BOTH, 0)
    assert found.power == 0 and not found.factors.any()


def test_random_programmes_equal_those_of_scipy():
    rng = np.random.default_rng(3)
    feasible = 0
    for _ in range(30):
        A, watts = rng.gamma(0.7, 60, (60, 12)), rng.uniform(20, 60, 12)
        lux = np.full(60, 0.5 * A.sum(axis=1).min())
        of = least_power(at_least(A, lux), watts, np.ones(12, bool), 60)
        best = linprog(watts, A_ub=-A, b_ub=-lux, bounds=[(0, 1)] * 12)
        feasible += best.status == 0
        assert of.power == pytest.approx(best.fun) and not of.missing.any()
        np.testing.assert_allclose(of.prices, 0.01 * lux * -best.ineqlin.marginals, atol=1e-6 * best.fun)
    assert feasible == 30

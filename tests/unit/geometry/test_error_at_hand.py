"""Noise and bias without the limit at hand, on numbers known beforehand and on a room; the error of each receiver."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gi_core.geometry.error import error_parts
from gi_core.geometry.error_at_hand import (
    bias_left,
    noise_from_prefix,
    prefix_to_compare,
    round_scale,
    signed_error,
    some_receivers,
)
from gi_core.solver import Solver
from tests.support import viewer_support as support


def grey(values):
    return np.repeat(np.asarray(values, float)[:, None], 3, axis=1)


@pytest.mark.parametrize("prefix", [1000, 5000, 7500])
def test_noise_from_a_prefix_is_that_of_independent_photons(prefix):
    """10,000 photons that each bring 1 +- 20: the mean is off by 0.2 sqrt(2 / pi), whichever prefix it is told from."""
    rng = np.random.default_rng(3)
    first = 1 + 20 * rng.normal(size=20_000) / math.sqrt(prefix)
    rest = 1 + 20 * rng.normal(size=20_000) / math.sqrt(10_000 - prefix)
    both = (prefix * first + (10_000 - prefix) * rest) / 10_000
    w = np.ones(20_000)
    told = noise_from_prefix(grey(both), grey(first), 10_000, prefix, w)
    assert told == pytest.approx(0.2 * math.sqrt(2 / math.pi), rel=0.03)


def test_noise_needs_a_prefix():
    for prefix in (0, 10, 11):
        with pytest.raises(ValueError, match="prefix must be in 1 .. 9"):
            noise_from_prefix(grey([1]), grey([1]), 10, prefix, np.ones(1))
    assert prefix_to_compare(()) is None and prefix_to_compare((4096,)) is None
    assert prefix_to_compare((4096, 8192, 16384, 20_000)) == 8192
    assert prefix_to_compare((4096, 8192, 16384)) == 8192


def test_noise_and_bias_told_from_a_picture_are_those_measured_against_its_limit():
    """A room at 16,384 photons: the limit is taken from 32 times as many of another seed, the truth is made biased."""
    E, fewer, limit = [], [], []
    few = Solver(support.room(), photons=16_384, radius=0.06, seed=1)
    few.solve()
    E = few.irradiance
    few.configure(prefix_only=True)
    prefix = prefix_to_compare(few.prefixes)
    few.move_all({}, prefix)
    fewer = few.irradiance
    many = Solver(support.room(), photons=524_288, radius=0.06, seed=2)
    many.solve()
    limit, w = many.irradiance, many.receivers.areas
    bump = 1 + 0.3 * np.sin(40 * many.receivers.positions.sum(axis=1))[:, None]
    parts = error_parts(E, limit, limit * bump, w)
    noise = noise_from_prefix(E, fewer, 16_384, prefix, w)
    assert parts.noise.l1 <= 1.05 * noise <= 1.6 * parts.noise.l1, "rather more than less"
    assert bias_left(parts.total.l1, parts.noise.l1) == pytest.approx(parts.bias.l1, rel=0.1)


def test_a_bias_is_never_less_than_nothing():
    assert bias_left(0.05, 0.03) == pytest.approx(0.04)
    assert bias_left(0.05, 0.04, 0.04) == 0
    assert math.isnan(bias_left(0.05, float("nan")))


def test_signed_error_by_hand():
    """T = 1, 1, 0, 2 of mean 1: too bright by half, too dark by half, off by 0.01 of 0.02 in the dark, right."""
    E, T = grey([1.5, 0.5, 0.01, 2]), grey([1, 1, 0, 2])
    assert signed_error(E, T, np.ones(4)) == pytest.approx([0.5, -0.5, 0.5, 0])
    T[1] = np.nan
    assert np.isnan(signed_error(E, T, np.ones(4))).tolist() == [False, True, False, False]
    assert (signed_error(E, 0 * grey([1, 1, 1, 1]), np.ones(4)) == 0).all()


def test_a_scale_is_a_round_number_that_holds_what_it_should():
    w = np.ones(100)
    assert round_scale(np.linspace(0, 0.4, 100), w) == pytest.approx(0.5)
    assert round_scale(np.linspace(-0.19, 0.19, 100), w) == pytest.approx(0.2)
    assert round_scale(np.full(100, 0.1), w) == pytest.approx(0.1)
    assert round_scale(np.r_[np.full(97, 0.01), 9, 9, 9], w) == pytest.approx(0.01), "a few spots do not count"
    assert round_scale(np.r_[np.full(97, 0.01), 9, 9, 9], np.r_[np.ones(97), 50, 50, 50]) == pytest.approx(10)
    assert round_scale(np.full(100, np.nan), w) == round_scale(np.zeros(100), w) == 1


def test_some_receivers_have_an_area():
    w = np.r_[np.zeros(10), np.ones(90)]
    assert some_receivers(w, 90, 0).tolist() == list(range(10, 100))
    rows = some_receivers(w, 30, 0)
    assert len(np.unique(rows)) == 30 and rows.min() >= 10 and (np.diff(rows) > 0).all()
    assert (rows != some_receivers(w, 30, 1)).any()


def test_a_twin_sees_the_same_photons_in_its_own_way():
    """Its settings and poses are its own; both remain what a solver alone would be, bit for bit."""
    solver = Solver(support.room(), photons=8192, radius=0.06)
    solver.solve()
    before, pose = solver.irradiance, solver.poses["block"]
    twin = solver.twin()
    twin.configure(estimator="photon_map", neighbours=20)
    twin.solve()
    twin.move("block", pose._replace(position=(0.6, 0.3, 0.5)))
    assert np.array_equal(twin.irradiance, twin.from_scratch())
    assert solver.estimator == "tangent_plane" and solver.poses["block"] == pose and solver.irradiance is before
    alone = Solver(support.room(), "photon_map", photons=8192, radius=0.06, neighbours=20)
    alone.solve()
    twin.move("block", pose)
    assert np.array_equal(twin.irradiance, alone.irradiance)
    solver.move("block", pose)
    assert np.array_equal(solver.irradiance, before)
    # Photons that the twin traces are there for both.
    twin.configure(photons=10_000)
    twin.solve()
    solver.configure(photons=10_000)
    solver.solve()
    assert np.array_equal(solver.irradiance, solver.from_scratch()) and solver.photons_traced == 10_000

"""Measures of error on numbers computed by hand, and on a room."""

import math

import numpy as np
import pytest

from gi_core.geometry.error import (
    bias_left,
    local_deviation,
    luminance,
    noise_from_subset,
    relative_error,
    relative_noise,
    signed_error,
    subset_to_compare,
)
from gi_core.geometry.receivers import Receivers
from tests.support import viewer_support as support
from tests.support.scene_builders import solve


def grey(*values):
    return np.repeat(np.array(values, float)[:, None], 3, axis=1)


def test_luminance_is_rec_709():
    assert luminance([1.0, 1.0, 1.0]) == pytest.approx(1.0)
    assert luminance(np.eye(3)) == pytest.approx([0.2126, 0.7152, 0.0722])


def test_relative_error_by_hand():
    """|E - T| = 1, 0, 3 with areas 2, 1, 1: l1 = (2 + 3) / (2 * 1 + 2 + 6) = 0.5; l2^2 = (2 + 9) / (2 + 4 + 36)."""
    error = relative_error(grey(2, 2, 3), grey(1, 2, 6), [2, 1, 1])
    assert error.l1 == pytest.approx(0.5)
    assert error.l2 == pytest.approx(np.sqrt(11 / 42))


def test_relative_error_over_some_rows_and_in_the_dark():
    E, T, w = grey(2, 2, 3), grey(1, 2, 6), np.ones(3)
    assert relative_error(E, T, w, np.array([False, True, False])) == (0, 0)
    assert np.isnan(relative_error(E, 0 * T, w)).all()


def test_relative_noise_equals_the_error_of_a_noisy_reference():
    rng = np.random.default_rng(5)
    T = grey(*np.linspace(1, 3, 4000))
    s = 0.1 * np.ones_like(T)
    noisy = T + 0.1 * rng.normal(size=(4000, 1))
    assert relative_noise(luminance(s), T, np.ones(4000)) == pytest.approx(
        relative_error(noisy, T, np.ones(4000)).l1, rel=0.03
    )


@pytest.mark.parametrize("subset", [1000, 5000, 7500])
def test_noise_from_a_subset_equals_that_of_independent_photons(subset):
    """10,000 photons of 1 +- 20 each: the mean has an error of 0.2 sqrt(2 / pi), estimated from any subset."""
    rng = np.random.default_rng(3)
    first = 1 + 20 * rng.normal(size=20_000) / math.sqrt(subset)
    rest = 1 + 20 * rng.normal(size=20_000) / math.sqrt(10_000 - subset)
    both = (subset * first + (10_000 - subset) * rest) / 10_000
    w = np.ones(20_000)
    noise = noise_from_subset(grey(*both), grey(*first), 10_000, subset, w)
    assert noise == pytest.approx(0.2 * math.sqrt(2 / math.pi), rel=0.03)


def test_noise_needs_a_subset():
    for subset in (0, 10, 11):
        with pytest.raises(ValueError, match="subset must be in 1 .. 9"):
            noise_from_subset(grey(1), grey(1), 10, subset, np.ones(1))
    assert subset_to_compare(()) is None and subset_to_compare((4096,)) is None
    assert subset_to_compare((4096, 8192, 16384, 20_000)) == 8192
    assert subset_to_compare((4096, 8192, 16384)) == 8192


@pytest.mark.slow
def test_estimated_noise_and_bias_equal_those_against_the_limit():
    """A room at 16,384 photons: the limit has 32 times as many of another seed; the truth is biased on purpose."""
    E, fewer, limit = [], [], []
    few = solve(support.room(), photons=16_384, radius=0.06, seed=1)
    E = few.irradiance
    few.configure(subset_only=True)
    subset = subset_to_compare(few.frame.subsets)
    few.move_all({}, subset)
    fewer = few.irradiance
    many = solve(support.room(), photons=524_288, radius=0.06, seed=2)
    limit, w = many.irradiance, many.receivers.areas
    bump = 1 + 0.3 * np.sin(40 * many.receivers.positions.sum(axis=1))[:, None]
    truth = limit * bump
    own, bias, total = (relative_error(*of, w).l1 for of in ((E, limit), (limit, truth), (E, truth)))
    noise = noise_from_subset(E, fewer, 16_384, subset, w)
    assert own <= 1.05 * noise <= 1.6 * own, "rather more than less"
    assert bias_left(total, own) == pytest.approx(bias, rel=0.1)


def test_bias_is_never_negative():
    assert bias_left(0.05, 0.03) == pytest.approx(0.04)
    assert bias_left(0.05, 0.04, 0.04) == 0
    assert math.isnan(bias_left(0.05, float("nan")))


def test_signed_error_by_hand():
    """T = 1, 1, 0, 2 of mean 1: too bright by half, too dark by half, off by 0.01 of 0.02 in the dark, right."""
    E, T = grey(1.5, 0.5, 0.01, 2), grey(1, 1, 0, 2)
    assert signed_error(E, T, np.ones(4)) == pytest.approx([0.5, -0.5, 0.5, 0])
    T[1] = np.nan
    assert np.isnan(signed_error(E, T, np.ones(4))).tolist() == [False, True, False, False]
    assert (signed_error(E, 0 * grey(1, 1, 1, 1), np.ones(4)) == 0).all()


def test_local_deviation_is_that_of_clouds_and_not_of_the_mean():
    """A wall too bright by half has none; stripes of 10 % have 10 %, on a wall beside which another one is noisy."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(20) / 20, np.arange(20) / 20))
    zero, n = np.zeros(400), np.tile([0.0, 0.0, 1.0], (400, 1))
    places, normals = np.vstack([np.c_[x, y, zero], np.c_[x, zero, y]]), np.vstack([n, n[:, [0, 2, 1]]])
    receivers, T = Receivers(places, normals, np.ones(800)), np.ones((800, 3))
    stripes = np.where(np.arange(800) % 2, 0.9, 1.1)[:, None] * T
    stripes[400:] *= np.random.default_rng(0).random((400, 1))
    wall = tuple(a[:400] for a in receivers[:3])
    assert np.allclose(local_deviation(1.5 * T, T, receivers, 0.3), 0.0)
    assert np.allclose(local_deviation(stripes[:400], T[:400], wall, 0.3), 0.1, atol=0.01)
    assert np.allclose(local_deviation(T[:400], stripes[:400], wall, 0.3, 0.1), 0.0, atol=0.03), "noise of the truth"
    assert local_deviation(stripes, T, receivers, 0.3)[1] > 0.3, "the noisy wall"
    assert np.isnan(local_deviation(T, T, receivers, 0.01)).all(), "alone"

"""The colour map of errors: perceptually uniform, symmetric, and a separate colour for unknown values."""

from __future__ import annotations

import numpy as np
import pytest

from app.draw.colour_map import ABOVE, BELOW, UNKNOWN_COLOUR, ZERO, from_oklab, round_scale, signed_colours


def oklab(display):
    """The inverse, implemented separately: sRGB decoded, then Ottosson's two matrices."""
    c = np.asarray(display, np.float64)
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    to_lms = [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
    to_lab = [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
    return np.cbrt(linear @ np.transpose(to_lms)) @ np.transpose(to_lab)


def test_equal_steps_look_equal_and_both_arms_are_alike():
    x = np.linspace(-1, 1, 41)
    lab = oklab(signed_colours(x))
    steps = np.sqrt((np.diff(lab, axis=0) ** 2).sum(axis=1))
    assert steps[:20] == pytest.approx(steps[0], rel=0.02) and steps[20:] == pytest.approx(steps[-1], rel=0.02)
    assert steps[0] == pytest.approx(steps[-1], rel=0.1)
    assert lab[:, 0] == pytest.approx(lab[::-1, 0], abs=2e-3), "as dark below as above"
    assert (np.diff(lab[:21, 0]) > 0).all(), "lighter towards zero: it reads without colours too"


def test_ends_zero_and_beyond():
    colours = signed_colours([-5.0, -1.0, 0.0, 1.0, 5.0, np.nan])
    assert colours.dtype == np.float32 and (colours[[0, 3]] == colours[[1, 4]]).all()
    assert np.allclose(oklab(colours[[1, 2, 3]]), [BELOW, ZERO, ABOVE], atol=2e-3), "inside the display's gamut"
    assert colours[1].argmax() == 2 and colours[3].argmax() == 0 and np.ptp(colours[2]) < 2e-3
    assert np.allclose(colours[5], UNKNOWN_COLOUR)
    assert oklab(UNKNOWN_COLOUR)[0] < oklab(signed_colours(np.linspace(-1, 1, 9)))[:, 0].min() - 0.05


def test_white_is_white():
    assert from_oklab(np.array([[1.0, 0, 0], [0, 0, 0]])) == pytest.approx(np.array([[1, 1, 1], [0, 0, 0]]), abs=1e-3)


def test_scale_is_round_and_covers_the_bulk():
    w = np.ones(100)
    assert round_scale(np.linspace(0, 0.4, 100), w) == pytest.approx(0.5)
    assert round_scale(np.linspace(-0.19, 0.19, 100), w) == pytest.approx(0.2)
    assert round_scale(np.full(100, 0.1), w) == pytest.approx(0.1)
    assert round_scale(np.r_[np.full(97, 0.01), 9, 9, 9], w) == pytest.approx(0.01), "a few spots do not count"
    assert round_scale(np.r_[np.full(97, 0.01), 9, 9, 9], np.r_[np.ones(97), 50, 50, 50]) == pytest.approx(10)
    assert round_scale(np.full(100, np.nan), w) == round_scale(np.zeros(100), w) == 1

"""White balance: lamps of one colour become neutral, in the picture and in the shader alike."""

from __future__ import annotations

import numpy as np
import pytest

from app.draw.tonemap import MOST_GAIN, NEUTRAL, gains_for, to_display
from gi_core.geometry.error import luminance


def test_a_warm_lamp_becomes_neutral_and_keeps_its_luminance():
    flux = np.array([20.0, 13.0, 5.0])
    gains = np.array(gains_for(flux))
    balanced = gains * flux
    assert balanced == pytest.approx([balanced[0]] * 3)
    assert luminance(balanced) == pytest.approx(luminance(flux))
    grey = to_display(0.02 * flux[None], 0.0, "clip", tuple(gains.tolist()))[0]
    assert len(set(grey.tolist())) == 1 and 0 < grey[0] < 255


def test_neutral_light_and_darkness_have_no_gains():
    assert gains_for(np.full(3, 7.0)) == pytest.approx(NEUTRAL)
    assert gains_for(np.zeros(3)) == NEUTRAL


def test_light_of_one_colour_keeps_it():
    gains = np.array(gains_for(np.array([1.0, 0.0, 0.0])))
    assert np.isfinite(gains).all() and gains.max() / gains.min() <= MOST_GAIN / 0.2126 + 1e-9
    assert np.argmax(gains * [1.0, 0.0, 0.0]) == 0

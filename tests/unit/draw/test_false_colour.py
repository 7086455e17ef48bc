"""Scales of false colours: round ends and ticks, linear or logarithmic, robust against few extreme values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.draw.colour_map import SEQUENTIAL, sequential_colours
from app.draw.false_colour import Scale, automatic_scale, fixed_scale
from app.draw.units import PHOTOMETRIC
from gi_core.geometry.error import luminance


def test_the_map_is_ever_lighter():
    assert (np.diff(luminance(SEQUENTIAL**2.2)) > 0).all()
    ends = np.round(255 * sequential_colours(np.array([0.0, 1.0]))).astype(int)
    assert np.abs(ends - [[68, 1, 84], [253, 231, 37]]).max() <= 2, "those of viridis"


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        (np.linspace(100, 480, 1000), Scale(0.0, 500.0, False)),
        (np.linspace(0.1, 1.19, 1000), Scale(0.0, 1.2, False)),
        (np.full(1000, 3.7), Scale(0.0, 4.0, False)),
        (np.geomspace(0.9, 900, 1000), Scale(1.0, 1000.0, True)),
        (np.r_[np.full(990, 300.0), np.full(10, 1e6)], Scale(0.0, 300.0, False)),
        (np.r_[np.full(990, 300.0), np.full(10, 0.0)], Scale(0.0, 300.0, False)),
        (np.r_[np.zeros(500), np.full(500, 30.0)], Scale(0.002, 50.0, True)),
        (np.zeros(10), Scale(0.0, 1.0, False)),
        (np.array([np.nan, 8.0, np.nan]), Scale(0.0, 8.0, False)),
        (np.zeros(0), Scale(0.0, 1.0, False)),
    ],
)
def test_automatic_scale(values, scale):
    assert automatic_scale(values) == scale


def test_small_changes_keep_the_scale():
    rng = np.random.default_rng(1)
    values = rng.uniform(50, 430, 4000)
    assert len({automatic_scale(values * rng.normal(1, 0.02, 4000)) for _ in range(20)}) == 1


@pytest.mark.parametrize(
    "scale", [Scale(0, 500, False), Scale(0.01, 1, True), Scale(1, 1e4, True), Scale(7, 93, False)]
)
def test_ticks_are_round_and_apart(scale):
    ticks = np.array(scale.ticks)
    positions = scale.position(ticks)
    assert (ticks[0], ticks[-1]) == (scale.low, scale.high) and 4 <= len(ticks) <= 9
    assert np.diff(positions).min() > 0.08
    for tick in ticks[1:-1]:
        mantissa = tick / 10 ** math.floor(math.log10(tick) + 1e-9)
        assert mantissa == pytest.approx(round(mantissa, 1)), tick


def test_fixed_scale_and_words():
    assert fixed_scale(0, 500) == Scale(0, 500, False) and fixed_scale(10, 1000) == Scale(10, 1000, True)
    labels = fixed_scale(10, 1000).labels
    assert labels[0] == (0.0, "10 or less") and labels[-1] == (1.0, "1000 or more")
    assert fixed_scale(0, 500).labels[0] == (0.0, "0")
    assert fixed_scale(0, 500).title(PHOTOMETRIC) == ["Illuminance [lx]", "linear"]
    assert fixed_scale(10, 1000).position(np.array([1.0, 100.0, 1e9])).tolist() == pytest.approx([0, 0.5, 1])

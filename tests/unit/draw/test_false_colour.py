"""Scales of false colours: round ends and ticks, linear or logarithmic, robust against few extreme values.

The colour map of errors: perceptually uniform, symmetric, and a separate colour for unknown values.
"""

import math

import numpy as np
import pytest

from app.draw.colour_map import SEQUENTIAL, UNKNOWN_COLOUR, ZERO, from_oklab, sequential_colours, signed_colours
from app.draw.false_colour import (
    Scale,
    automatic_scale,
    false_colours,
    fixed_scale,
    round_above,
    round_below,
    round_scale,
)
from app.draw.legend import of_scale
from gi_core.geometry.error import luminance
from gi_core.scene.types import PHOTOMETRIC


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


@pytest.mark.parametrize(
    "scale, lines",
    [
        (Scale(0.0, 500.0, False), (100, 200, 300, 400, 500)),
        (Scale(0.0, 1.2, False), (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)),
        (Scale(7.0, 93.0, False), (20, 40, 60, 80)),
        (Scale(1.0, 1000.0, True), (2, 5, 10, 20, 50, 100, 200, 500, 1000)),
        (Scale(0.01, 1e4, True), tuple(10.0**k for k in range(-1, 5))),
    ],
)
def test_isolines_stand_at_round_values_or_at_those_given(scale, lines):
    assert scale.with_lines(()).lines == pytest.approx(lines) and len(lines) <= 16
    assert scale.with_lines(None).lines == ()
    assert scale.with_lines((30.0, 10.0, 30.0)).lines == (10.0, 30.0)


def test_the_legend_labels_isolines_where_there_is_room():
    scale = Scale(0.0, 1000.0, False).with_lines((100.0, 300.0, 310.0, 500.0, 990.0))
    assert scale.ticks == [0.0, 100.0, 300.0, 500.0, 1000.0]
    assert scale.text(PHOTOMETRIC).endswith("linear, viridis, isolines at 100, 300, 310, 500, 990")
    assert of_scale(scale, PHOTOMETRIC).marks == pytest.approx((0.1, 0.3, 0.31, 0.5, 0.99))


def test_isolines_need_a_slope_and_contrast_with_their_ground():
    scale = Scale(0.0, 1.0, False).with_lines((0.25, 0.75))
    plain = scale.with_lines(None)

    def drawn(E: float, slope: float) -> np.ndarray:
        grey = np.full((1, 3), E / math.pi)
        return false_colours(grey, scale, np.array([[0.6 * slope, 0.8 * slope]]))[0].astype(int)

    for E, ground in ((0.25, 255), (0.75, 0)):
        under = false_colours(np.full((1, 3), E / math.pi), plain)[0].astype(int)
        assert np.abs(drawn(E, 0.01) - (0.15 * under + 0.85 * ground)).max() <= 1
        assert np.array_equal(drawn(E, 0.0), under), "even light has no line"
        away = false_colours(np.full((1, 3), (E + 0.05) / math.pi), plain)[0]
        assert np.array_equal(drawn(E + 0.05, 0.01 / math.pi), away), "five pixels away"


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
    assert np.allclose(oklab(colours[[1, 2, 3]]), [(0.44, -0.028, -0.165), ZERO, (0.44, 0.155, 0.075)], atol=2e-3), (
        "inside the display's gamut"
    )
    assert colours[1].argmax() == 2 and colours[3].argmax() == 0 and np.ptp(colours[2]) < 2e-3
    assert np.allclose(colours[5], UNKNOWN_COLOUR)
    assert oklab(UNKNOWN_COLOUR)[0] < oklab(signed_colours(np.linspace(-1, 1, 9)))[:, 0].min() - 0.05


def test_white_is_white():
    assert from_oklab(np.array([[1.0, 0, 0], [0, 0, 0]])) == pytest.approx(np.array([[1, 1, 1], [0, 0, 0]]), abs=1e-3)


def test_round_numbers_are_1_2_or_5_times_a_power_of_ten():
    numbers = 0.0965, 0.0055, 1.0, 0.02
    assert [round_below(n) for n in numbers] == pytest.approx([0.05, 0.005, 1.0, 0.02])
    assert [round_above(n) for n in numbers] == pytest.approx([0.1, 0.01, 1.0, 0.02])


def test_scale_is_round_and_covers_the_bulk():
    w = np.ones(100)
    assert round_scale(np.linspace(0, 0.4, 100), w) == pytest.approx(0.5)
    assert round_scale(np.linspace(-0.19, 0.19, 100), w) == pytest.approx(0.2)
    assert round_scale(np.full(100, 0.1), w) == pytest.approx(0.1)
    assert round_scale(np.r_[np.full(97, 0.01), 9, 9, 9], w) == pytest.approx(0.01), "a few spots do not count"
    assert round_scale(np.r_[np.full(97, 0.01), 9, 9, 9], np.r_[np.ones(97), 50, 50, 50]) == pytest.approx(10)
    assert round_scale(np.full(100, np.nan), w) == round_scale(np.zeros(100), w) == 1

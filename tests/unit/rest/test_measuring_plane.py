"""The measuring plane: its grid by EN 12464-1, its numbers by hand, its light against closed forms."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.draw.units import PHOTOMETRIC
from app.rest.measuring_plane import (
    axes_of,
    default_plane,
    grid_of,
    is_inside,
    level_of,
    light_steps,
    plane_steps,
    standard_points,
    uniformity,
)  # fmt: skip
from app.session.readouts import Row, csv_text, shown, text_lines
from app.settings import MeasuringPlane
from gi_core.model import Model
from gi_core.scene import Material, Mobile, Pose, Scene, SpotLight
from tests.support import closed_form
from tests.support.scene_builders import box, furnace_scene, quad

UP = (0.0, 0.0, 1.0)
INTENSITY, LAMP = 400.0, 2.75  # [cd], [m] above the floor
INNER, OUTER = 30.0, 60.0  # [degrees]


def downlight(*mobiles: Mobile) -> Scene:
    """A black floor of 4 x 3 m, a downlight over its middle, as over a desk."""
    light = SpotLight("downlight", (0, 0, LAMP), (0, 0, -1), (INTENSITY,) * 3, INNER, OUTER)
    black = Material("black", (0.0,) * 3)
    floor = quad((-2, -1.5, 0), (4, 0, 0), (0, 3, 0), (8, 6))
    return Scene(floor, (black,), mobiles, (light,), up=UP, units="photometric", name="downlight")


def measured(scene: Scene, plane: MeasuringPlane, low, high, seed: int = 0, noise: float = 0.01):
    model = Model(scene)
    level = level_of(low, high, scene.up)
    levels = np.ones((model.emitters.lamps.count, 3))
    *_, light = plane_steps(model, plane, level, model.start_poses(), levels, seed, noise)
    return light, level


@pytest.mark.parametrize(
    "width, depth, points",
    [  # EN 12464-1, table A.1: 5 points per metre, 6 in 2 m, 8 in 5 m, 10 in 10 m
        (1.0, 1.0, (5, 5)), (2.0, 2.0, (6, 6)), (5.0, 5.0, (8, 8)), (10.0, 10.0, (10, 10)),
        (0.4, 0.4, (4, 4)), (0.1, 0.1, (3, 3)),
        (10.0, 6.0, (10, 6)),
        (6.0, 10.0, (6, 10)),
        (20.0, 1.0, (100, 5)),  # more than 2:1, so the shorter side counts: p = 0.2 m
        (500.0, 400.0, (50, 40)),  # p <= 10 m
    ],
)  # fmt: skip
def test_the_grid_is_that_of_en_12464_1(width, depth, points):
    assert standard_points(width, depth) == points


def test_points_are_the_centres_of_cells_on_horizontal_axes():
    level = level_of((-1, 0, -2), (3, 2.5, 2), (0, 1, 0))
    assert level.axes.names == ("x", "z") and level.low[2] == 0
    grid = grid_of(MeasuringPlane((-1, -2), (3, 2), 0.75, (2, 4)), level)
    assert grid.shape == (2, 4)
    assert grid.positions[:5].tolist() == [[0, 0.75, z] for z in (-1.5, -0.5, 0.5, 1.5)] + [[2, 0.75, -1.5]]
    assert sorted(map(tuple, grid.corners.tolist())) == [(-1, 0.75, -2), (-1, 0.75, 2), (3, 0.75, -2), (3, 0.75, 2)]
    assert axes_of((0, 0, 1)).names == ("x", "y") and axes_of((1, 1, 0)).names == ("east", "north")
    upside_down = level_of((0, 0, 0), (1, 1, 4), (0, 0, -1))
    assert upside_down.low[2] == -4, "the floor is below"
    assert grid_of(MeasuringPlane((0, 0), (1, 1), 1.0, (1, 1)), upside_down).positions.tolist() == [[0.5, 0.5, 3.0]]


def test_the_default_is_desk_height_without_the_border_along_walls():
    assert default_plane(level_of((0, 0, 0), (6, 4, 3), UP)) == MeasuringPlane((0.5, 0.5), (5.5, 3.5), 0.75)
    tiny = default_plane(level_of((0, 0, 0), (0.6, 0.6, 0.5), UP))
    assert tiny == MeasuringPlane((0.0, 0.0), (0.6, 0.6), 0.25)


def test_numbers_of_a_grid_by_hand():
    values = np.array([100.0, 200.0, np.nan, 300.0, 400.0, 500.0, 600.0])
    n = uniformity(values, np.full(7, 10.0))
    assert (n.points, n.left_out) == (6, 1)
    assert (n.mean, n.least, n.most) == (350.0, 100.0, 600.0)
    assert (n.U0, n.Ud) == pytest.approx((100 / 350, 100 / 600))
    of_mean = 10 / math.sqrt(6)
    assert n.mean_error == pytest.approx(of_mean)
    assert n.U0_error == pytest.approx(n.U0 * math.hypot(10 / 100, of_mean / 350))
    assert n.Ud_error == pytest.approx(n.Ud * math.hypot(10 / 100, 10 / 600))
    dark, none = uniformity(np.zeros(4), np.zeros(4)), uniformity(np.full(2, np.nan), np.full(2, np.nan))
    assert math.isnan(dark.U0) and dark.mean == 0 and math.isnan(none.mean) and none.left_out == 2


def test_a_downlight_over_a_desk_by_hand():
    """I cos^3 / h^2 with the falloff of the spot, h = 2 m from lamp to desk height. Direct light has no noise."""
    plane = MeasuringPlane((-1.5, -1.0), (1.5, 1.0), 0.75)
    light, level = measured(downlight(), plane, (-2, -1.5, 0), (2, 1.5, 2.75))
    x = np.hypot(*light.grid.positions[:, :2].T)
    inner, outer = (math.cos(math.radians(a)) for a in (INNER, OUTER))
    expected = closed_form.spot_over_plane(INTENSITY, LAMP - 0.75, x, inner, outer)
    assert light.grid.shape == (7, 5) and light.fraction == 1.0
    assert light.values == pytest.approx(expected, rel=1e-4)
    n = light.numbers
    assert n.most == pytest.approx(INTENSITY / 4, rel=1e-4), "the middle of an odd grid: I / h^2"
    assert (n.mean, n.least) == pytest.approx((expected.mean(), expected.min()), rel=1e-4)
    assert n.U0 == pytest.approx(expected.min() / expected.mean(), rel=1e-4) and n.U0_error < 1e-4
    lines = text_lines([], light, level, PHOTOMETRIC)
    assert lines[0].startswith("measuring plane    3 x 2 m, 0.75 m above the floor, 7 x 5 points")
    assert lines[3] == "maximum            100 lx" and lines[4].startswith(f"uniformity U0      {n.U0:.4g} ")


def test_points_inside_objects_and_outside_a_room_do_not_count():
    mesh = box((-0.6, -0.6, 0.3), (0.6, 0.6, 1.2))
    plane = MeasuringPlane((-2, -2), (2, 2), 0.75, (4, 4))  # x, y in -1.5, -0.5, 0.5, 1.5
    light, _ = measured(downlight(Mobile("cabinet", mesh, Pose())), plane, (-2, -1.5, 0), (2, 1.5, 2.75))
    inside = np.abs(light.grid.positions[:, :2]).max(axis=1) < 0.6
    assert inside.sum() == 4 and np.array_equal(np.isnan(light.values), inside)
    assert light.numbers.left_out == 4 and light.numbers.points == 12
    model = Model(furnace_scene(1.0, 0.5, divisions=2))
    at, points = model.transforms(model.start_poses()), np.array([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [0.5, 0.5, 3.0]])
    assert is_inside(model, at, points, np.array(UP)).tolist() == [False, True, False], "nothing is above the last one"


class RoundsOfErrors:
    """Rounds at one point of irradiance 1 with given standard errors."""

    def __init__(self, errors):
        self.errors = iter(errors)
        self.state = SimpleNamespace(rounds=0, sets=np.array([64]), mean=np.ones((1, 3)), paths=np.zeros(1))

    def step(self):
        self.state.rounds += 1
        self.state.standard_error = np.full((1, 3), next(self.errors))


def test_the_fraction_measured_only_grows():
    """The noise that it follows is measured: a rare bright path raises it."""
    errors = [0.1, 0.08, 0.06, 0.05, *(0.03,) * 8, 0.06, 0.05, 0.04, 0.001]
    fractions = [fraction for *_, fraction in light_steps(RoundsOfErrors(errors), 0.01)]
    assert fractions == sorted(fractions) and 0 < fractions[-2] < fractions[-1] == 1.0 and len(fractions) == len(errors)


def test_the_furnace_is_even_and_standard_errors_are_honest():
    """E = pi Le / (1 - rho) everywhere; the deviations of 12 seeds are those that the standard errors state."""
    truth = closed_form.furnace(1.0, 0.5)
    off_points, off_mean = [], []
    for seed in range(12):
        plane = MeasuringPlane((0.1, 0.1), (0.9, 0.9), 0.5, (4, 4))
        light, _ = measured(furnace_scene(1.0, 0.5, divisions=2), plane, (0, 0, 0), (1, 1, 1), seed, 0.05)
        n = light.numbers
        assert n.left_out == 0 and 0.9 < n.U0 <= 1 <= n.most / n.mean < 1.1 and n.mean_error < 0.01 * n.mean
        off_points.extend((light.values - truth) / light.errors)
        off_mean.append((n.mean - truth) / n.mean_error)
    assert abs(np.mean(off_mean)) < 4 / math.sqrt(12)
    assert 0.8 < np.sqrt(np.mean(np.square(off_points))) < 1.5, "of 8 sets: 1.18, Student's t of 7 degrees of freedom"
    assert 0.5 < np.sqrt(np.mean(np.square(off_mean))) < 1.8


def test_the_table_has_every_point_and_no_formula():
    plane = MeasuringPlane((-1.5, -1.0), (1.5, 1.0), 0.75, (2, 1))
    light, level = measured(downlight(), plane, (-2, -1.5, 0), (2, 1.5, 2.75))
    rows = [Row("pin", "=1+1", (0.1, 0.2, 0.3), 512.3, radiance=81.5, object="static part", material="oak")]
    table = list(csv.reader(io.StringIO(csv_text(rows, light, PHOTOMETRIC))))
    head, pin, *numbers = table
    assert head[5:8] == ["illuminance [lx]", "standard error [lx]", "luminance [cd/m2]"]
    assert pin == ["pin", "'=1+1", "0.1", "0.2", "0.3", "512.3", "", "81.5", "static part", "oak"]
    assert [row[1] for row in numbers[:3]] == ["mean", "minimum", "maximum"] and len(numbers) == 5 + 2
    assert {len(row) for row in table} == {10}
    assert [float(row[5]) for row in numbers[5:]] == pytest.approx(light.values.tolist(), rel=1e-6)
    assert [row[1] for row in numbers[5:]] == ["1 1", "2 1"] and float(numbers[5][2]) == -0.75


def test_a_point_has_the_same_digits_in_the_map_as_beside_its_error():
    """The least and the largest value of a plane under a bright lamp, 20 times that of the other tests."""
    scene = downlight()
    bright = replace(scene, lights=(scene.lights[0]._replace(intensity=(2e4,) * 3),))
    light, level = measured(bright, MeasuringPlane((-1.5, -1.0), (1.5, 1.0), 1.75, (3, 3)), (-2, -1.5, 0), (2, 1.5, 2))
    for given in (light, light._replace(errors=np.linspace(0.2, 30, 9)), light._replace(errors=np.full(9, 1e-4))):
        lines = text_lines([], given, level, PHOTOMETRIC)
        stated = {line.split()[0]: line.split()[1] for line in lines[2:4]}
        cells = [cell for line in lines[9:12] for cell in line.split()[1:]]
        assert len(cells) == 9 and "e+" not in " ".join(cells) and {*stated} == {"minimum", "maximum"}
        assert stated["minimum"] in cells and stated["maximum"] in cells


@pytest.mark.parametrize(
    "value, error, text",
    [(665.193, 0.2143, "665.19 ± 0.21 lx"), (202.03, 4.02, "202.0 ± 4.0 lx"), (1234.5, 31.0, "1234 ± 31 lx"),
     (0.5, math.nan, "0.5 lx"), (100.0, 0.0, "100 lx"), (math.nan, 1.0, "unknown"), (98765.4, 0.0, "98765 lx")],
)  # fmt: skip
def test_values_have_the_digits_of_their_error(value, error, text):
    assert shown(value, error, "lx") == text

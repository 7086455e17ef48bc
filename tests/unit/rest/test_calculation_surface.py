"""Calculation surfaces: grids by EN 12464-1, numbers and verdicts by hand, light against closed forms."""

import csv
import io
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.rest.calculation_surface import (
    FAIL,
    PASS,
    UNCERTAIN,
    WORKING_PLANE,
    SurfaceLight,
    all_steps,
    light_steps,
    surface_steps,
    uniformity,
    verdict,
)
from app.rest.surface_grid import BORDER, axes_of, box_along, grid_of, in_room, level_of, on_part, points_of
from app.session.readouts import Row, csv_text, shown, text_lines
from gi_core.model import Model
from gi_core.scene import CalculationSurface, Material, Mobile, PointLight, Pose, Scene, SkyLight, SpotLight
from gi_core.scene.types import CYLINDRICAL, MOST_GRID_POINTS, PHOTOMETRIC
from tests.support import closed_form
from tests.support.scene_builders import box, furnace_scene, grey, lamp, merge, quad, sphere

UP = (0.0, 0.0, 1.0)
INTENSITY, LAMP = 400.0, 2.75  # [cd], [m] above the floor
INNER, OUTER = 30.0, 60.0  # [degrees]


def downlight(*mobiles: Mobile) -> Scene:
    """A black floor of 4 x 3 m, a downlight over its middle, as over a desk."""
    light = SpotLight("downlight", (0, 0, LAMP), (0, 0, -1), (INTENSITY,) * 3, INNER, OUTER)
    black = Material("black", (0.0,) * 3)
    floor = quad((-2, -1.5, 0), (4, 0, 0), (0, 3, 0), (8, 6))
    return Scene(floor, (black,), mobiles, (light,), up=UP, units="photometric", name="downlight")


def rectangle(low, high, height: float, points=None) -> CalculationSurface:
    """Return a level surface between two corners [m]."""
    (a, b), (c, d) = low, high
    return CalculationSurface("plane", "", ((a + c) / 2, (b + d) / 2), (c - a, d - b), height, points=points)


def measured(scene: Scene, plane: CalculationSurface, low, high, seed: int = 0, noise: float = 0.01):
    model = Model(scene)
    level = box_along(low, high, scene.up)
    levels = np.ones((model.emitters.lamps.count, 3))
    *_, light = surface_steps(model, plane, level, model.start_poses(), levels, seed, noise)
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
    assert points_of((width, depth)) == (points, "")


def test_points_are_the_centres_of_cells_on_horizontal_axes():
    level = box_along((-1, 0, -2), (3, 2.5, 2), (0, 1, 0))
    assert level.axes.names == ("x", "z") and level.low[2] == 0
    model = Model(furnace_scene(1.0, 0.5, divisions=2))
    grid = grid_of(rectangle((-1, -2), (3, 2), 0.75, (2, 4)), model, level, {})
    assert grid.shape == (2, 4)
    assert grid.positions[:5].tolist() == [[0, 0.75, z] for z in (-1.5, -0.5, 0.5, 1.5)] + [[2, 0.75, -1.5]]
    assert sorted(map(tuple, grid.corners.tolist())) == [(-1, 0.75, -2), (-1, 0.75, 2), (3, 0.75, -2), (3, 0.75, 2)]
    assert axes_of((0, 0, 1)).names == ("x", "y") and axes_of((1, 1, 0)).names == ("east", "north")
    upside_down = box_along((0, 0, 0), (1, 1, 4), (0, 0, -1))
    assert upside_down.low[2] == -4, "the floor is below"
    assert grid_of(rectangle((0, 0), (1, 1), 1.0, (1, 1)), model, upside_down, {}).positions.tolist() == [
        [0.5, 0.5, 3.0]
    ]


def test_the_default_is_desk_height_without_the_border_along_walls():
    room = in_room(WORKING_PLANE, box_along((0, 0, 0), (6, 4, 3), UP))
    assert (room.position, room.size, room.height, room.margin) == ((3.0, 2.0), (6.0, 4.0), 0.75, BORDER)
    tiny = in_room(WORKING_PLANE, box_along((0, 0, 0), (0.6, 0.6, 0.5), UP))
    assert (tiny.position, tiny.size, tiny.height, tiny.margin) == ((0.3, 0.3), (0.6, 0.6), 0.25, 0.0)
    own = in_room(WORKING_PLANE._replace(size=(5, 5), height=1.2), box_along((0, 0, 0), (6, 4, 3), UP))
    assert (own.size, own.height, own.margin) == ((5, 5), 1.2, 0.0), "a size that is given has no border"


def test_numbers_of_a_grid_by_hand():
    values = np.array([100.0, 200.0, np.nan, 300.0, 400.0, 500.0, 600.0])
    n = uniformity(values, np.full(7, 10.0))
    assert (n.points, n.left_out) == (6, 1)
    of_mean = 10 / math.sqrt(6)
    U0, Ud = 100 / 350, 100 / 600
    U0_error, Ud_error = U0 * math.hypot(10 / 100, of_mean / 350), Ud * math.hypot(10 / 100, 10 / 600)
    expected = np.array([(350, of_mean), (100, 10), (600, 10), (U0, U0_error), (Ud, Ud_error)])
    assert np.array([row[1:3] for row in n.rows()]) == pytest.approx(expected)
    dark, none = uniformity(np.zeros(4), np.zeros(4)), uniformity(np.full(2, np.nan), np.full(2, np.nan))
    assert math.isnan(dark.rows()[3][1]) and dark.mean[0] == 0 and math.isnan(none.mean[0]) and none.left_out == 2


def test_a_downlight_over_a_desk_by_hand():
    """I cos^3 / h^2 with the falloff of the spot, h = 2 m from lamp to desk height. Direct light has no noise."""
    plane = rectangle((-1.5, -1.0), (1.5, 1.0), 0.75)
    light, level = measured(downlight(), plane, (-2, -1.5, 0), (2, 1.5, 2.75))
    x = np.hypot(*light.grid.positions[:, :2].T)
    inner, outer = (math.cos(math.radians(a)) for a in (INNER, OUTER))
    expected = closed_form.spot_over_plane(INTENSITY, LAMP - 0.75, x, inner, outer)
    assert light.grid.shape == (7, 5) and light.fraction == 1.0
    assert light.values == pytest.approx(expected, rel=1e-4)
    n = light.numbers
    assert n.most[0] == pytest.approx(INTENSITY / 4, rel=1e-4), "the middle of an odd grid: I / h^2"
    assert (n.mean[0], n.least[0]) == pytest.approx((expected.mean(), expected.min()), rel=1e-4)
    U0, error = n.rows()[3][1:3]
    assert U0 == pytest.approx(expected.min() / expected.mean(), rel=1e-4) and error < 1e-4
    lines = text_lines([], [light], level, PHOTOMETRIC)
    assert lines[0].startswith("plane              3 x 2 m, 0.75 m above the floor, 7 x 5 points")
    assert lines[3] == "maximum            100 lx" and lines[4].startswith(f"uniformity U0      {U0:.4g} ")


def test_points_inside_objects_and_outside_a_room_do_not_count():
    mesh = box((-0.6, -0.6, 0.3), (0.6, 0.6, 1.2))
    plane = rectangle((-2, -1.6), (2, 1.6), 0.75, (4, 4))  # x in -1.5, -0.5, 0.5, 1.5
    light, level = measured(downlight(Mobile("cabinet", mesh, Pose())), plane, (-2, -1.5, 0), (2, 1.5, 2.75))
    inside = np.abs(light.grid.positions[:, :2]).max(axis=1) < 0.6
    assert inside.sum() == 4 and np.array_equal(np.isnan(light.values), inside)
    assert light.numbers.left_out == 4 and light.numbers.points == 12
    assert (
        "4 of them inside objects or outside the room"
        in text_lines([], [light], level_of(Model(downlight())), PHOTOMETRIC)[0]
    )


WALL, SHEET, GLOW = range(3)  # one-sided, two-sided, and a lamp


def level_quad(x0, y0, x1, y1, z, material=WALL, up=True):
    u, v = ((x1 - x0, 0, 0), (0, y1 - y0, 0)) if up else ((0, y1 - y0, 0), (x1 - x0, 0, 0))
    return quad((x0, y0, z), u, v, (4, 4), material)


def walls(*corners, height=3.0, material=SHEET):
    """Return a wall per side of a polygon; one-sided ones face outwards where it turns left."""
    ends = zip(corners, corners[1:] + corners[:1], strict=True)
    return [quad((*a, 0), (b[0] - a[0], b[1] - a[1], 0), (0, 0, height), (3, 3), material) for a, b in ends]


def room(*parts, lights=(), at=(0, 0, 0), scale=1.0) -> Scene:
    mesh, bulbs = merge(*parts), [PointLight(f"bulb {k}", place, (50.0,) * 3) for k, place in enumerate(lights)]
    mesh = mesh._replace(vertices=mesh.vertices * scale + at)
    lamps = tuple(b._replace(position=tuple(np.multiply(b.position, scale) + at)) for b in bulbs)
    return Scene(mesh, (grey(0.5), grey(0.5, True), lamp(1.0)), (), lamps, up=UP, name="room")


def l_room(**place) -> Scene:
    """6 x 6 m without a quarter of 3 x 3 m; walls, floor and ceiling are two-sided."""
    flats = [level_quad(*area, z, SHEET) for z in (0, 3) for area in ((0, 0, 6, 3), (0, 3, 3, 6))]
    return room(*flats, *walls((0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)), lights=[(1.5, 1.5, 2.5)], **place)


def shell(height=3.0, z=0.0):
    return box((0, 0, z), (6, 6, z + height), 4, WALL, inward=True)


def stairs() -> list:
    steps = [level_quad(2 + 0.3 * k, 2, 2.3 + 0.3 * k, 4, 0.18 * (k + 1), SHEET) for k in range(10)]
    return [shell(), *steps, level_quad(5, 0, 6, 6, 1.8, SHEET)]


PILLAR = walls((1.2, 1.2), (1.8, 1.2), (1.8, 1.8), (1.2, 1.8), height=2.9, material=WALL)
CUPBOARD = box((4, 1, 0.2), (5.5, 5, 2), 2, SHEET)
BLINDS = [level_quad(0.25 * k, 0, 0.25 * k + 0.23, 6, 2.4) for k in range(24)]
DESKS = [box((x, 1, 0.7), (x + 1.5, 5, 0.75), 2) for x in (1, 3.5)]
ABOVE, BELOW = [(3, 3, 5.5)], [(3, 3, 1.5)]
SKY = replace(room(level_quad(0, 0, 6, 6, 0), level_quad(0, 0, 6, 6, 3), *walls((6, 6), (6, 0), (0, 0), (0, 6))[:3]),
              lights=(SkyLight("sky", (1.0,) * 3),))  # fmt: skip
DOME = sphere((3, 3, 0), 50, 3, GLOW)
DOME = DOME._replace(faces=DOME.faces[:, ::-1].copy())
ROOMS = {  # scene; height of the floor; points of 6 x 6 that count, 0.5 to 5.5 m along both axes, 0.75 m above it
    "L": (l_room(), 0.0, 27),
    "L at 4e5 m": (l_room(at=(4e5, 4e5, 100)), 100.0, 27),
    "L at 5e6 m": (l_room(at=(5e6, 5e6, 100)), 100.0, 27),
    "L in mm": (l_room(scale=1000.0), 0.0, 27),
    "hall open on one side, its roof facing up": (SKY, 0.0, 36),
    "blinds": (room(shell(), *BLINDS, lights=[(3, 3, 2.8)]), 0.0, 36),
    "desks": (room(shell(), *DESKS, lights=[(3, 3, 2.8)]), 0.0, 36),
    "closed two-sided cupboard": (room(shell(), CUPBOARD, lights=[(3, 3, 2.8)]), 0.0, 28),
    "pillar without ends, with a gap": (room(shell(), *PILLAR, lights=[(3, 3, 2.8)]), 0.0, 35),
    "two floors": (room(shell(), shell(z=3.3), lights=[*ABOVE, *BELOW]), 0.0, 36),
    "two floors, light above": (room(shell(), shell(z=3.3), lights=ABOVE), 3.3, 36),
    "stairs": (room(*stairs(), lights=[(1, 3, 2.8)]), 0.0, 36),
    "ground in a dome that is a lamp": (room(level_quad(0, 0, 6, 6, 0, SHEET), DOME), 0.0, 36),
    "no lamp": (room(shell()), 0.0, 36),
}


@pytest.mark.parametrize("name", ROOMS)
def test_the_floor_and_the_points_that_count(name):
    scene, floor, points = ROOMS[name]
    model = Model(scene)
    level = level_of(model)
    size = 1000.0 if "mm" in name else 1.0
    assert level.low[2] == pytest.approx(floor, abs=1e-6 * (size + floor))
    low = scene.static.vertices[: -len(DOME.vertices) if "dome" in name else None].min(axis=0)[:2]
    ends = (tuple((low + x * size).tolist()) for x in (0.5, 5.5))
    plane = rectangle(*ends, 0.75 * size, (6, 6))
    levels = model.emitters.lamps.full()
    *_, light = surface_steps(model, plane, level, model.start_poses(), levels, 0, 0.5)
    assert light.numbers.points == points and (light.numbers.least[0] > 0) == (name != "no lamp")
    default = grid_of(WORKING_PLANE, model, level, {})
    if size == 1:
        ends = (default.corners[[0, 2], :2] - low).ravel()
        assert ends == pytest.approx((BORDER, BORDER, 6 - BORDER, 6 - BORDER), abs=0.1)
        assert points_of(default.size) == ((8, 8), "")
    else:
        (a, b), note = points_of(default.size)
        assert a == b == MOST_GRID_POINTS == len(np.unique(default.positions[:, 0].round(3)))
        assert "600 x 600 points" in note and "scale = 0.001" in note


def test_places_of_points_have_micrometres_at_survey_coordinates():
    model = Model(l_room(at=(2600123, 5100456, 100)))
    level = level_of(model)
    surface = WORKING_PLANE._replace(points=(2, 2))
    grid = grid_of(surface, model, level, {})
    assert grid.corners[0, :2] == pytest.approx((2600123.5, 5100456.5), abs=0.06)
    light = SurfaceLight(surface, grid, np.ones(4), np.zeros(4), 1.0)
    rows = list(csv.reader(io.StringIO(csv_text([], [light], PHOTOMETRIC))))[-4:]
    assert np.array([row[2:5] for row in rows], float) == pytest.approx(light.grid.positions, abs=1e-6)
    head = next(line for line in text_lines([], [light], level, PHOTOMETRIC) if "\\" in line)
    assert len(head.split()) == 6, "columns of the map stay apart"


def test_bodies_on_the_floor_take_nothing_from_its_area():
    """The bottom of a desk lies in the floor's plane, where vertical lines missed the floor."""
    empty, desk = shell(), box((1, 1, 0.0), (5, 3.5, 0.73), 2)
    areas = [level_of(Model(room(*parts, lights=[(3, 3, 2.8)]))).area for parts in ((empty,), (empty, desk))]
    assert areas == pytest.approx([36.0, 36.0], rel=0.01) and areas[0] == areas[1]


def test_a_surface_lies_on_the_part_around_a_face():
    """By its material alone, a surface for a desk lay on the floor of the same wood."""
    model = Model(room(shell(), box((1, 1, 0.0), (2.5, 1.8, 0.73), 2), lights=[(3, 3, 2.8)]))
    normals, middles = model.surfaces.normals, model.vertices_at(0, {})[model.surfaces.faces[0]].mean(axis=1)
    top, side = ((np.flatnonzero((normals[:, 2] > 0.9) & (middles[:, 2] > 0.7))), np.flatnonzero(normals[:, 0] > 0.9))
    expected = CalculationSurface("desk", position=(1.75, 1.4), size=(1.5, 0.8), height=0.73)
    assert on_part("desk", model, level_of(model), int(top[0])) == expected
    assert on_part("desk", model, level_of(model), int(side[0])).on == model.scene.materials[0].name


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


def test_a_noisy_point_ends_at_more_paths_where_less_noise_is_asked():
    def rounds(noise: float) -> int:
        noisy = RoundsOfErrors([0.1] * 20 + [1e-6] * 20)
        noisy.state.paths[:] = 1 << 17
        return len(list(light_steps(noisy, noise)))

    assert rounds(0.01) == rounds(0.05) < 20 < rounds(0.002)


def test_the_furnace_is_even_and_standard_errors_are_honest():
    """E = pi Le / (1 - rho) everywhere; the deviations of 12 seeds are those that the standard errors state."""
    truth = closed_form.furnace(1.0, 0.5)
    off_points, off_mean = [], []
    for seed in range(12):
        plane = rectangle((0.1, 0.1), (0.9, 0.9), 0.5, (4, 4))
        light, _ = measured(furnace_scene(1.0, 0.5, divisions=2), plane, (0, 0, 0), (1, 1, 1), seed, 0.05)
        n = light.numbers
        assert (
            n.left_out == 0
            and 0.9 < n.rows()[3][1] <= 1 <= n.most[0] / n.mean[0] < 1.1
            and n.mean[1] < 0.01 * n.mean[0]
        )
        off_points.extend((light.values - truth) / light.errors)
        off_mean.append((n.mean[0] - truth) / n.mean[1])
    assert abs(np.mean(off_mean)) < 4 / math.sqrt(12)
    assert 0.8 < np.sqrt(np.mean(np.square(off_points))) < 1.5, "of 8 sets: 1.18, Student's t of 7 degrees of freedom"
    assert 0.5 < np.sqrt(np.mean(np.square(off_mean))) < 1.8


def test_the_table_has_every_point_and_no_formula():
    plane = rectangle((-1.5, -1.0), (1.5, 1.0), 0.75, (2, 1))
    light, level = measured(downlight(), plane, (-2, -1.5, 0), (2, 1.5, 2.75))
    rows = [Row("pin", "=1+1", (0.1, 0.2, 0.3), 512.3, radiance=81.5, object="static part", material="oak")]
    table = list(csv.reader(io.StringIO(csv_text(rows, [light], PHOTOMETRIC))))
    head, pin, *numbers = table
    assert head[5:8] == ["illuminance [lx]", "standard error [lx]", "luminance [cd/m2]"]
    assert pin == ["pin", "'=1+1", "0.1", "0.2", "0.3", "512.3", "", "81.5", "static part", "oak", ""]
    assert [row[1] for row in numbers[:3]] == ["mean", "minimum", "maximum"] and len(numbers) == 5 + 2
    assert {len(row) for row in table} == {11}
    assert [float(row[5]) for row in numbers[5:]] == pytest.approx(light.values.tolist(), rel=1e-6)
    assert [row[1] for row in numbers[5:]] == ["1 1", "2 1"] and float(numbers[5][2]) == -0.75


def test_a_target_holds_where_that_is_certain_by_two_standard_errors():
    for value, error, at_most, expected in (
        (520, 9, False, PASS), (520, 11, False, UNCERTAIN), (480, 11, False, UNCERTAIN), (480, 9, False, FAIL),
        (500, 0, False, PASS), (499.9, 0, False, FAIL), (480, 9, True, PASS), (520, 9, True, FAIL),
        (math.nan, 1, False, UNCERTAIN),
    ):  # fmt: skip
        assert verdict(value, error, 500, at_most) == expected
    targets = (("mean", 60.0), ("minimum", 60.0), ("maximum", 120.0), ("U0", 0.1))
    plane = rectangle((-1.5, -1.0), (1.5, 1.0), 0.75)._replace(targets=targets)
    light, level = measured(downlight(), plane, (-2, -1.5, 0), (2, 1.5, 2.75))
    assert light.verdicts == {"mean": PASS, "minimum": FAIL, "maximum": PASS, "U0": PASS}, light.numbers
    lines = text_lines([], [light], level, PHOTOMETRIC)
    assert lines[2].endswith("at least 60 lx: fail") and lines[3].endswith("at most 120 lx: pass")
    table = list(csv.reader(io.StringIO(csv_text([], [light], PHOTOMETRIC))))
    assert [row[10] for row in table[1:6]] == ["60: pass", "60: fail", "120: pass", "0.1: pass", ""]


@pytest.mark.parametrize("turn", [0.0, 30.0])
@pytest.mark.parametrize("tilt", [0.0, 40.0, 90.0])
def test_a_tilted_surface_under_a_lamp_by_hand(tilt, turn):
    """E = I cos(angle of incidence) / d^2 at every point of a surface that leans to one side."""
    scene = replace(downlight(), lights=(PointLight("bulb", (0, 0, LAMP), (4 * math.pi * INTENSITY,) * 3),))
    surface = CalculationSurface("board", "", (0.6, -0.3), (0.5, 0.8), 1.0, tilt, turn, points=(3, 4))
    light, _ = measured(scene, surface, (-2, -1.5, 0), (2, 1.5, 2.75))
    t, r = math.radians(tilt), math.radians(turn)
    normal = np.array([math.sin(t) * math.cos(r), math.sin(t) * math.sin(r), math.cos(t)])
    way = np.array([0, 0, LAMP]) - light.grid.positions
    d = np.sqrt((way * way).sum(axis=1))
    E = INTENSITY * np.maximum(way @ normal, 0) / d**3
    assert light.grid.positions.mean(axis=0) == pytest.approx([0.6, -0.3, 1.0]) and light.grid.sides[
        2
    ] == pytest.approx(normal)
    assert light.grid.size == pytest.approx([0.5, 0.8]) and light.grid.shape == (3, 4)
    counted = np.isfinite(light.values)
    assert light.values[counted] == pytest.approx(E[counted], rel=1e-4) and counted.sum() >= (E > 0).sum()


SEAT = CalculationSurface("seats", "", (0.6, -0.3), (0.5, 0.8), turn=20.0, points=(3, 4), quantity=CYLINDRICAL)
SKY, BULB = SkyLight("sky", (2.0,) * 3), PointLight("bulb", (0, 0, LAMP), (4 * math.pi * INTENSITY,) * 3)


@pytest.mark.parametrize("tilt", [0.0, 60.0])
def test_cylindrical_illuminance_by_hand(tilt):
    """The integral of L sin over all directions, over pi: pi L / 2 of a uniform sky, I sin / (pi d^2) of a lamp."""
    for light in (SKY, BULB):
        scene, seats = replace(downlight(), lights=(light,)), SEAT._replace(tilt=tilt)
        result, _ = measured(scene, seats, (-2, -1.5, 0), (2, 1.5, 2.75))
        way = np.array([0, 0, LAMP]) - result.grid.positions
        d, level = np.sqrt((way * way).sum(axis=1)), np.hypot(way[:, 0], way[:, 1])
        E = np.full(12, math.pi * 2.0 / 2) if light is SKY else INTENSITY * level / (math.pi * d**3)
        off = (result.values - E) / np.maximum(result.errors, 1e-4 * E)
        assert result.grid.positions[:, 2].mean() == pytest.approx(1.2), "eyes of people who sit"
        assert np.abs(off).max() < 5 and abs(off.mean()) < 4 / math.sqrt(12) and (result.errors < 0.05 * E).all()


def test_the_furnace_is_the_same_to_a_cylinder():
    plane = rectangle((0.1, 0.1), (0.9, 0.9), 0.5, (4, 4))._replace(quantity=CYLINDRICAL)
    light, _ = measured(furnace_scene(1.0, 0.5, divisions=2), plane, (0, 0, 0), (1, 1, 1), 1, 0.03)
    off = (light.values - closed_form.furnace(1.0, 0.5)) / light.errors
    assert np.abs(off).max() < 5 and abs(off.mean()) < 4 / math.sqrt(16)
    assert "cylindrical illuminance [lx]" in csv_text([], [light], PHOTOMETRIC)
    assert text_lines([], [light], level_of(Model(downlight())), PHOTOMETRIC)[1].endswith(" lx")


def test_a_cylinder_on_a_floor_gets_the_light_above_it():
    """On the floor itself no path starts below it: half of the sky's light, not half of that."""
    scene = replace(downlight(), lights=(SKY,))
    low, _ = measured(scene, SEAT._replace(height=0.0), (-2, -1.5, 0), (2, 1.5, 2.75))
    assert low.values == pytest.approx(np.full(12, math.pi), rel=0.1)


def test_a_surface_on_a_mobile_moves_and_turns_with_it():
    """The top of a table of 1.2 x 0.8 m, whose shelf below is larger, then of the same table moved and turned."""
    table = merge(box((-0.6, -0.4, 0.70), (0.6, 0.4, 0.74), 3), box((-0.65, -0.4, 0.1), (0.65, 0.4, 0.14), 3))
    model = Model(downlight(Mobile("table", table, Pose())))
    level, top = box_along((-2, -1.5, 0), (2, 1.5, 2.75), UP), CalculationSurface("top", "table", margin=0.1)
    grid = grid_of(top, model, level, {"table": Pose()})
    assert grid.size == pytest.approx([1.0, 0.6]) and grid.positions[:, 2] == pytest.approx(0.74)
    half = math.radians(15)
    moved = {"table": Pose((0.5, 0.2, 0.0), (math.cos(half), 0, 0, math.sin(half)))}
    turned = grid_of(top, model, level, moved)
    turn = np.array(
        [[math.cos(2 * half), -math.sin(2 * half), 0], [math.sin(2 * half), math.cos(2 * half), 0], [0, 0, 1]]
    )
    assert turned.positions == pytest.approx(grid.positions @ turn.T + [0.5, 0.2, 0])
    *_, light = surface_steps(model, top, level, moved, np.ones((1, 3)), 0)
    assert light.numbers.left_out == 0, "no point lies inside the table"
    x = np.hypot(*light.grid.positions[:, :2].T)
    inner, outer = (math.cos(math.radians(a)) for a in (INNER, OUTER))
    assert light.values == pytest.approx(closed_form.spot_over_plane(INTENSITY, LAMP - 0.74, x, inner, outer), rel=1e-4)


def test_a_surface_on_a_wall_is_that_of_a_material():
    whole = room(shell(), quad((0.01, 2, 1), (0, 2, 0), (0, 0, 1), (4, 4), SHEET), lights=[(3, 3, 2.8)])
    names = (whole.materials[0], Material("board", (0.5,) * 3, two_sided=True), whole.materials[2])
    model = Model(replace(whole, materials=names))
    grid = grid_of(CalculationSurface("on the board", "board", height=0.002), model, level_of(model), {})
    assert grid.sides[2] == pytest.approx([1, 0, 0]), "into the room"
    assert sorted(grid.size) == pytest.approx([1, 2]) and grid.positions[:, 0] == pytest.approx(0.012)
    assert grid.positions.mean(axis=0)[1:] == pytest.approx([3, 1.5]) and grid.sides[1] == pytest.approx(UP)


def test_several_surfaces_are_measured_side_by_side_as_alone():
    planes = [rectangle((-1.5, -1.0), (1.5, 1.0), h, (3, 2))._replace(name=f"at {h}") for h in (0.5, 1.0)]
    model = Model(downlight())
    level, poses = box_along((-2, -1.5, 0), (2, 1.5, 2.75), UP), model.start_poses()
    *_, lights = all_steps(model, planes, level, poses, np.ones((1, 3)), 0)
    assert [light.surface for light in lights] == planes and all(light.fraction == 1 for light in lights)
    for plane, light in zip(planes, lights, strict=True):
        assert np.array_equal(light.values, measured(downlight(), plane, (-2, -1.5, 0), (2, 1.5, 2.75))[0].values)


def test_a_point_has_the_same_digits_in_the_map_as_beside_its_error():
    """The least and the largest value of a plane under a bright lamp, 20 times that of the other tests."""
    scene = downlight()
    bright = replace(scene, lights=(scene.lights[0]._replace(intensity=(2e4,) * 3),))
    light, level = measured(bright, rectangle((-1.5, -1.0), (1.5, 1.0), 1.75, (3, 3)), (-2, -1.5, 0), (2, 1.5, 2))
    for given in (light, light._replace(errors=np.linspace(0.2, 30, 9)), light._replace(errors=np.full(9, 1e-4))):
        lines = text_lines([], [given], level, PHOTOMETRIC)
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

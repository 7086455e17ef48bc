"""Vertices inside other objects are drawn like their visible neighbours, and no light leaks."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from gi_core.display.dilation import NONE_UNREACHED, WEIGHT, dilated
from gi_core.scene import Pose
from gi_core.scene.types import Mobile, Scene
from gi_core.solver import Solver
from tests.support.control_scenes import two_rooms
from tests.support.scene_builders import box, box_mobile, floor, grey, lamp, merge, quad, solve

LOW, HIGH = (-0.32, -0.28, 0.0), (0.22, 0.33, 0.5)  # of the box; between the lines of the floor's grid


def standing(two_sided: bool = False, height: float = 0.5, mobiles=()) -> Scene:
    """A box on a floor under a wide lamp."""
    lamp_above = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), (1, 1), 1)
    mesh = merge(floor(2.0, 20), lamp_above, box(LOW, (*HIGH[:2], height), 4, 2))
    return Scene(mesh, (grey(0.5), lamp(5.0), grey(0.5, two_sided)), tuple(mobiles), up=(0.0, 0.0, 1.0), name="box")


def solved(scene: Scene, photons: int = 300_000, **more) -> Solver:
    return solve(scene, photons=photons, radius=0.04, **more)


def inside(solver: Solver) -> tuple[np.ndarray, np.ndarray]:
    """Return which receivers the box covers, of the floor, and which are of the floor."""
    p, on_floor = solver.receivers.positions, np.zeros(len(solver.irradiance), bool)
    on_floor[solver.surfaces.corner_front[: 2 * 20 * 20]] = True  # the floor comes first
    return on_floor & (p[:, :2] > LOW[:2]).all(axis=1) & (p[:, :2] < HIGH[:2]).all(axis=1), on_floor


@pytest.mark.parametrize("two_sided", [False, True])
def test_floor_under_a_box_looks_like_the_floor_beside_it(two_sided):
    # The inside of a two-sided object may be visible: only a narrow one counts as closed.
    solver = solved(standing(two_sided, 0.03 if two_sided else 0.5))
    E, seen = solver.irradiance, solver.drawn(solver.irradiance).irradiance
    covered, on_floor = inside(solver)
    rim = np.zeros(len(E), bool)  # covered, and a corner of a face that is not covered altogether
    faces = solver.surfaces.corner_front[solver.surfaces.face_range(0)]
    mixed = faces[covered[faces].any(axis=1) & (on_floor & ~covered)[faces].any(axis=1)]
    rim[mixed[covered[mixed]]] = True
    assert rim.sum() > 15 and np.median(E[covered]) == 0
    beside = np.median(E[np.unique(mixed[~covered[mixed]]), 1])
    assert (seen[rim, 1] > 0.5 * beside).all() and (seen[rim, 1] < 1.5 * beside).all()
    assert (seen[covered & ~rim] < 0.05 * beside).all()
    open_floor = on_floor & ~covered
    assert np.array_equal(seen[open_floor], E[open_floor])


def test_each_is_the_mean_of_its_visible_neighbours():
    solver = solved(standing())
    E, seen = solver.irradiance, solver.drawn(solver.irradiance).irradiance
    changed = np.flatnonzero((E != seen).any(axis=1))
    faces = solver.surfaces.corner_front[solver.surfaces.face_range(0)]
    for r in changed[:10]:
        round_it = faces[(faces == r).any(axis=1)].reshape(-1)
        lit = round_it[(round_it != r) & (E[round_it] > 0).any(axis=1)]
        assert np.allclose(seen[r], E[lit].mean(axis=0), rtol=1e-12)


def test_unreached_receivers_have_almost_no_weight():
    solver = solved(standing())
    seen = solver.drawn(solver.irradiance)
    covered, on_floor = inside(solver)
    rows = solver.frame_light.unreached.static.rows
    assert covered[rows].all() and (seen.weights[rows] == np.float32(WEIGHT)).all()
    faces = solver.surfaces.corner_front[: 2 * 20 * 20]
    deep = faces[np.isin(faces, rows).any(axis=1)]
    deep = np.unique(deep[~np.isin(deep, rows) & covered[deep]])
    assert len(deep) > 3 and np.allclose(seen.weights[deep], WEIGHT * WEIGHT)
    assert (seen.weights[on_floor & ~covered] == 1).all()


def test_wall_between_lit_and_dark_floor_leaks_neither():
    """A solid wall, 14 cm thick, on the middle line of a floor; the lamp is on one side, below the wall's top.

    The line of receivers in the wall has lit neighbours on one side and merely dark ones on the other.
    """
    wall = box((-0.07, -1.1, 0.0), (0.07, 1.1, 1.2), 4, 2)
    mesh = merge(floor(2.0, 20), quad((0.3, -1, 1), (0, 2, 0), (0.7, 0, 0), (1, 1), 1), wall)
    solver = solved(Scene(mesh, (grey(0.5), lamp(5.0), grey(0.5)), up=(0.0, 0.0, 1.0), name="wall"))
    shown = solver.drawn(solver.irradiance)
    faces = solver.surfaces.corner_front[: 2 * 20 * 20]
    x, y = solver.receivers.positions[faces][..., :2].transpose(2, 0, 1)
    means = {}
    for side in (1, -1):
        beside = (
            (np.sort(np.abs(x), axis=1)[:, 0] < 1e-6) & (side * x.sum(axis=1) > 0.05) & (np.abs(y) < 0.8).all(axis=1)
        )
        corners = faces[beside]
        far = np.abs(x[beside]) > 0.05
        # At the point where the triangle leaves the wall, after 0.08 of its 0.1 m: weights of its corners there.
        place = np.where(far, 0.8 / far.sum(axis=1, keepdims=True), 0.2 / (~far).sum(axis=1, keepdims=True))
        weights = place * shown.weights[corners]
        found = (weights * shown.irradiance[corners, 1]).sum(axis=1) / weights.sum(axis=1)
        outside = (far * shown.irradiance[corners, 1]).sum(axis=1) / far.sum(axis=1)
        assert beside.sum() > 20
        assert side < 0 or ((found > 0.98 * outside).all() and outside.min() > 0.1)
        means[side] = found.mean()
    assert means[-1] < 1e-3 * means[1]


@pytest.mark.parametrize("sunk", [0.02, -0.02])
def test_foot_of_a_sunken_box_does_not_darken_its_sides(sunk):
    """The floor is a sheet, so the sunk corners are visible from below it; sides are two cells tall."""
    lamp_above = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), (1, 1), 1)
    mesh = merge(floor(2.0, 20), lamp_above, box((*LOW[:2], -sunk), (*HIGH[:2], 0.3), 2, 2))
    solver = solved(Scene(mesh, (grey(0.5), lamp(5.0), grey(0.5)), up=(0.0, 0.0, 1.0), name="box"))
    p, n = solver.receivers.positions, solver.receivers.normals
    foot = (p[:, 2] == -sunk) & (np.abs(n[:, 2]) < 0.5)
    seen = solver.drawn(solver.irradiance)
    assert foot.sum() == 12
    if sunk > 0:
        assert not solver.irradiance[foot].any()
        assert (seen.weights[foot] == np.float32(WEIGHT)).all() and (seen.irradiance[foot, 1] > 0.1).all()
    else:  # it floats: its foot is visible
        assert seen.weights is None or (seen.weights[foot] == 1).all()


def test_inside_of_a_wide_two_sided_object_is_unchanged():
    solver = solved(standing(two_sided=True))
    assert solver.drawn(solver.irradiance).irradiance is solver.irradiance


def test_lit_inside_is_unchanged():
    scene = standing()
    bulb = box((-0.2, -0.15, 0.3), (0.1, 0.2, 0.4), 1, 1)
    solver = solved(replace(scene, static=merge(scene.static, bulb)))
    covered, _ = inside(solver)
    assert (solver.irradiance[covered] > 0).any(axis=1).all()
    assert np.array_equal(solver.drawn(solver.irradiance).irradiance[covered], solver.irradiance[covered])


def test_dilation_stays_in_its_room():
    case = two_rooms()
    solver = solve(case.scene, photons=200_000, radius=case.radius)
    p, n = solver.receivers.positions, solver.receivers.normals
    dark = case.affected(p, n)
    assert dark.sum() > 20 and not solver.irradiance[dark].any()
    assert not solver.drawn(solver.irradiance).irradiance[dark].any()


def test_fully_lit_scene_is_not_dilated():
    lit_floor = Scene(
        merge(floor(), quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), (1, 1), 1)), (grey(0.5), lamp(5.0)), up=(0.0, 0.0, 1.0)
    )
    solver = solved(lit_floor)
    assert solver.drawn(solver.irradiance).irradiance is solver.irradiance
    E = np.ones((3, 3))
    assert dilated(E, NONE_UNREACHED).irradiance is E and dilated(E, NONE_UNREACHED).weights is None


def test_moves_change_dilated_colours_but_not_dilated_vertices():
    solver = solved(standing(mobiles=(box_mobile(size=0.3),)))
    filled = solver.frame_light.unreached.static
    at_rest = solver.drawn(solver.irradiance).irradiance
    solver.move("box", Pose((0.4, 0.0, 0.2)))  # its shadow falls beside the box
    moved = solver.drawn(solver.irradiance).irradiance
    assert solver.frame_light.unreached.static is filled
    assert (moved[filled.rows] != at_rest[filled.rows]).any()
    total = np.add.reduceat(solver.irradiance[filled.neighbours], filled.first[:-1])
    assert np.array_equal(moved[filled.rows], total / np.diff(filled.first)[:, None])


def test_floor_under_a_mobile_looks_like_the_floor_beside_it():
    mobile = box_mobile(size=0.34)
    scene = Scene(
        merge(floor(2.0, 20), quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), (1, 1), 1)), (grey(0.5), lamp(5.0)),
        (mobile,), up=(0.0, 0.0, 1.0),
    )  # fmt: skip
    solver = solved(scene)
    p = solver.receivers.positions
    on_floor = np.zeros(len(p), bool)
    on_floor[solver.surfaces.corner_front[: 2 * 20 * 20]] = True
    for x in (0.0, 0.43):
        solver.move("box", Pose((x, 0.02, 0.17)))
        E, seen = solver.irradiance, solver.drawn(solver.irradiance).irradiance
        covered = on_floor & (np.abs(p[:, 0] - x) < 0.17) & (np.abs(p[:, 1] - 0.02) < 0.17)
        beside = np.median(E[on_floor & ~covered & (np.abs(p[:, 0] - x) < 0.3) & (np.abs(p[:, 1]) < 0.3), 1])
        assert covered.sum() >= 9 and (E[covered, 1] < 0.1 * beside).all()
        assert np.median(seen[covered, 1]) > 0.5 * beside
        assert np.array_equal(seen[on_floor & ~covered], E[on_floor & ~covered])
    solver.move("box", Pose((0.0, 0.0, 0.6)))  # in the air
    assert solver.drawn(solver.irradiance).irradiance is solver.irradiance
    there = {"box": Pose((0.0, 0.02, 0.17))}
    assert np.array_equal(solver.drawn(solver.irradiance, there).irradiance, solver.irradiance)  # lit: nothing is black


def test_a_box_in_the_grid_of_the_floor_has_no_dark_rim_at_rest():
    """Receivers on the lines where its sides meet the floor had a sixth of the light beside them."""
    light = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), (1, 1), 1)
    scene = Scene(merge(floor(2.0, 20), light), (grey(0.5), lamp(5.0)), (box_mobile(size=0.4),), up=(0.0, 0.0, 1.0))
    solver = solved(scene, 30_000, light="best")
    solver.move("box", Pose((0.0, 0.0, 0.2)))
    list(solver.gather_pose_steps())
    gathered = solver.frame_light.gathered_at(solver.model.transforms(solver.poses))
    drawn = solver.drawn(solver.irradiance)
    p = solver.receivers.positions
    on_floor = np.isin(np.arange(len(p)), solver.surfaces.corner_front[: 2 * 20 * 20])
    far = np.abs(p[:, :2]).max(axis=1)
    rim = on_floor & (np.abs(far - 0.2) < 1e-6)
    beside = np.median(drawn.irradiance[on_floor & (np.abs(far - 0.3) < 1e-6), 1])
    assert gathered.used.any() and rim.sum() == 16
    assert ((drawn.irradiance[rim, 1] > 0.5 * beside) | (drawn.weights[rim] < 1)).all()


@pytest.mark.parametrize("two_sided", [False, True])
def test_seat_inside_its_own_post_looks_like_the_seat_beside_it(two_sided):
    """A plate of 20 by 20 cells and a post through it, one mobile; the inside of a two-sided object may be visible."""
    seat, post = box((-0.5, -0.5, 0.0), (0.5, 0.5, 0.1), 20, 0), box((0.08, 0.08, 0.02), (0.37, 0.37, 0.7), 4, 0)
    lamp_above = quad((-1, -1, 2), (0, 2, 0), (2, 0, 0), (1, 1), 1)
    chair = Mobile("chair", merge(seat, post), Pose((0.0, 0.0, 0.3)))
    scene = Scene(merge(floor(2.0, 4), lamp_above), (grey(0.5, two_sided), lamp(5.0)), (chair,), up=(0.0, 0.0, 1.0))
    solver = solved(scene)
    rows = solver.surfaces.receiver_range(1)
    p, n = solver.model.object_receivers.positions[rows], solver.model.object_receivers.normals[rows]
    top = (np.abs(p[:, 2] - 0.1) < 1e-6) & (n[:, 2] > 0.9)
    inside = top & (p[:, :2] > 0.09).all(axis=1) & (p[:, :2] < 0.36).all(axis=1)
    away = top & ~((p[:, :2] > 0.0).all(axis=1))
    for x in (0.0, 0.3):
        solver.move("chair", Pose((x, 0.0, 0.3)))
        seen = solver.drawn(solver.irradiance)
        E = solver.irradiance[rows, 1]
        assert inside.sum() == 36 and (E[inside] < 0.1 * np.median(E[away])).all()
        if two_sided:
            assert seen.weights is None or (seen.weights[rows][inside] == 1).all()
        else:
            weights, light = seen.weights[rows], seen.irradiance[rows, 1]
            assert (weights[inside] <= np.float32(WEIGHT)).all() and (weights[away] == 1).all()
            rim = inside & (weights == np.float32(WEIGHT))
            light = light[rim] / np.median(E[away])
            assert rim.sum() == 20 and np.median(light) > 0.5 and light.min() > 0.25, "darker ones by noise alone"


def test_unknown_light_is_dilated_without_a_warning():
    """A reference is nan where no path has been gathered yet."""
    solver = solved(standing(mobiles=(box_mobile(size=0.3),)))
    solver.move("box", Pose((0.4, 0.0, 0.15)))
    E = solver.irradiance.copy()
    E[::3] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shown = solver.drawn(E)
    reached = shown.weights == 1
    assert np.array_equal(shown.irradiance[reached], E[reached], equal_nan=True)


def test_a_leg_is_bright_down_to_the_rug_that_its_foot_is_in():
    """A leg has light at its two ends alone, and the lower one is 1 cm below the top of a rug; lifted, it is not."""
    leg = Mobile("leg", box((-0.03, -0.03, 0.0), (0.03, 0.03, 0.4), 1, 2), Pose((0.05, 0.05, 0.0)))
    rug = box((-0.4, -0.4, 0.0), (0.4, 0.4, 0.02), 8, 2)
    lamp_above = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), (1, 1), 1)
    mesh = merge(floor(2.0, 20), lamp_above, rug)
    scene = Scene(mesh, (grey(0.5), lamp(5.0), grey(0.5)), (leg,), up=(0.0, 0.0, 1.0), name="leg")
    solver = solved(scene)
    own = solver.surfaces.receiver_range(1)
    for height, sunk in ((0.0, True), (0.015, True), (0.3, False), (0.0, True)):
        solver.move("leg", Pose((0.05, 0.05, height)))
        E, seen, p = solver.irradiance[own], solver.drawn(solver.irradiance), solver.receivers.positions[own]
        foot = (p[:, 2] < height + 0.01) & (np.abs(solver.receivers.normals[own][:, 2]) < 0.1)
        top = (p[:, 2] > height + 0.39) & (np.abs(solver.receivers.normals[own][:, 2]) < 0.1)
        if sunk:
            assert foot.sum() == 8 and E[foot].max() < 0.02 * E[top].min()
            assert np.allclose(seen.weights[own][foot], WEIGHT)
            assert seen.irradiance[own][foot].min() > 0.5 * E[top].min()
        else:
            assert np.array_equal(seen.irradiance[own], E) and E[foot].min() > 0
        assert np.array_equal(seen.irradiance[own][top], E[top])

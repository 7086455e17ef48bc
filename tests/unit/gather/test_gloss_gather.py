"""Directions of light at glossy receivers by paths, and frames that take them."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.base.pause import steps
from gi_core.gather.gloss_gather import RAYS, ROUNDS, STAGE, GlossGather
from gi_core.gather.path_ends import in_known_light
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.gloss.cells import as_light
from gi_core.gloss.hemisphere import CELLS, SIDE, cell_of, centres, direction_of, even_light
from gi_core.model import Model
from gi_core.scene.types import Gloss, Material, Mobile, PointLight, Pose, Scene
from gi_core.solver import Solver
from tests.physics.test_gloss import GIVEN, ROOM
from tests.support.scene_builders import box, merge, quad

WALLS = box((0, 0, 0), (1, 1, 1), 3, 0, inward=True)
FLOOR = quad((0.05, 0.05, 0.01), (0.9, 0, 0), (0, 0.9, 0), (4, 4), 1)


def room(*more: Material, lights=(), mobiles=()) -> Scene:
    """Return a room with a satin floor; more: materials of walls, floor, and mobiles."""
    satin = Material("satin", (0.3, 0.3, 0.3), gloss=Gloss(alpha=0.3))
    materials = (more[0], satin, *more[1:])
    return Scene(merge(WALLS, FLOOR), materials, mobiles, lights, up=(0, 0, 1), name="room")


def gathered(model: Model, irradiance: np.ndarray, rounds: int = ROUNDS, seed: int = 3) -> GlossGather:
    at = model.transforms(model.start_poses())
    rows = np.unique(model.surfaces.corner_front[~np.isnan(model.surfaces.lobe[:, 4])])
    lights = model.lights_at(model.emitters.lamps.full())
    g = GlossGather(model, seed, rows, at, lights, in_known_light(model, at, irradiance, 1.0))
    while g.rounds < rounds:
        g.add_round()
    return g


def test_rays_go_through_their_cells():
    middles = (2 * (np.indices((SIDE, SIDE)).reshape(2, -1).T + 0.5) / SIDE) - 1
    found = np.array([direction_of(*square) for square in middles])
    np.testing.assert_allclose(found, centres(), atol=1e-12)
    numbers = np.random.default_rng(1).random((2000, 2))
    for a, b in 2 * numbers - 1:
        assert cell_of(*direction_of(a, b)) == SIDE * int((a + 1) / 2 * SIDE) + int((b + 1) / 2 * SIDE)
    assert RAYS % CELLS == 0


def test_equal_radiance_from_everywhere_is_even_light():
    """Walls of radiance 1 that reflect nothing: every cell has the irradiance of its solid angle."""
    model = Model(room(Material("wall", (0, 0, 0), (1, 1, 1))))
    light = gathered(model, np.ones((len(model.object_receivers.areas), 3))).mean
    total = light[:, :, :3].sum(axis=1)
    np.testing.assert_allclose(total, np.pi, rtol=0.06)
    np.testing.assert_allclose(total.mean(), np.pi, rtol=0.01)
    even, cells = even_light(), as_light(light)
    np.testing.assert_allclose(cells[:, :, :3].mean(axis=0), even[:, :3], atol=0.15 * even[:, 0].max())
    length = np.linalg.norm(cells[:, :, 3:], axis=2)
    assert length.max() < 1 + 1e-6 and length.min() > 0.9


def test_cells_add_up_to_the_irradiance_of_paths():
    """With lamp, delta lights, mirror, gold and mobiles in the room: 4 standard errors of the total, and 1 %."""
    model = Model(ROOM)
    scale = np.random.default_rng(0).random((len(model.object_receivers.areas), 1))
    unknown = np.where(scale > 2, 1.0, 0.0) * np.ones(3)  # black: every path goes on to its end
    light = gathered(model, unknown)
    points, normals = evaluation_points(model.surfaces, model.receivers_at(model.start_poses()))
    E, error = reference_irradiance(ROOM, points[light.rows], normals[light.rows], 512, 9, model=model)
    found = light.mean[:, :, :3].sum(axis=1)
    off, noise = found.sum() - E.sum(), np.sqrt((error**2).sum())
    assert abs(off) < 4 * 1.5 * noise + 0.01 * E.sum(), (found.sum() / E.sum(), noise / E.sum())


def test_threads_and_breaks_leave_the_bits():
    one, two = (Model(ROOM, threads=n) for n in (1, 2))
    irradiance = np.ones((len(one.object_receivers.areas), 3))
    whole, other = gathered(one, irradiance, 2), gathered(two, irradiance, 1)
    assert np.array_equal(gathered(two, irradiance, 2).mean, whole.mean)
    next(steps(other.add_round))  # an unfinished round
    other.add_round()
    assert np.array_equal(other.mean, whole.mean)


def rested(solver: Solver) -> Solver:
    solver.solve()
    for p in solver.gather_steps():
        if p.stage == STAGE and p.picture and not solver.frame_light.lacks_gloss(solver.frame.background):
            break
    return solver


@pytest.mark.slow
def test_frames_take_gathered_directions_and_depend_on_poses_alone():
    solver = rested(Solver(ROOM, **GIVEN, light="best"))
    assert solver.frame_light.is_gathered
    photons = Solver(ROOM, **GIVEN)
    photons.solve()
    begun = solver.frame.gloss
    assert np.abs(begun.resting - photons.frame.gloss.resting)[..., :3].max() > 1e-3
    solver.move("ball", Pose((0.5, 0.5, 0.3)))
    moved = solver.frame.gloss
    assert moved.resting is begun.resting and len(moved.changed)
    total = moved.cells[:, :, :3].sum(axis=1)
    assert np.abs(total[total > 0] - 1).max() < 1e-5 and moved.cells[:, :, :3].min() >= 0
    for _, p in zip(range(400), solver.gather_pose_steps(), strict=False):
        if p.stage != STAGE:
            break
    settled = solver.frame.gloss
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    assert not np.array_equal(settled.directions().cells, moved.directions().cells)
    solver.move("ball", Pose((0.3, 0.7, 0.4)))
    solver.move("ball", Pose((0.5, 0.5, 0.3)))
    assert np.array_equal(solver.frame.gloss.directions().cells, settled.directions().cells)


def test_a_shadow_takes_all_light_of_a_lamp_from_gathered_directions():
    """A black slab between a point light and the floor: no cell keeps light that its photons have all lost."""
    slab = Mobile("slab", box((-0.2, -0.2, 0), (0.2, 0.2, 0.02), 1, 2), Pose((0.5, 0.5, 5.0)))
    black, lamp = Material("black", (0, 0, 0)), PointLight("bulb", (0.45, 0.55, 0.9), (1.0, 1.0, 1.0))
    solver = Solver(
        room(Material("wall", (0, 0, 0)), black, lights=(lamp,), mobiles=(slab,)), photons=30_000, radius=0.1, seed=2
    )
    solver.solve()
    g = gathered(solver.model, 0 * solver.irradiance, 1)
    cells = solver.frame_light.gloss.source.cells(solver.setting.radius)
    assert np.array_equal(g.rows, cells.discs.rows)
    away = cells.evaluate(solver.frame.change, g.mean).directions().cells
    np.testing.assert_array_equal(away[:, :, :3], as_light(g.mean)[:, :, :3])
    solver.move("slab", Pose((0.5, 0.5, 0.4)))
    under = (np.abs(solver.receivers.positions[g.rows, :2] - 0.5) < 0.15).all(axis=1)
    shadow = cells.evaluate(solver.frame.change, g.mean).directions().cells
    assert under.any() and away[under, :, :3].any() and not shadow[under, :, :3].any()

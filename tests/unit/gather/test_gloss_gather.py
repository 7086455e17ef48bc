"""Directions of light at glossy receivers by paths, and frames that take them.

The reference of gloss: closed forms, and the sum of parts against whole paths.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest

from gi_core.base.pause import steps
from gi_core.bsdf.models import lobe
from gi_core.gather import static
from gi_core.gather.gloss_gather import RAYS, STAGE, GlossGather
from gi_core.gather.path_ends import in_known_light, starts
from gi_core.gather.path_tracer import PathTracer
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.surfaces import evaluation_points
from gi_core.gloss.cells import as_light
from gi_core.gloss.hemisphere import CELLS, SIDE, cell_of, direction_of, even_light
from gi_core.gloss.lobe_rays import LobeViews, arriving, draw_lobe, gloss_alone, highlights, without_surface
from gi_core.gloss.sharp import sharp_lobe
from gi_core.model import Model
from gi_core.rays.accelerator import LIFT
from gi_core.scene.types import Gloss, Material, Mobile, PointLight, Pose, Scene
from gi_core.solver import Solver
from tests.physics.test_gloss import GIVEN, ROOM
from tests.support.scene_builders import box, merge, quad, solve, sphere

WALLS = box((0, 0, 0), (1, 1, 1), 3, 0, inward=True)
FLOOR = quad((0.05, 0.05, 0.01), (0.9, 0, 0), (0, 0.9, 0), (4, 4), 1)


def room(*more: Material, lights=(), mobiles=()) -> Scene:
    """Return a room with a satin floor; more: materials of walls, floor, and mobiles."""
    satin = Material("satin", (0.3, 0.3, 0.3), gloss=Gloss(alpha=0.3))
    materials = (more[0], satin, *more[1:])
    return Scene(merge(WALLS, FLOOR), materials, mobiles, lights, up=(0, 0, 1), name="room")


def gathered(model: Model, irradiance: np.ndarray, rounds: int = 4, seed: int = 3) -> GlossGather:
    at = model.transforms(model.start_poses())
    rows = np.unique(model.surfaces.corner_front[~np.isnan(model.surfaces.lobe[:, 4])])
    lights = model.lights_at(model.emitters.lamps.full())
    g = GlossGather(model, seed, rows, at, lights, in_known_light(model, at, irradiance, 1.0))
    while g.rounds < rounds:
        g.add_round()
    return g


def test_rays_go_through_their_cells():
    middles = (2 * (np.indices((SIDE, SIDE)).reshape(2, -1).T + 0.5) / SIDE) - 1
    assert [cell_of(*direction_of(*square)) for square in middles] == list(range(CELLS))
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


def test_a_glossy_mobile_in_a_matte_room_rests(monkeypatch):
    """No static receiver is glossy: the light gathered there has no rows."""
    monkeypatch.setattr(static, "ENOUGH", 0.05)
    satin = Material("satin", (0.3, 0.3, 0.3), gloss=Gloss(alpha=0.3))
    materials = Material("wall", (0.5, 0.5, 0.5)), satin
    ball = Mobile("ball", sphere((0, 0, 0), 0.15, 1, 1), Pose((0.5, 0.5, 0.4)))
    bulb = PointLight("bulb", (0.5, 0.5, 0.9), (1, 1, 1))
    solver = solve(Scene(WALLS, materials, (ball,), (bulb,)), photons=2000, radius=0.1, light="best")
    list(solver.gather_steps())
    assert solver.frame_light.is_gathered
    solver.move("ball", Pose((0.4, 0.5, 0.3)))
    list(solver.gather_pose_steps())
    assert np.isfinite(solver.irradiance).all() and len(solver.frame.gloss.owners)


@pytest.mark.slow
def test_frames_take_gathered_directions_and_depend_on_poses_alone():
    solver = rested(Solver(ROOM, **GIVEN, light="best"))
    assert solver.frame_light.is_gathered
    photons = solve(ROOM, **GIVEN)
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
    solver = solve(
        room(Material("wall", (0, 0, 0)), black, lights=(lamp,), mobiles=(slab,)), photons=30_000, radius=0.1, seed=2
    )
    g = gathered(solver.model, 0 * solver.irradiance, 1)
    cells = solver.frame_light.gloss.source.cells(solver.setting.radius)
    assert np.array_equal(g.rows, cells.discs.rows)
    away = cells.evaluate(solver.frame.change, g.mean).directions().cells
    np.testing.assert_array_equal(away[:, :, :3], as_light(g.mean)[:, :, :3])
    solver.move("slab", Pose((0.5, 0.5, 0.4)))
    under = (np.abs(solver.receivers.positions[g.rows, :2] - 0.5) < 0.15).all(axis=1)
    shadow = cells.evaluate(solver.frame.change, g.mean).directions().cells
    assert under.any() and away[under, :, :3].any() and not shadow[under, :, :3].any()


SATIN = Gloss((0.6, 0.5, 0.3), 0.3, 0.8)
MATERIALS = {
    "GGX": Material("ball", (0.3, 0.2, 0.1), gloss=SATIN),
    "ward": Material("ball", brdf=(lobe("ward", {"kd": 0.2, "ks": 0.4, "ax": 0.2, "ay": 0.3}),), scaled=True),
}


class Views(NamedTuple):
    """Views of n glossy points, in the world."""

    positions: np.ndarray  # (n, 3) [m]
    normals: np.ndarray  # (n, 3) unit, of the lobe
    flat: np.ndarray  # (n, 3) unit, of the face
    tangents: np.ndarray  # (n, 3) unit
    to_eye: np.ndarray  # (n, 3) unit
    face: np.ndarray  # (n,)

    def lobes(self, surfaces, each: int) -> LobeViews:
        """Return each view so many times, with the lobe of its gloss alone."""
        vectors = (np.repeat(a, each, axis=0) for a in (self.to_eye, self.normals, self.tangents))
        of = np.repeat(np.arange(len(self.face)), each)
        return LobeViews.of_lobes(gloss_alone(surfaces.lobe[self.face], surfaces.tables), of, *vectors)


def views_of(model: Model, eye, count: int):
    """Return views of receivers of the first mobile that face an eye (3,), their rows, and the transforms."""
    s, at = model.surfaces, model.transforms(model.start_poses())
    faces = np.arange(s.first_face[1], s.first_face[2])
    rows, first = np.unique(s.corner_front[faces], return_index=True)
    face, turn = faces[first // 3], at.rotation[1].T
    positions, normals = (a[rows] @ turn for a in model.evaluation_points)
    positions = positions + at.position[1]
    tangents = s.tangent[face] @ turn if len(s.tangent) else normals
    to_eye = np.array(eye) - positions
    to_eye /= np.linalg.norm(to_eye, axis=1)[:, None]
    views = Views(positions, normals, s.normals[face] @ turn, tangents, to_eye, face)
    up = np.flatnonzero((to_eye * normals).sum(axis=1) > 0.3)
    some = up[np.linspace(0, len(up) - 1, count).astype(int)]
    return Views(*(a[some] for a in views)), rows[some], at


def reference_gloss(model: Model, at, lights, views: Views, rays: int):
    """Return the radiance (n, 3) of gloss towards the eye, by rays drawn from lobes, and its standard error."""
    n = len(views.face)
    flat, face = np.repeat(views.flat, rays, axis=0), np.repeat(views.face, rays).astype(np.int32)
    d, factors, _ = draw_lobe(views.lobes(model.surfaces, rays), np.random.default_rng(1).random((n * rays, 3)))
    factors[(d * flat).sum(axis=1) <= 0] = 0.0  # none from below the face
    positions, normals = (np.repeat(a, rays, axis=0) for a in (views.positions, views.normals))
    ends = starts(np.arange(n * rays), np.arange(n * rays), positions, normals)
    # A mirror's density: no ray to a lamp competes.
    ends = ends._replace(throughput=factors, face=face, density=-np.ones(n * rays))
    total = np.zeros((n * rays, lights.channels))
    PathTracer(model, at, lights, 1).follow(ends, total, d.astype(np.float32))
    L = total.reshape(n, rays, -1)[..., :3] / math.pi
    mean, error, delta = L.mean(axis=1), L.std(axis=1, ddof=1) / math.sqrt(rays), without_surface(lights)
    if len(delta.kind):
        lift = LIFT * np.abs(views.positions).max(axis=1)
        light = arriving(model.accelerator, at, views.positions, views.flat, lift, delta, model.world.size)
        light.strength[(light.direction * views.flat[:, None]).sum(axis=2) <= 0] = 0.0
        mean += highlights(views.lobes(model.surfaces, 1), light, delta.value)
    return mean, error


@pytest.mark.parametrize("name", MATERIALS)
def test_in_a_furnace_gloss_has_the_radiance_of_its_albedo(name):
    """Black walls of radiance 0.5: a ball reflects 0.5 times the directional albedo of its gloss."""
    materials = (Material("wall", (0, 0, 0), (0.5, 0.5, 0.5)), MATERIALS[name]._replace(name="ball"))
    ball = Mobile("ball", sphere((0, 0, 0), 0.3, 3, 1))
    model = Model(Scene(box((-1, -1, -1), (1, 1, 1), 2, 0, inward=True), materials, (ball,), name="furnace"))
    views, _, at = views_of(model, (0, -0.9, 0), 12)
    lights = model.lights_at(model.emitters.lamps.full())
    mean, error = reference_gloss(model, at, lights, views, 512)
    s = model.surfaces
    numbers = np.random.default_rng(3).random((12 * 4096, 3))
    albedo = draw_lobe(views.lobes(s, 4096), numbers)[1].reshape(-1, 4096, 3).mean(axis=1)
    np.testing.assert_allclose(mean, 0.5 * albedo, atol=4 * error.max(), rtol=0.01)
    assert error.max() < 0.02 * mean.max()
    assert sharp_lobe(s.lobe[views.face[0]], s.tables) is None, "cells carry it"


def test_gloss_and_diffuse_light_together_are_the_light_of_whole_paths():
    """Paths that begin at the ball with all of its material, a lamp, a light without a surface and two bounces."""
    materials = (
        Material("wall", (0.7, 0.6, 0.5)),
        Material("lamp", (0.5, 0.5, 0.5), (9.0, 8.0, 7.0)),
        MATERIALS["GGX"],
    )
    static = merge(
        box((-1, -1, 0), (1, 1, 2), 3, 0, inward=True), quad((-0.3, -0.3, 1.99), (0, 0.6, 0), (0.6, 0, 0), (2, 2), 1)
    )
    ball = Mobile("ball", sphere((0, 0, 0), 0.3, 3, 2), Pose((0.2, 0.1, 0.7)))
    bulb = PointLight("bulb", (-0.8, -0.8, 1.7), (0.5, 0.5, 2.0))
    scene = Scene(static, materials, (ball,), (bulb,), name="room")
    model = Model(scene)
    views, rows, at = views_of(model, (0.1, -0.9, 1.2), 24)
    lights = model.lights_at(model.emitters.lamps.full())
    gloss, error = reference_gloss(model, at, lights, views, 4096)
    E, error_E = reference_irradiance(scene, views.positions, views.normals, 4096, 2, model=model)
    rho = model.surfaces.reflectance[views.face] / math.pi
    together, noise = gloss + rho * E, error + rho * error_E

    paths, n = 8192, len(rows)
    position, normal, face, to_eye = (
        np.repeat(a, paths, axis=0) for a in (views.positions, views.normals, views.face, views.to_eye)
    )
    ends = starts(np.arange(n * paths), np.arange(n * paths), position, normal)
    ends = ends._replace(face=face.astype(np.int32), arrival=to_eye.copy())
    total = np.zeros((n * paths, lights.channels))
    PathTracer(model, at, lights, 7).follow(ends, total)
    L = total.reshape(n, paths, -1)[..., :3] / math.pi
    mean, error_L = L.mean(axis=1), L.std(axis=1) / math.sqrt(paths)
    off = (together - mean) / np.hypot(noise, error_L)
    assert np.abs(off).max() < 5 and abs(off.mean()) < 0.5
    assert together.sum() == pytest.approx(mean.sum(), rel=0.01)
    assert 0.15 < gloss.sum() / together.sum() < 0.9, "both count"

"""Bright static faces as lamps of mobiles: no bias, less noise, and the bits of frames."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.gather import mobile as mobile_gather
from gi_core.gather.candidates import BRIGHT, LEAST_BRIGHT
from gi_core.gather.mobile import MobileGather
from gi_core.geometry.error import relative_error
from gi_core.model import Model
from gi_core.scene.types import Gloss, Material, Mobile, Pose, Scene
from tests.support.scene_builders import box, box_mobile, grey, merge, quad, solve, sphere, sunny_room
from tests.support.significance import seeds_test

PATHS = 16


def room(screen: bool = False) -> tuple[Model, object, np.ndarray]:
    """Return a room of coloured floor with two mobiles, their poses, and light at rest with a bright spot."""
    walls = merge(
        box((0, 0, 0), (1, 1, 1), 8, 0, inward=True), quad((0.6, 0.5, 0.001), (0.3, 0, 0), (0, 0.3, 0), (6, 6), 1)
    )
    if screen:
        walls = merge(walls, quad((0.55, 0.4, 0), (0, 0.5, 0), (0, 0, 0.25), (3, 3), 2))
    things = box_mobile("box", 0.2), Mobile("ball", sphere((0, 0, 0), 0.1, 2, 0))
    places = (0.3, 0.4, 0.3), (0.6, 0.3, 0.5)
    mobiles = tuple(m._replace(pose=Pose(p)) for m, p in zip(things, places, strict=True))
    materials = Material("wall", (0.6, 0.5, 0.4)), Material("spot", (0.7, 0.5, 0.2)), grey(0.5, two_sided=True)
    model = Model(Scene(walls, materials, mobiles, (), up=(0, 0, 1)), 2)
    light = np.full((model.first_probe, 3), 0.1)
    light[np.unique(model.surfaces.corner_front[: len(walls.faces)][walls.face_material == 1])] = 20.0, 10.0, 5.0
    return model, model.transforms(model.start_poses()), light


def shadowed(model: Model, light: np.ndarray) -> np.ndarray:
    """Return the light of a frame: half of the spot in coloured shadow, noise elsewhere."""
    frame = light * np.random.default_rng(3).uniform(-0.2, 1.0, light.shape)
    far = model.evaluation_points[0][: len(light), 0] > 0.75
    frame[(light[:, 0] > 1) & far] *= 0.3, 0.0, 2.0
    return frame


@pytest.mark.parametrize("screen", [False, True], ids=["open", "behind a screen"])
def test_the_mean_is_that_of_bounces_alone_and_has_less_noise(screen):
    model, at, light = room(screen)
    frame = shadowed(model, light)
    truth = np.mean([MobileGather(model, k).irradiance(at, frame, 4096) for k in range(100, 104)], axis=0)
    found = {
        name: np.array([MobileGather(model, k).irradiance(at, frame, PATHS, resting=of) for k in range(60)])
        for name, of in (("with", light), ("without", None))
    }
    gather = MobileGather(model, 0)
    gather.irradiance(at, frame, PATHS, resting=light)
    assert all(len(gather._lights_of(o, at)[1].face) >= 72 for o in (1, 2))
    areas = np.ones(len(truth))
    seeds_test(found["with"].sum(axis=1) / truth.sum(axis=0), 1.0, "light of all receivers")
    errors = {k: np.mean([relative_error(E, truth, areas).l1 for E in found[k]]) for k in found}
    assert errors["with"] < (0.95 if screen else 0.6) * errors["without"]


def test_light_without_bright_faces_has_the_same_bits():
    model, at, light = room()
    even = np.random.default_rng(0).uniform(1.0, 0.9 * BRIGHT, (len(light), 1)) * np.ones(3)
    few = light.copy()
    few[few[:, 0] < 1] = 20.0 / BRIGHT * 1.01  # nothing is bright enough
    for resting in (even, few, np.zeros_like(light)):
        alone = MobileGather(model, 0).irradiance(at, light, PATHS)
        assert np.array_equal(MobileGather(model, 0).irradiance(at, light, PATHS, resting=resting), alone)


def test_bright_faces_that_bring_little_light_get_no_rays():
    model, at, light = room()
    light[light[:, 0] < 1] = 20.0 / BRIGHT * 0.5 * LEAST_BRIGHT
    gather = MobileGather(model, 0)
    faces = gather._faces
    luminance = faces.luminance(light, model.world.bsdfs.albedo)
    centre, far = np.array([0.3, 0.4, 0.3]), np.array([0.3, 0.4, -5.0])  # a floor is not seen from below
    assert len(faces.bright(luminance, faces.view(centre, 0.1), len(model.surfaces.areas)).face) > 0
    assert len(faces.bright(luminance, faces.view(far, 0.1), len(model.surfaces.areas)).face) == 0


def test_light_of_single_bounces_stays_whole_for_gloss():
    model, at, light = room()
    scene = model.scene
    shiny = replace(scene, materials=tuple(m._replace(gloss=Gloss(alpha=0.3)) for m in scene.materials))
    model = Model(shiny, 2)
    found = []
    for resting in (light, None):
        gather = MobileGather(model, 0)
        gather.irradiance(at, light, PATHS, resting=resting)
        found.append(gather.path_light.bounced.light.copy())
    assert found[0].max() > 1 and np.allclose(found[0].sum(), found[1].sum(), rtol=0.05)


def test_frames_equal_those_from_scratch_and_of_a_new_solver():
    """Mobiles move, rest and return in a sunlit room; light at rest changes in between."""
    solver = solve(sunny_room(0.6), photons=8192, radius=0.4, seed=2, light="best")
    pose, seen = solver.poses["box"], []
    for k, (x, paths, photons) in enumerate(((0.0, 8, None), (0.3, 8, 4096), (0.3, 16, None), (0.0, 8, None))):
        if k == 2:
            solver.configure(photons=16384)
            solver.solve()
        place = pose._replace(position=(pose.position[0] + x, *pose.position[1:]))
        solver.move_all({"box": place}, photons, paths)
        seen.append(
            len(solver.frame_light.mobiles._gather._lights_of(1, solver.model.transforms(solver.poses))[1].face)
        )
        if photons is None:
            assert np.array_equal(solver.irradiance, solver.from_scratch())
    assert min(seen) > 0
    other = solve(sunny_room(0.6), photons=16384, radius=0.4, seed=2, threads=1, light="best")
    other.move_all({"box": solver.poses["box"]}, None, 8)
    assert np.array_equal(other.irradiance, solver.irradiance)


def test_cached_rays_follow_the_light_of_the_frame(monkeypatch):
    model, at, light = room()
    gather, frame = MobileGather(model, 4), shadowed(model, light)
    traced, real = [], mobile_gather.rays_to_candidates
    monkeypatch.setattr(mobile_gather, "rays_to_candidates", lambda *a: traced.append(0) or real(*a))
    gather.irradiance(at, light, PATHS, resting=light)
    before = len(traced)
    found = gather.irradiance(at, frame, PATHS, resting=light)
    assert len(traced) == before > 0
    assert np.array_equal(found, MobileGather(model, 4).irradiance(at, frame, PATHS, resting=light))
    brighter = 2 * light
    found = gather.irradiance(at, frame, PATHS, resting=brighter)
    assert len(traced) > before
    assert np.array_equal(found, MobileGather(model, 4).irradiance(at, frame, PATHS, resting=brighter))

"""Gathered light of mobiles: closed forms, the reference, and the bits of whole frames."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gi_core.estimators import ESTIMATORS
from gi_core.frames.frame_light import FrameLight
from gi_core.gather import hit_cache
from gi_core.gather import mobile as mobile_gather
from gi_core.gather.hit_cache import BounceRays
from gi_core.gather.mobile import MobileGather
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import relative_error
from gi_core.geometry.surfaces import evaluation_points
from gi_core.model import Model
from gi_core.rays.accelerator import FAR
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Mobile, PointLight, Pose, Scene
from gi_core.solver import Solver
from tests.physics.test_invariants import AWAY, SCENE, fresh, moves, solved
from tests.support.scene_builders import box, box_mobile, fine_room, grey, lamp, merge, quad, sphere

GATHERED = {"light": "best"}


def gathering(poses=None, **setting) -> Solver:
    solver = fresh(**setting)
    solver.configure(**GATHERED)
    solver.solve()
    if poses:
        solver.move_all(poses)
    return solver


def at_start(scene: Scene, threads: int = 2) -> tuple[Model, object]:
    model = Model(scene, threads)
    return model, model.transforms(model.start_poses())


@pytest.mark.parametrize("paths", [1, 8, 24, 4096])
def test_convex_mobile_between_uniform_walls_has_rho_times_their_light(paths):
    """Paths of every direction end on a wall, so there is no noise."""
    walls = box((0, 0, 0), (1, 1, 1), 3, 0, inward=True)
    thing = box_mobile("box", 0.2, 1)._replace(pose=Pose((0.4, 0.5, 0.6), (0.8, 0.6, 0.0, 0.0)))
    model, at = at_start(Scene(walls, (grey(0.7), grey(0.2)), (thing,), up=(0, 0, 1)))
    static = np.broadcast_to([1.0, 2.0, 4.0], (model.first_probe, 3))
    found = MobileGather(model, 3).irradiance(at, static, paths)
    assert len(found) > 20 and np.allclose(found, [0.7, 1.4, 2.8], rtol=1e-12)


def test_inside_a_hollow_mobile_light_goes_to_and_fro():
    """A bulb in the middle of a sphere of radius r: E = (flux / 4 pi r2) / (1 - rho), and outside there is none."""
    rho, radius = 0.8, 0.3
    hull = sphere((0, 0, 0), radius, 3, 1)
    hollow = Mobile("hull", hull._replace(faces=hull.faces[:, ::-1]), Pose((0.5, 0.5, 0.5)))
    bulb = PointLight("bulb", (0.5, 0.5, 0.5), (3.0, 3.0, 6.0))
    walls = box((0, 0, 0), (1, 1, 1), 2, 0, inward=True)
    model, at = at_start(Scene(walls, (grey(0.5), grey(rho)), (hollow,), (bulb,), up=(0, 0, 1)))
    found = MobileGather(model, 0).irradiance(at, np.zeros((model.first_probe, 3)), 64)
    expected = np.array([3.0, 3.0, 6.0]) / (4 * np.pi * radius**2) / (1 - rho)
    assert np.allclose(found.mean(axis=0), expected, rtol=0.02)  # facets are nearer than the sphere
    assert np.allclose(found, expected, rtol=0.08)


@pytest.mark.slow
def test_mobile_gather_equals_the_reference():
    """Walls have many receivers, so that interpolation between them is accurate; two objects, side by side."""
    places = {0.25: (0.4, 0.5, 0.3), 0.15: (0.62, 0.5, 0.35)}
    things = [box_mobile(f"of {size}", size)._replace(pose=Pose(at)) for size, at in places.items()]
    scene = fine_room(tuple(things))
    model, at = at_start(scene)
    receivers = model.receivers_at(model.start_poses())
    points, normals = evaluation_points(model.surfaces, receivers)
    gather = MobileGather(model, 0)
    truth, error = reference_irradiance(scene, points, normals, 700, 5, model=model)
    first = gather.first
    areas = receivers.areas[first:]
    few, many = (relative_error(gather.irradiance(at, truth[:first], n), truth[first:], areas).l1 for n in (2, 512))
    noise = relative_error(truth[first:] + error[first:], truth[first:], areas).l1
    assert noise < 0.03 and many < 0.04
    assert few > 2 * many
    total, expected = gather.irradiance(at, truth[:first], 512).sum(axis=0), truth[first:].sum(axis=0)
    assert np.allclose(total, expected, rtol=0.02)


def test_corners_inside_other_parts_do_not_darken_what_a_mobile_sees_of_itself():
    """A white tunnel whose boards have half of their corners inside blocks at both ends, with a slit of light above."""
    boards = [box((-0.3, y, -0.1), (0.3, y + 0.02, 0.1), 3) for y in (-0.1, 0.08)]
    blocks = [box((x, -0.15, -0.15), (x + 0.18, 0.15, 0.15), 2) for x in (-0.33, 0.15)]
    thing = Mobile("tunnel", merge(*boards, *blocks), Pose((0.5, 0.5, 0.5)))
    thing = thing._replace(mesh=thing.mesh._replace(face_material=np.full(len(thing.mesh.faces), 1, np.int32)))
    walls = box((0, 0, 0), (1, 1, 1), 2, 0, inward=True)
    bulb = PointLight("p", (0.5, 0.5, 0.9), (1.0, 1.0, 1.0))
    scene = Scene(walls, (grey(0.0), grey(0.9)), (thing,), (bulb,), up=(0, 0, 1))
    model, at = at_start(scene)
    points, normals = evaluation_points(model.surfaces, model.receivers_at(model.start_poses()))
    gather = MobileGather(model, 0)
    points, normals = points[gather.first :], normals[gather.first :]
    within = (np.abs(points[:, 0] - 0.5) < 0.14) & (np.abs(points[:, 1] - 0.5) < 0.09) & (np.abs(normals[:, 1]) > 0.9)
    truth, _ = reference_irradiance(scene, points[within], normals[within], 1000, 5, model=model)
    found = gather.irradiance(at, np.zeros((model.first_probe, 3)), 256)[within]
    assert within.sum() > 6 and found.sum() == pytest.approx(truth.sum(), rel=0.03)


@settings(max_examples=10)
@given(st.lists(moves, min_size=1, max_size=4), st.sampled_from(list(ESTIMATORS)))
@pytest.mark.slow
def test_any_history_equals_from_scratch_and_a_fresh_solver(history, estimator):
    solver = gathering(estimator=estimator)
    for name, pose in history:
        solver.move(name, pose)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    assert np.array_equal(solver.irradiance, gathering(solver.poses, estimator=estimator, threads=5).irradiance)
    first, before = solver.surfaces.receiver_range(0).stop, solver.irradiance
    solver.move_all({}, None, 4)
    assert np.array_equal(solver.irradiance[:first], before[:first]), "the static part does not contain it"
    assert not before[first:].any() or not np.array_equal(solver.irradiance, before)


def test_a_frame_of_fewer_photons_and_paths():
    solver = Solver(SCENE, photons=10_000, radius=0.2)
    solver.configure(**GATHERED)
    solver.solve()
    assert solver.frame.paths == solver.paths_at_rest == 64
    first, whole = solver.surfaces.receiver_range(0).stop, solver.irradiance
    solver.move_all({}, None, 8)
    assert solver.frame.paths == 8 and np.array_equal(solver.irradiance[:first], whole[:first])
    assert not np.array_equal(solver.irradiance[first:], whole[first:])
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    solver.move_all({}, solver.frame.subsets[0], 4)
    assert (solver.frame.photons, solver.frame.paths) == (solver.frame.subsets[0], 4)
    list(solver.solve_steps())
    assert np.array_equal(solver.irradiance, whole), "at rest all there is"
    assert solver.size_within(0.0)[1] == 4 and solver.size_within(100.0) == (10_000, 256)


def test_a_switch_is_shown_without_a_move_and_traces_nothing():
    solver = solved()
    by_photons, segments = solver.irradiance, solver.frame.segments
    solver.configure(**GATHERED)
    solver.solve()
    assert solver.light == "best" and not np.array_equal(solver.irradiance, by_photons)
    assert solver.frame.segments == segments and np.array_equal(solver.irradiance, gathering().irradiance)
    solver.configure(light="photons")
    solver.solve()
    assert np.array_equal(solver.irradiance, by_photons) and solver.paths_at_rest == 0


def test_mobile_far_from_all_light_is_black():
    solver = gathering({"box": AWAY, "ball": AWAY})
    first = solver.surfaces.receiver_range(0).stop
    lit = Solver(replace(SCENE, lights=(), mobiles=SCENE.mobiles[:1]), photons=300, radius=0.2)
    assert solver.irradiance[first:].max() < 1e-2 * solver.irradiance[:first].max()
    lit.configure(**GATHERED)
    lit.solve()
    lit.move("box", AWAY)
    assert not lit.irradiance[lit.surfaces.receiver_range(0).stop :].any(), "a closed room's lamp faces inward"


def test_without_photons_or_mobiles_there_is_nothing_to_gather():
    none = gathering(photons=0)
    assert not none.irradiance.any() and none.frame.paths == 0
    still = Solver(replace(SCENE, mobiles=()), photons=300, radius=0.2)
    still.configure(**GATHERED)
    still.solve()
    assert still.frame.paths == still.paths_at_rest == 0 and still.size_within(1.0)[1] is None


def test_unknown_light_and_path_counts_are_refused():
    solver = gathering()
    with pytest.raises(SceneError, match="light must be one of best, photons, got 'baked'"):
        solver.configure(light="baked")
    before, poses = solver.irradiance, dict(solver.poses)
    with pytest.raises(SceneError, match="paths per receiver and frame must be one of 4, 6, 8, 10, 12, .*, 256, got 5"):
        solver.move_all({"box": AWAY}, None, 5)
    assert solver.irradiance is before and solver.poses == poses


def three_things() -> Scene:
    """Two boxes and a ball in a room with an area lamp and two lamps without size."""
    places = {0.25: (0.3, 0.5, 0.3), 0.15: (0.62, 0.5, 0.35), 0.1: (0.5, 0.3, 0.6)}
    things = [box_mobile(f"of {size}", size)._replace(pose=Pose(at)) for size, at in places.items()]
    walls = merge(
        box((0, 0, 0), (1, 1, 1), 3, 0, inward=True), quad((0.4, 0.4, 0.95), (0, 0.3, 0), (0.2, 0, 0), (2, 2), 1)
    )
    bulbs = PointLight("p", (0.2, 0.8, 0.4), (1.0, 2.0, 0.5)), PointLight("q", (0.8, 0.2, 0.8), (2.0, 1.0, 0.5))
    return Scene(walls, (grey(0.6), lamp(8.0, 0.5)), tuple(things), bulbs, up=(0, 0, 1))


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 2), st.integers(0, 3), st.sampled_from([1, 4, 6, 8]), st.booleans(), st.integers(0, 12)
        ),
        min_size=2,
        max_size=6,
    )
)
def test_cached_hits_equal_those_of_an_empty_cache(history):
    """Mobiles that rest, return, overlap; alternating numbers of paths; changing static light; other threads.

    Some rays are traced ahead.
    """
    scene = three_things()
    model, poses = Model(scene, 2), {m.name: m.pose for m in scene.mobiles}
    gather = MobileGather(model, 4)
    light = np.random.default_rng(0).random((model.first_probe, 3))
    for thing, step, paths, brighter, ahead in history:
        mobile = scene.mobiles[thing]
        x, y, z = mobile.pose.position
        poses[mobile.name] = Pose((x, y + 0.1 * step, z - 0.05 * step), (0.8, 0.6, 0.0, 0.0))
        static = (2.0 if brighter else 1.0) * light
        at = model.transforms(poses)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(mobile_gather, "RAYS_AHEAD", 100)
            for call in gather.rays_ahead(at, paths)[:ahead]:
                call()
        uncached = MobileGather(Model(scene, 3), 4).irradiance(at, static, paths)
        assert np.array_equal(gather.irradiance(at, static, paths), uncached)


@pytest.mark.parametrize("places", [{}, {"of 0.1": (0.62, 0.5, 0.6)}, {"of 0.1": (0.5, 0.5, 9.0)}])
def test_bounces_meet_what_rays_in_the_world_meet(places):
    """Near, touching and far mobiles, turned: rays that pass a mobile by are left out, and no other."""
    scene = three_things()
    model = Model(scene, 1)
    turned = [(0.8, 0.6, 0.0, 0.0), (0.6, 0.0, 0.8, 0.0), (0.0, 0.6, 0.0, 0.8)]
    own = zip(scene.mobiles, turned, strict=True)
    at = model.transforms({m.name: Pose(places.get(m.name, m.pose.position), turn) for m, turn in own})
    rng, far = np.random.default_rng(0), FAR * model.world.size
    for o in range(1, 4):
        towards, directions = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 20_000, 3)))
        radius = model.world.sphere_radius[o] * 1.01
        origins = (model.world.sphere_centre[o] + radius * towards).astype(np.float32)
        directions = directions.astype(np.float32)
        distance, face = BounceRays(model, o, origins, directions).nearest(at)
        R, limits = at.rotation[o], np.full(len(origins), far)
        expected = nearest_in_world(model.accelerator, at, origins @ R.T + at.position[o], directions @ R.T, limits)
        assert len(np.unique(model.world.face_object[face[face >= 0]])) >= (3 if not places else 1)
        same = face == expected[1]
        assert same.mean() > 0.999  # the others graze an edge
        assert np.allclose(distance[same], expected[0][same], rtol=1e-4, atol=1e-5)


def test_a_batch_may_have_no_rays():
    model, at = at_start(three_things())
    none = np.empty((0, 3), np.float32)
    rays = BounceRays(model, 1, none, none)
    assert rays.left(at) == 0 and [len(a) for a in rays.nearest(at)] == [0, 0]
    alone, there = at_start(replace(three_things(), mobiles=three_things().mobiles[:1]))
    assert [len(a) for a in BounceRays(alone, 1, none, none).nearest(there)] == [0, 0]


def test_batches_beyond_the_cache_limit_are_recomputed_with_equal_bits(monkeypatch):
    model, at = at_start(three_things())
    static = np.ones((model.first_probe, 3))
    keeping = MobileGather(model, 0)
    expected = [keeping.irradiance(at, static, n) for n in (4, 16, 4)]
    monkeypatch.setattr(mobile_gather, "CACHED_PATHS", 8 * len(expected[0]))
    frugal = MobileGather(model, 0)
    assert all(np.array_equal(frugal.irradiance(at, static, n), e) for n, e in zip((4, 16, 4), expected, strict=True))
    assert sum(batch is not None for batches in frugal._batches.values() for batch in batches) <= len(frugal._places(4))


def test_rays_of_a_resting_mobile_are_not_traced_again(monkeypatch):
    """Nor are rays of any mobile traced through itself."""
    scene = three_things()
    model, poses = Model(scene, 1), {m.name: m.pose for m in scene.mobiles}
    gather, static = MobileGather(model, 0), np.ones((model.first_probe, 3))
    gather.irradiance(model.transforms(poses), static, 8)
    traced, real = [], hit_cache._nearest_static
    monkeypatch.setattr(hit_cache, "_nearest_static", lambda *a: traced.append((a[3], len(a[4]))) or real(*a))
    monkeypatch.setattr(model.accelerator, "nearest", lambda *_: pytest.fail("traced through the mobile itself"))
    gather.irradiance(model.transforms(poses), static, 8)
    assert not traced and not gather.rays_ahead(model.transforms(poses), 8)
    moved = scene.mobiles[2]
    x, y, z = moved.pose.position
    gather.irradiance(model.transforms(poses | {moved.name: Pose((x, y, z + 0.05))}), static, 8)
    last = model.surfaces.receiver_range(3)
    bounces = gather._bounces(8)[last.start - gather.first : last.stop - gather.first]
    assert traced == [(3, bounces.sum())] and 0 < bounces.sum() <= 8 * len(bounces)


def test_frames_at_rest_are_not_timed_as_motion():
    model, at = at_start(three_things())
    light, elsewhere = FrameLight(model, 0), at._replace(position=at.position + 0.01)
    irradiance = np.ones((len(model.object_receivers.areas), 3))
    light.setting.choose("best", False)
    for poses, traced in ((at, True), (at, False), (elsewhere, True), (elsewhere, False)):
        light.mobiles.replace_in(irradiance, poses, irradiance, 8, light.setting.levels)
        assert light.mobiles.rays_traced is traced
    light.mobiles.replace_in(irradiance, elsewhere, irradiance, 16, light.setting.levels)
    assert light.mobiles.rays_traced, "of other paths"


NOTHING_IS_COMPILED = """
import sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from gi_core.gather import candidates, path_ends, hit_cache, mobile, interleaved_mean
from gi_core.lights import area, next_event
from gi_core.instruments import compile_ahead
from gi_core.model import Model

from tests.unit.gather.test_mobile import three_things

compile_ahead._gather(compile_ahead._tiny_scene(), None)
modules = candidates, path_ends, hit_cache, area, mobile
modules += interleaved_mean, next_event
kernels = [f for module in modules for f in vars(module).values() if isinstance(f, Dispatcher)]
before = [len(f.signatures) for f in kernels]
scene = three_things()
model, poses = Model(scene, 2), {m.name: m.pose for m in scene.mobiles}
gather, static = mobile.MobileGather(model, 0), np.ones((model.first_probe, 3))
for k in range(3):
    poses["of 0.1"] = poses["of 0.1"]._replace(position=(0.3, 0.5, 0.6 - 0.05 * k))
    bright = static.copy()
    bright[model.surfaces.corner_front[:2]] = 1000.0
    gather.irradiance(model.transforms(poses), static, 8, resting=bright)
assert max(len(gather._lights_of(o, model.transforms(poses))[1].face) for o in (1, 2, 3))
assert before == [len(f.signatures) for f in kernels], "a kernel was compiled after the warm-up"
"""


@pytest.mark.slow
def test_warm_up_compiles_gathering_of_adjacent_mobiles():
    """In a separate process, because other tests have compiled everything in this one."""
    subprocess.run([sys.executable, "-c", NOTHING_IS_COMPILED], cwd=Path(__file__).parents[3], check=True)

"""The invariants: a frame is a function of the poses alone, bit for bit.

One room, two mobiles that touch the floor, cross the walls and each other. After any sequence of moves, irradiance
equals that of a new solver at these poses, and of the naive twin. Every disc search in whole frames, on any number of
threads, against the naive twin, and at probes.
"""

import os
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from app.rest.hold import Inputs, measured_steps
from gi_core.discs.search import SEARCHES
from gi_core.estimators import DEFAULT, ESTIMATORS
from gi_core.frames.held_light import Held
from gi_core.model import Model
from gi_core.photons.paths import rows_of
from gi_core.rays.structures import DEFAULT as RAYS
from gi_core.rays.structures import STRUCTURES
from gi_core.retrace.cuts import current_segments
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import CalculationSurface, Material, Mobile, PointLight, Pose, Probe, Scene
from gi_core.solver import Solver
from tests.support.photometry import luminaire
from tests.support.reference_twins import Twin
from tests.support.scene_builders import box, complete, grey, merge, quad, solve, sphere

PHOTONS, RADIUS, NEIGHBOURS, SEED = 300, 0.2, 6, 11
AWAY = Pose((50.0, 50.0, 50.0))


def room() -> Scene:
    """A unit room with coloured walls and a lamp, a two-sided screen, a box and a two-sided ball."""
    materials = (
        Material("wall", (0.8, 0.6, 0.4)),
        Material("lamp", (0.5, 0.5, 0.5), (3.0, 2.0, 1.0)),
        Material("screen", (0.3, 0.7, 0.6), two_sided=True),
        Material("black", (0.0, 0.0, 0.0)),
    )
    static = merge(
        box((0, 0, 0), (1, 1, 1), 2, 0, inward=True),
        quad((0.3, 0.3, 0.99), (0, 0.4, 0), (0.4, 0, 0), (1, 1), 1),
        quad((0.1, 0.5, 0.1), (0, 0, 0.4), (0.3, 0, 0), (2, 2), 2),
    )
    mobiles = (
        Mobile("box", box((-0.12, -0.12, 0), (0.12, 0.12, 0.24), 1, 0), Pose((0.6, 0.4, 0.0))),
        Mobile("ball", sphere((0, 0, 0), 0.15, 1, 2), Pose((0.3, 0.7, 0.4))),
    )
    lights = (
        PointLight("bulb", (0.8, 0.8, 0.7), (0.5, 0.5, 2.0)),
        luminaire("luminaire", (0.4, 0.3, 0.6), (1.0, 0.4, 0.4), size=(0.1, 0.2)),
    )
    return Scene(static, materials, mobiles, lights, up=(0, 0, 1), name="room")


SCENE = room()
TWIN = Twin(SCENE, PHOTONS, RADIUS, NEIGHBOURS, SEED)
coordinate = st.floats(-0.2, 1.2)
axis = st.tuples(*[st.sampled_from([-1.0, 0.0, 0.5, 1.0])] * 3).filter(lambda a: any(a))
poses = st.builds(
    lambda x, y, z, a, turn: Pose((x, y, z), axis_angle(a, turn)),
    coordinate,
    coordinate,
    st.one_of(st.just(0.0), coordinate),  # standing exactly on the floor, often
    axis,
    st.one_of(st.just(0.0), st.just(90.0), st.floats(0, 360)),
)
moves = st.tuples(st.sampled_from(["box", "ball"]), st.one_of(poses, st.just(AWAY)))
steps = st.lists(st.tuples(moves, st.sampled_from(list(ESTIMATORS))), min_size=1, max_size=6)


def fresh(**settings) -> Solver:
    return Solver(SCENE, **{"photons": PHOTONS, "radius": RADIUS, "neighbours": NEIGHBOURS, "seed": SEED, **settings})


def solved(poses=None, **settings) -> Solver:
    s = complete(fresh(**settings))
    if poses:
        s.move_all(poses)
    return s


@settings(max_examples=25)
@given(steps)
@example([(("box", Pose((0.25, 0.1015625, 0.0))), "tangent_plane")])  # a segment shorter than eps crosses a disc
def test_any_history_equals_from_scratch_and_the_naive_twin(history):
    solver = solved()
    for (name, pose), estimator in history:
        solver.configure(estimator=estimator)
        solver.solve()
        solver.move(name, pose)
    assume(solver.frame.changes.photons_cut > 0)
    for estimator in ESTIMATORS:
        solver.configure(estimator=estimator)
        solver.solve()
        twin = TWIN.irradiance(estimator, solver.poses)
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        assert np.array_equal(solver.irradiance, solved(solver.poses, estimator=estimator).irradiance)
        np.testing.assert_array_equal(solver.irradiance, twin)
        assert (solver.irradiance >= 0).all() and np.isfinite(solver.irradiance).all()
        assert twin.max() > 0


@settings(max_examples=12)
@given(steps)
@example([(("ball", Pose((0.55, 0.45, 0.2))), "tangent_plane"), (("box", AWAY), "impact_count")])
def test_any_history_equals_from_scratch_where_direct_light_is_known(history):
    """Photons measure bounced light alone, and smaller frames in between leave nothing behind."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gi_core.frames.static_light.UNRESOLVED", np.inf)  # its walls are coarse
        every_frame_takes_direct_light(history)


@cache
def held() -> Held:
    """Targets on a level surface of the room."""
    targets = ("mean", 0.5), ("minimum", 0.1), ("U0", 0.1)
    surface = CalculationSurface("a", height=0.4, margin=0.1, points=(4, 4), targets=targets)
    model = Model(SCENE)
    *_, (_, measured) = measured_steps(model, Inputs((surface,), 1.0, ()), SEED, noise=0.05)
    return measured[0]


@settings(max_examples=8)
@given(steps, st.lists(st.floats(0.2, 1), min_size=3, max_size=3))
def test_levels_that_hold_targets_are_those_from_scratch(history, asked):
    """Levels too are a function of poses and settings: of no earlier frame, of no smaller one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gi_core.frames.static_light.UNRESOLVED", np.inf)
        for light in ("photons", "best"):
            solver = solved(light=light, photons=2000)
            solver.hold(held())
            seen = set()
            for (name, pose), estimator in history:
                solver.configure(estimator=estimator)
                solver.solve()
                solver.move_all({name: AWAY}, solver.frame.subsets[0])
                solver.move(name, pose)
                solver.set_lamps(dict(zip(solver.lamps.names, asked, strict=True)))
                shown, levels = solver.irradiance, solver.levels
                seen.add(levels.tobytes())
                assert np.array_equal(shown, solver.from_scratch()) and np.array_equal(levels, solver.levels)
            new = solved(
                light=light,
                photons=2000,
                estimator=history[-1][1],
                lamps=dict(zip(solver.lamps.names, asked, strict=True)),
            )
            new.move_all(solver.poses)
            new.hold(held())
            assert np.array_equal(new.irradiance, solver.irradiance) and np.array_equal(new.levels, solver.levels)
            solver.hold(None)
            assert np.array_equal(solver.levels, np.array(asked)[:, None] * np.ones(3))
            assert np.array_equal(solver.irradiance, solver.from_scratch())


def every_frame_takes_direct_light(history):
    solver = solved(light="best", photons=5000)
    for (name, pose), estimator in history:
        solver.configure(estimator=estimator)
        solver.solve()
        solver.move_all({name: Pose((0.5, 0.5, 0.5))}, solver.frame.subsets[0], 4)
        solver.move(name, pose)
        additive = ESTIMATORS[estimator].additive
        assert solver.frame_light.knows_direct(solver.frame.background) == additive
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        assert (solver.irradiance >= 0).all() and np.isfinite(solver.irradiance).all()
    new = solved(light="best", photons=5000, estimator=history[-1][1])
    new.move_all(solver.poses)
    assert np.array_equal(solver.irradiance, new.irradiance)


@pytest.mark.parametrize("estimator", [name for name, kind in ESTIMATORS.items() if kind.additive])
@pytest.mark.parametrize("cached", [True, False])
def test_sums_without_segments_that_leave_lamps(monkeypatch, estimator, cached):
    """Of the background, of a frame, and from scratch; with cached intersections and without."""
    monkeypatch.setattr("gi_core.estimators.tangent_plane.MOST_PER_PHOTON", 64 if cached else 0)
    solver = solved(estimator=estimator)
    model, b, at = solver.model, solver.frame.background, solver.model.transforms(solver.poses)
    away = model.transforms(dict.fromkeys(solver.poses, AWAY))
    segments = current_segments(model, away, SEED, 0, PHOTONS)[0]
    static = solver.surfaces.receiver_range(0)
    direct = rows_of(segments, segments.bounce == 0)
    alone = b.estimate.from_scratch([direct], away).sums[static]
    whole, rest = (b.estimate.background(PHOTONS, direct)[0] for direct in (True, False))
    assert alone.any() and rest.any() and np.array_equal(whole - rest, alone)
    now, change = current_segments(model, at, SEED, 0, PHOTONS)[0], solver.frame.change
    assert (change.removed_suffixes.bounce == 0).any() and (change.removed_suffixes.bounce > 0).any()
    frame = b.estimate.evaluate(change.bounced())
    scratch = b.estimate.from_scratch([now], at, direct=False)
    assert np.array_equal(frame.sums[static], scratch.sums[static]) and not frame.direct and not scratch.direct


# Each structure compiles the kernels of tracing again, 16 to 29 CPU s: all of them run with GI_EVERY_STRUCTURE=1.
RAYS_HERE = [name for name in STRUCTURES if name != RAYS] if os.environ.get("GI_EVERY_STRUCTURE") else ["bvh"]


@pytest.mark.parametrize("rays", RAYS_HERE)
@settings(max_examples=4)
@given(history=st.lists(moves, min_size=1, max_size=3))
@example(history=[("ball", Pose((0.55, 0.45, 0.2)))])
def test_any_history_equals_from_scratch_with_each_structure_of_rays(rays, history):
    solver = solved(rays=rays)
    for name, pose in history:
        solver.move(name, pose)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    assert np.array_equal(solver.irradiance, solved(solver.poses, rays=rays).irradiance)
    if len(history) == 1 and history[0][1] is not AWAY:
        twin = Twin(SCENE, PHOTONS, RADIUS, NEIGHBOURS, SEED, rays)
        np.testing.assert_array_equal(solver.irradiance, twin.irradiance(DEFAULT, solver.poses))


def test_mobiles_outside_all_light_give_the_static_solution(estimator):
    alone = Scene(SCENE.static, SCENE.materials, (), SCENE.lights, up=SCENE.up, name="alone")
    static = solve(alone, estimator, PHOTONS, RADIUS, NEIGHBOURS, SEED)
    solver = solved({"box": AWAY, "ball": AWAY}, estimator=estimator)
    n = solver.surfaces.receiver_range(0).stop
    assert solver.frame.changes == (0, 0, 0)
    assert np.array_equal(solver.irradiance[:n], static.irradiance)
    assert not solver.irradiance[n:].any()


def test_threads_do_not_change_bits(estimator, small_shares):
    one, two, five = (solved(estimator=estimator, threads=n).irradiance for n in (1, 2, 5))
    assert np.array_equal(one, two)
    assert np.array_equal(one, five)


@settings(max_examples=15)
@given(poses)
def test_flux_is_accounted_for(pose):
    solver = solved({"ball": pose})
    photons, change = solver.frame.store, solver.frame.change
    total = [getattr(photons.fates, k) + getattr(change.fates, k) for k in change.fates._fields]
    emitted, absorbed, escaped, truncated = total
    assert emitted.min() > 0
    assert np.array_equal(emitted, absorbed + escaped + truncated)
    for part in (absorbed, escaped, truncated):
        assert (part >= 0).all()


def test_refined_equals_solved_at_once(estimator):
    refined = complete(fresh(estimator=estimator, photons=40))
    for photons in (130, PHOTONS):
        refined.configure(photons=photons)
        refined.solve()
    assert np.array_equal(refined.irradiance, solved(estimator=estimator).irradiance)


def test_steps_may_be_abandoned_at_any_point(estimator):
    expected = solved(estimator=estimator).irradiance
    solver = fresh(estimator=estimator)
    for stop in (1, 2, 1, 3):
        for _, progress in zip(range(stop), solver.solve_steps(), strict=False):
            assert 0 <= progress.fraction <= 1
        solver.move("box", Pose((0.5, 0.5, 0.3)))
    solver.solve()
    solver.move("box", SCENE.mobiles[0].pose)
    assert np.array_equal(solver.irradiance, expected)


def test_old_picture_stays_until_the_new_one_is_ready():
    solver = solved()
    before = solver.irradiance
    solver.configure(radius=2 * RADIUS)
    steps = solver.solve_steps()
    for progress in steps:
        if progress.picture:
            break
        assert solver.irradiance is before
    assert solver.irradiance is not before
    assert solver.frame.photons == PHOTONS


def bowl() -> Scene:
    """A box and a ball in a spherical room: concave discs reach beyond their hits, and mobiles enter them."""
    room = sphere((0, 0, 0), 1.0, 2)
    room = room._replace(faces=np.ascontiguousarray(room.faces[:, ::-1]))
    mobiles = (
        Mobile("box", box((-0.15, -0.15, -0.15), (0.15, 0.15, 0.15), 2, 0), Pose((0.0, 0.0, -0.8))),
        Mobile("ball", sphere((0, 0, 0), 0.15, 1, 0), Pose((0.75, 0.0, 0.0))),
    )
    lights = (PointLight("bulb", (0.0, 0.2, 0.3), (10.0, 5.0, 1.0)),)
    return Scene(room, (grey(0.6, two_sided=True),), mobiles, lights, up=(0, 0, 1), name="bowl")


TILTED = axis_angle((1.0, 0.5, 0.0), 30.0)
PROBES = (
    Probe("floor", (0.62, 0.55, 0.0), (0.0, 0.0, 1.0)),  # beside the box, which enters its disc
    Probe("air", (0.4, 0.4, 0.5), (0.0, 0.6, 0.8)),
    Probe("wall", (0.0, 0.7, 0.4), (1.0, 0.0, 0.0)),
)
PROBED = replace(SCENE, probes=PROBES)
NEAR = {"box": Pose((0.6, 0.42, 0.0)), "ball": Pose((0.5, 0.5, 0.12))}
IN_BOWL = (  # in contact with it, with each other, through its wall, and with nothing
    ((0.0, 0.0, -0.8), (0.75, 0.0, 0.0)),
    ((0.0, 0.0, -0.95), (0.0, 0.0, -0.65)),
    ((0.5, 0.0, 0.0), (0.7, 0.1, 0.0)),
    ((0.0, 0.1, 0.0), (-0.9, 0.3, 0.0)),
    ((9.0, 9.0, 9.0), (-9.0, 0.0, 0.0)),
)
MOVES = {"room": [{}, NEAR, {"ball": Pose((0.12, 0.7, 0.4), TILTED)}]}
MOVES["bowl"] = [{"box": Pose(a, TILTED), "ball": Pose(b)} for a, b in IN_BOWL]


@cache
def twin_of(scene_name: str, radius: float) -> Twin:
    scene = {"room": PROBED, "bowl": bowl()}[scene_name]
    return Twin(scene, PHOTONS, radius, NEIGHBOURS, SEED)


@cache
def expected(scene_name: str, radius: float, k: int) -> np.ndarray:
    """Return the twin's irradiance at the k-th poses, reached one after the other."""
    twin = twin_of(scene_name, radius)
    poses = twin.model.start_poses()
    for moves in MOVES[scene_name][: k + 1]:
        poses |= moves
    return twin.irradiance("tangent_plane", poses)


def solver_of(scene_name: str, radius: float, **settings) -> Solver:
    solver = Solver(
        twin_of(scene_name, radius).model.scene, photons=PHOTONS, radius=radius, neighbours=NEIGHBOURS, seed=SEED,
        **settings,
    )  # fmt: skip
    solver.solve()
    return solver


@pytest.mark.parametrize("scene_name, radius", [("room", RADIUS), ("bowl", 0.3)])
@pytest.mark.parametrize("search", SEARCHES)
def test_frames_equal_the_naive_twin(search, scene_name, radius, small_shares):
    """In a room, and in a bowl where segments count behind their hits; with mobiles on the floor and on each other."""
    threads = 1 + list(SEARCHES).index(search) % 3
    solver = solver_of(scene_name, radius, search=search, threads=threads)
    contact = []
    for k, poses in enumerate(MOVES[scene_name]):
        solver.move_all(poses)
        contact.append(solver.frame.control_facts.stale + solver.frame.control_facts.on_mobiles)
        np.testing.assert_array_equal(solver.irradiance, expected(scene_name, radius, k))
        assert np.array_equal(solver.from_scratch(), solver.irradiance)
        assert solver.frame.changes.photons_cut > 0 or (scene_name, k) == ("bowl", 4)
    assert sorted(contact)[-2] > 5


@pytest.mark.parametrize("search", SEARCHES)
def test_probes_read_the_same_by_every_search(search, small_shares):
    twin, E = twin_of("room", RADIUS), expected("room", RADIUS, 1)
    solver = solver_of("room", RADIUS, search=search)
    solver.move_all(MOVES["room"][1])
    read = solver.frame.probe_irradiance
    for k, probe in enumerate(PROBES):
        assert np.array_equal(read[probe.name], E[twin.model.first_probe + k])
        assert read[probe.name].max() > 0

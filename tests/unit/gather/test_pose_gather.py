"""Light gathered at resting poses: unbiased, exact under moves, kept for the last poses, right at mobiles' feet."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gi_core.gather import pose_gather, static
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance, relative_error
from gi_core.geometry.mesh_neighbours import neighbours
from gi_core.geometry.surfaces import evaluation_points
from gi_core.scene import Mobile, Pose, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import box, box_mobile, coloured_room, grey, lamp, merge, quad, solve

pytestmark = pytest.mark.slow

SCENE = coloured_room((box_mobile(size=0.2),))
ON_FLOOR, RAISED = Pose((0.55, 0.5, 0.101)), Pose((0.4, 0.5, 0.4))
POSES = [Pose((0.3 + 0.05 * k, 0.5, 0.101)) for k in range(10)]


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(static, "ENOUGH", 0.03)


def solved(static_light: bool = True, threads: int = 2) -> Solver:
    solver = solve(SCENE, photons=20_000, radius=0.06, light="best", threads=threads)
    list(solver.gather_steps() if static_light else ())
    return solver


kept = functools.cache(solved)  # one for all histories


def gather_pose(solver: Solver) -> pose_gather.PoseGather:
    list(solver.gather_pose_steps())
    return solver.frame_light.gathered_at(solver.model.transforms(solver.poses))


def reference(solver: Solver, rows: np.ndarray, paths: int) -> tuple[np.ndarray, np.ndarray]:
    points, normals = (a[rows] for a in evaluation_points(solver.surfaces, solver.receivers))
    return reference_irradiance(solver.scene, points, normals, paths, 5, solver.poses, model=solver.model)


@functools.cache
def truth_on_floor(rows: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return reference() at ON_FLOOR of receivers, by the bytes of their int64 numbers."""
    solver = Solver(SCENE, photons=0)
    solver.move("box", ON_FLOOR)
    return reference(solver, np.frombuffer(rows, np.int64), 1500)


@pytest.mark.parametrize("static_light", [False, True])
def test_light_at_a_pose_is_unbiased_and_better_than_the_frames(static_light, monkeypatch):
    solver, found, combined = solved(static_light), [], pose_gather.combined
    solver.move("box", ON_FLOOR)
    own = solver.irradiance
    monkeypatch.setattr(pose_gather, "combined", lambda *given: found.append(combined(*given)) or found[-1])
    light = gather_pose(solver)
    truth, error = truth_on_floor(light.rows.astype(np.int64).tobytes())
    mean, of_paths, of_static = found[-1]
    deviation = np.hypot(of_paths, of_static[:, None])
    sigma = np.sqrt(error**2 + deviation**2)[:, 1]
    z = (mean - truth)[:, 1][sigma > 0] / sigma[sigma > 0]
    assert len(z) > 60 and abs(z.mean()) < 4 / np.sqrt(len(z)) + 0.1, "static light's errors are correlated"
    assert z.std() < 1.4, "errors are not understated"
    mobile = light.rows >= solver.surfaces.receiver_range(0).stop
    for of in (mobile, ~mobile):
        before, after = (relative_error(E[light.rows], truth, light._weights, of).l1 for E in (own, solver.irradiance))
        assert after < 0.9 * before if light.used[of].all() else after == before < 2 * static.ENOUGH
    assert light.used.any()


def test_behind_a_door_light_keeps_its_share_of_the_static_lights_error():
    """Else 5 % of the error of a bright room's light are half of the light that a closed door leaves."""
    near, static = neighbours(np.array([[0, 1, 2], [1, 2, 3]]), 4), (np.full((4, 3), 12.0), np.full(4, 0.5))
    mean, error = np.full((4, 6), 1.0), np.full((4, 6), 0.1)
    mean[:, 3:] = -10.5  # static light is 0.5 too bright
    light, _, kept = pose_gather.combined(mean, error, np.zeros(4, bool), np.arange(4), static, near, 1)
    assert light == pytest.approx(np.full((4, 3), 1.0), rel=0.05) and (kept < 0.1).all()
    mean[:, :3], mean[:, 3:] = 12.0, 0.0  # it changes nothing: all of that error is left
    *_, kept = pose_gather.combined(mean, error, np.zeros(4, bool), np.arange(4), static, near, 1)
    assert kept == pytest.approx(np.full(4, 0.5))


def test_places_brighter_than_the_view_decide_less():
    """Else a bright room decides when the dark one behind a door has light of paths."""
    solver = solved()
    solver.move("box", ON_FLOOR)
    light = gather_pose(solver)
    still = (light.rows < solver.surfaces.receiver_range(0).stop) & (solver.receivers.areas[light.rows] > 0)
    rows = light.rows[still]
    share, E = light._weights[still] / solver.receivers.areas[rows], luminance(solver.irradiance[rows])
    assert share[E > 2 * np.median(E)].max() < 0.8 * share[E < np.median(E)].min()


def test_denoising_gets_the_variance_of_paths_alone(monkeypatch):
    """Squares without bias; static light's error is common to neighbours, and stays as it is."""
    solver, found, errors = solved(), [], []
    solver.move("box", ON_FLOOR)
    combined, denoise = pose_gather.combined, pose_gather.denoise
    monkeypatch.setattr(pose_gather, "combined", lambda *given: found.append(combined(*given)) or found[-1])
    monkeypatch.setattr(
        pose_gather, "denoise", lambda E, error, *more: errors.append(error) or denoise(E, error, *more)
    )
    light = gather_pose(solver)
    mobile, s = light.rows >= solver.surfaces.receiver_range(0).stop, light._rounds.state
    assert np.array_equal(errors[-1][mobile], s.standard_error[mobile, :3])
    assert (found[-1][2][~mobile] > 0).all() and (light.deviation >= found[-1][2]).all()


def test_paths_that_meet_no_light_leave_static_light():
    """Else their variance of 0 makes a black speck."""
    near, static = neighbours(np.array([[0, 1, 2], [1, 2, 3]]), 4), (np.full((4, 3), 2.0), np.full(4, 0.1))
    mean, error = np.full((4, 6), 1.0), np.full((4, 6), 0.5)
    mean[0], error[:3] = 0.0, 0.0
    light, _, kept = pose_gather.combined(mean, error, np.zeros(4, bool), np.arange(4), static, near, 1)
    assert (light[0] == 2.0).all() and (light[1:] > 0).all() and kept[0] == 0.1
    light, *_ = pose_gather.combined(mean, error, np.ones(4, bool), np.arange(4), static, near, 1)
    assert (light[0] == 0.0).all()  # on a mobile paths are all there is


def test_no_vertex_at_the_foot_of_a_mobile_is_far_off():
    """Frames read the foot's light from the corners of the floor's face: the worst is 15 % off."""
    solver = solved()
    solver.move("box", ON_FLOOR)
    rows = np.arange(solver.surfaces.receiver_range(0).stop, len(solver.irradiance))
    points, normals = evaluation_points(solver.surfaces, solver.receivers)
    rows = rows[normals[rows, 2] > -0.5]  # the sole sees 1 mm
    truth = luminance(reference(solver, rows, 2000)[0])

    def worst() -> float:
        return float(np.abs(luminance(solver.irradiance[rows]) / truth - 1).max())

    before = worst()
    gather_pose(solver)
    assert before > 0.12 > worst()


@settings(max_examples=6, deadline=None)
@given(
    history=st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 40), st.sampled_from([None, 4096])), min_size=2, max_size=5
    )
)
def test_any_history_of_moves_and_rests_equals_from_scratch(history):
    """A pose rests for some steps, then the next move breaks the gathering off."""
    solver = kept()
    for pose, steps, photons in history:
        solver.move_all({"box": POSES[pose]}, photons)
        for _, _ in zip(range(steps), solver.gather_pose_steps(), strict=False):
            pass
    solver.move_all({})
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_gathering_that_was_broken_off_ends_with_the_same_bits(monkeypatch):
    monkeypatch.setattr(static, "ENOUGH", 0.06)
    through, broken = (solved(False, threads) for threads in (1, 2))
    for solver in (through, broken):
        solver.move("box", ON_FLOOR)
    for k, _ in enumerate(broken.gather_pose_steps()):
        if k == 12:
            break
    broken.move("box", RAISED)
    broken.move("box", ON_FLOOR)
    one, other = gather_pose(through), gather_pose(broken)
    assert one.used.any() and np.array_equal(one.mean, other.mean)
    assert np.array_equal(through.irradiance, broken.irradiance)


def test_complete_static_light_gives_each_session_the_same_bits():
    """Paths from mobiles end in static light, which is the same whenever a pose comes to rest."""
    solver, lights = kept(), []
    for steps in (0, 12):
        solver.frame_light.at_poses._gathers = pose_gather.PoseGathers(solver.model, solver.seed)
        solver.move("box", ON_FLOOR)
        for _, _ in zip(range(steps), solver.gather_pose_steps(), strict=False):
            pass
        solver.move("box", RAISED)
        solver.move("box", ON_FLOOR)
        assert gather_pose(solver).used.any()
        lights.append(solver.irradiance)
    assert np.array_equal(*lights)


def test_light_of_the_last_poses_is_kept(monkeypatch):
    monkeypatch.setattr(static, "ENOUGH", 0.2)
    monkeypatch.setattr(pose_gather, "KEPT", 3)
    solver, lights = solved(False), []
    for pose in POSES[: pose_gather.KEPT + 1]:
        solver.move("box", pose)
        gather_pose(solver)
        lights.append(solver.irradiance)
    for k, pose in enumerate(POSES[: pose_gather.KEPT + 1]):
        solver.move("box", pose)
        assert np.array_equal(solver.irradiance, lights[k]) == (k > 0)


def test_photons_alone_take_no_light_of_poses(monkeypatch):
    monkeypatch.setattr(static, "ENOUGH", 0.1)
    solver = solved(False)
    solver.move("box", ON_FLOOR)
    assert gather_pose(solver).used.any()
    solver.configure(light="photons")
    solver.solve()
    assert solver.frame_light.gathered_at(solver.model.transforms(solver.poses)) is None
    plain = solve(SCENE, photons=20_000, radius=0.06)
    plain.move("box", ON_FLOOR)
    assert np.array_equal(solver.irradiance, plain.irradiance)
    assert [p.stage for p in solver.gather_pose_steps()] == ["done"]


def test_a_scene_without_light_or_mobiles_ends_at_once():
    bare = solve(coloured_room(), photons=2000, radius=0.06, light="best")
    assert len(list(bare.gather_pose_steps())) == 1
    unsolved = Solver(SCENE, photons=2000, radius=0.06, light="best")
    assert [p.stage for p in unsolved.gather_pose_steps()] == ["done"]


def test_the_fraction_gathered_only_grows(monkeypatch):
    """Though the noise that is left does not only fall: with more paths, less is smoothed."""
    solver = kept().twin()
    monkeypatch.setattr(static, "ENOUGH", 0.02)
    solver.move("box", POSES[4])
    at, fractions, left = solver.model.transforms(solver.poses), [], []
    for _ in solver.gather_pose_steps():
        light = solver.frame_light.gathered_at(at)
        fractions.append(light.fraction)
        left.append(light.left)
    assert left != sorted(left, reverse=True), "or this tests nothing"
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


def test_gathering_ends_after_the_most_rounds(monkeypatch):
    monkeypatch.setattr(static, "ENOUGH", 1e-9)
    monkeypatch.setattr(pose_gather, "LAST_ROUND", 6)
    solver = solved(False)
    light = gather_pose(solver)
    assert light.enough and light.fraction == 1.0 and light._rounds.state.rounds == 6
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def room_of_indirect_light() -> Scene:
    """A room of fine walls, lit by a lamp that shines at its ceiling, and a fine box on its floor."""
    walls = box((0, 0, 0), (1, 1, 1), 12, 0, inward=True)
    uplight = quad((0.05, 0.05, 0.5), (0.2, 0, 0), (0, 0.2, 0), (1, 1), 1)
    thing = Mobile("box", box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1), 10), ON_FLOOR)
    return Scene(merge(walls, uplight), (grey(0.6), lamp(10.0)), (thing,), up=(0.0, 0.0, 1.0), name="indirect")


def test_differences_have_the_light_that_mobiles_change_elsewhere():
    """Paths end in the static part's light with mobiles, and without: those from the floor do not meet the box."""
    solver = solve(room_of_indirect_light(), photons=100_000, radius=0.06, light="best", threads=2)
    list(solver.gather_steps())
    solver.move("box", Pose((0.2, 0.2, 0.7)))  # between the lamp and the ceiling
    light, n = gather_pose(solver), solver.surfaces.receiver_range(0).stop
    floor = np.flatnonzero((solver.receivers.positions[light.rows, 2] < 1e-6) & (light.rows < n))[::4]
    truth = reference(solver, light.rows[floor], 4000)[0]
    solver.move("box", Pose((5.0, 5.0, 5.0)))
    change = luminance(truth - reference(solver, light.rows[floor], 4000)[0])
    assert change.mean() < -0.1 * luminance(truth).mean()
    assert luminance(light._rounds.state.mean[floor, 3:]).mean() == pytest.approx(change.mean(), rel=0.1)


def test_no_vertex_is_far_off_in_the_first_light_of_a_pose(monkeypatch):
    """Whole paths to a lamp that mobiles do not see took five times as long to light them."""
    monkeypatch.setattr(static, "ENOUGH", 0.015)
    solver = solve(room_of_indirect_light(), photons=100_000, radius=0.06, light="best", threads=2)
    first = solver.surfaces.receiver_range(0).stop
    points, normals = evaluation_points(solver.surfaces, solver.receivers)
    side = (normals[:, 2] > -0.5) & (points[:, 2] < 0.1)
    rows = first + np.flatnonzero(side[first:])[::2]
    truth, error = (luminance(a) for a in reference(solver, rows, 9000))
    assert len(rows) > 80 and (error / truth).max() < 0.04

    def worst() -> float:
        return float(np.abs(luminance(solver.irradiance[rows]) / truth - 1).max())

    before = worst()
    for _ in solver.gather_pose_steps():
        light = solver.frame_light.gathered_at(solver.model.transforms(solver.poses))
        if light._rounds.state.paths.sum() > 1_000_000:
            break
    assert before > 0.15 > worst()

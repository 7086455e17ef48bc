"""Subsets of the photons: each is a smaller solution, stored with its background and chosen by time."""

import numpy as np
import pytest

from gi_core.estimators.tangent_plane import TangentPlane
from gi_core.frames.light_setting import FrameTimes
from gi_core.photons.flux_sums import LOWEST, SubsetStore, next_level
from gi_core.scene import Pose, SceneError
from gi_core.scene.pose import axis_angle
from gi_core.solver import Solver
from tests.support.scene_builders import box_mobile, coloured_room, complete, solve

SCENE = coloured_room((box_mobile(size=0.3),))
PHOTONS = 2 * LOWEST + 900
POSE = Pose((0.5, 0.45, 0.4), axis_angle((0, 0, 1), 20.0))


def solver_of(photons: int, estimator: str) -> Solver:
    solver = Solver(SCENE, estimator, photons=photons, radius=0.15, neighbours=20)
    solver.configure(subset_only=True)
    return solver


def test_frame_of_a_subset_equals_a_solver_of_that_many_photons(estimator):
    many = solver_of(PHOTONS, estimator)
    for _ in many.solve_steps():  # as the window refines: photon_map prepares no subset otherwise
        pass
    if estimator == "photon_map":
        assert many.frame.subsets[-1] == PHOTONS
    else:
        assert many.frame.subsets == (LOWEST, 2 * LOWEST, PHOTONS)
    for n in many.frame.subsets:
        few = complete(solver_of(n, estimator))
        few.move("box", POSE)
        many.move_all({"box": POSE}, photons=n)
        assert many.frame.changes.photons_cut > 0
        assert many.frame.photons == n
        assert np.array_equal(many.irradiance, few.irradiance)
    many.move("box", POSE)
    assert many.frame.photons == PHOTONS


def test_threads_and_parts_do_not_show_in_the_background(estimator, monkeypatch, small_shares):
    def light(threads):
        s = solve(SCENE, estimator, photons=3000, radius=0.15, neighbours=20, threads=threads)
        return s.irradiance, s.frame.fates

    one, fates = light(1)
    monkeypatch.setattr("gi_core.frames.background.PART", 211)
    for threads in (1, 2, 3):
        again, same = light(threads)
        assert np.array_equal(one, again)
        assert all(np.array_equal(fates[k], same[k]) for k in fates)


def test_other_counts_are_refused():
    s = complete(solver_of(1000, "impact_count"))
    with pytest.raises(SceneError, match="room: the photons of a frame must be one of 1000, got 999"):
        s.move_all({"box": POSE}, photons=999)


def test_largest_subset_within_the_time():
    times = FrameTimes()
    assert times.largest_within(0.010, (4096, 8192, 10_000)) == 4096  # nothing known yet
    times.add(10_000, 0.020)
    assert times.largest_within(0.021, (4096, 8192, 10_000)) == 10_000
    assert times.largest_within(0.017, (4096, 8192, 10_000)) == 8192  # in proportion
    times.add(4096, 0.014)  # so there is a fixed part: a line through both
    assert times.expected(8192) == pytest.approx(0.014 + 0.006 * 4096 / 5904)
    assert times.largest_within(0.017, (4096, 8192, 10_000)) == 4096
    assert times.largest_within(0.001, (4096, 8192, 10_000)) == 4096  # none fits


def test_one_slow_frame_does_not_change_the_prediction():
    times = FrameTimes()
    for seconds in (0.01, 0.5, 0.011, 0.009):
        times.add(1000, seconds)
    assert times.expected(1000) < 0.012


def test_levels_stay_and_other_counts_are_evicted():
    ladder = SubsetStore()
    for n in (LOWEST, 5000, 2 * LOWEST, 10_000):
        ladder[n] = n
    assert sorted(ladder) == [LOWEST, 2 * LOWEST, 10_000]
    assert next_level(0) == LOWEST
    assert next_level(LOWEST) == 2 * LOWEST


@pytest.mark.parametrize("what", ["frame", "background"])
def test_a_failure_half_way_leaves_no_trace(what, monkeypatch):
    solver = complete(solver_of(3000, "tangent_plane"))
    expected = solver.irradiance.copy()
    real, calls = TangentPlane._accumulate_part, []

    def failing(*arguments):
        calls.append(real(*arguments))
        if len(calls) == 2:
            raise MemoryError("half way")

    monkeypatch.setattr(TangentPlane, "_accumulate_part", failing)
    with pytest.raises(MemoryError):
        if what == "frame":
            solver.move("box", POSE)
        else:
            monkeypatch.setattr("gi_core.frames.background.PART", 300)
            solver.configure(photons=6000)
            solver.solve()
    monkeypatch.undo()
    solver.configure(photons=3000)
    solver.solve()
    solver.move("box", SCENE.mobiles[0].pose)
    assert np.array_equal(solver.irradiance, expected)
    solver.configure(photons=6000)
    solver.solve()
    assert np.array_equal(solver.irradiance, solver.from_scratch())

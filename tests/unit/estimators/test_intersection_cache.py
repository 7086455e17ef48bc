"""Disc intersections of the background are cached: removed suffixes are looked up, with the bits of a search."""

import itertools

import numpy as np
import pytest

from gi_core.discs.search import SEARCHES
from gi_core.estimators import tangent_plane
from gi_core.estimators.tangent_plane import IntersectionCache
from gi_core.frames import background
from gi_core.photons.flux_sums import LOWEST
from gi_core.scene import Pose
from gi_core.scene.pose import axis_angle
from gi_core.solver import Solver
from tests.support.scene_builders import box_mobile, coloured_room, complete

SCENE = coloured_room((box_mobile(size=0.3),))
PHOTONS = 2 * LOWEST + 900


def solver_of(photons: int = PHOTONS, **settings) -> Solver:
    solver = Solver(SCENE, photons=photons, radius=0.15, neighbours=20, **settings)
    solver.configure(subset_only=True)
    return solver


def standing(x: float, turn: float = 20.0) -> Pose:
    """Return the box on the floor, where it enters discs, its base at z = 0."""
    return Pose((x, 0.45, 0.15), axis_angle((0, 0, 1), turn))


def walk() -> list[Pose]:
    """Return a slow drag, a jump, the same pose twice, a slow drag back, a pose outside, and in again."""
    slow = [standing(0.3 + 0.002 * k, 20.0 + k) for k in range(6)]
    there = [Pose((0.7, 0.6, 0.3 + 0.003 * k), axis_angle((1, 1, 0), 45.0)) for k in range(3)]
    return [*slow, there[0], *there, Pose((50.0, 0.0, 0.0)), *reversed(slow)]


def test_photons_are_merged_in_steps_that_may_be_abandoned(monkeypatch):
    """A drag waited for all: 0.1 to 0.5 s while 1.5 million photons were traced. No photon subset is lost."""
    monkeypatch.setattr(tangent_plane, "ENTRIES_PER_STEP", 2000, raising=False)
    monkeypatch.setattr(background, "PART", 512)
    broken, whole, merged = solver_of(threads=1), solver_of(threads=1), [0]
    for _ in whole.solve_steps(pictures=False):
        cache = whole._first_frame._recent[-1].estimate._intersections
        merged.append(int(cache._first[cache._vertices]))
    assert merged[-1] > 15_000 and np.diff(merged).max() < 3500
    for steps in itertools.count(3):
        if len(list(zip(range(steps), broken.solve_steps(), strict=False))) < steps:
            break
        broken.move("box", standing(0.3 + 0.01 * (steps % 8)))
        assert broken.frame.background is None or np.array_equal(broken.irradiance, broken.from_scratch())
    assert steps > 8 and broken.frame.subsets == whole.frame.subsets
    for solver in (broken, whole):
        solver.move("box", standing(0.4))
    assert np.array_equal(broken.irradiance, whole.irradiance)


@pytest.mark.parametrize("control", [False, True])
def test_a_walk_through_poses_subsets_and_estimators_equals_from_scratch(control):
    solver, known = solver_of(control=control), {}
    list(solver.solve_steps())
    assert len(solver.frame.subsets) == 3
    cut, stale = 0, 0
    for k, pose in enumerate(walk()):
        if k in (4, 12):
            solver.configure(estimator="impact_count" if k == 4 else "tangent_plane")
            solver.solve()
        photons = solver.frame.subsets[(k * 2) % 3]
        solver.move_all({"box": pose}, photons=photons)
        cut, stale = max(cut, solver.frame.changes.photons_cut), max(stale, solver.frame.control_facts.stale)
        key = photons, solver.setting.estimator
        if key not in known:
            known[key] = solver_of(photons, control=control, estimator=solver.setting.estimator)
            known[key].solve()
        # The other solver has never been at a pose before, and knows no more photons than these.
        assert np.array_equal(solver.irradiance, known[key].from_scratch({"box": pose})), k
    assert cut > 100
    assert (stale > 0) == control


@pytest.mark.parametrize("search", SEARCHES)
def test_searching_for_removed_suffixes_gives_the_same_bits(search, monkeypatch):
    looked_up = complete(solver_of(search=search))
    monkeypatch.setattr(tangent_plane, "MOST_PER_PHOTON", 0)
    searched = complete(solver_of(search=search))
    assert looked_up.frame.background.estimate._intersections.complete
    assert not searched.frame.background.estimate._intersections.complete
    assert searched.frame.background.estimate.bytes_per_hit == 0 < looked_up.frame.background.estimate.bytes_per_hit
    for pose in walk()[::5]:
        for solver in (looked_up, searched):
            solver.move("box", pose)
        assert np.array_equal(looked_up.irradiance, searched.irradiance)
    assert np.array_equal(searched.irradiance, searched.from_scratch())


def test_full_log_is_recorded_again(monkeypatch):
    def light():
        solver = complete(solver_of())
        solver.move("box", standing(0.4))
        return solver.irradiance, solver.static_irradiance

    frame, resting = light()
    monkeypatch.setattr(tangent_plane, "ENTRIES_PER_SEGMENT", 0)
    calls = []
    find = IntersectionCache.find

    def counted(self, segments, accumulate):
        find(self, segments, lambda sign, log: (calls.append(sign), accumulate(sign, log)))

    monkeypatch.setattr(IntersectionCache, "find", counted)
    again, at_rest = light()
    assert 0 in calls
    assert np.array_equal(frame, again)
    assert np.array_equal(resting, at_rest)

"""Another disc search or pre-test, chosen live: only its structure is built, nothing is estimated again."""

from __future__ import annotations

import numpy as np
import pytest
from test_invariants import AWAY, PHOTONS, SEED, TWIN, fresh, solved

from gi_core.disc_search import PRETESTS, SEARCHES
from gi_core.estimators import ESTIMATORS, TangentPlane
from gi_core.scene.types import Pose

POSES = ({"box": Pose((0.5, 0.45, 0.0))}, {"ball": Pose((0.4, 0.6, 0.15)), "box": AWAY})


@pytest.fixture
def added(monkeypatch) -> list[int]:
    """Numbers of background segments, a call that estimates them."""
    counts = []
    for estimator in ESTIMATORS.values():

        def counted(self, segments, thread, real=estimator.add_background):
            counts.append(segments.size)
            real(self, segments, thread)

        monkeypatch.setattr(estimator, "add_background", counted)
    return counts


@pytest.mark.parametrize("changes", [{"search": s} for s in SEARCHES] + [{"pretest": p} for p in PRETESTS])
def test_a_switch_estimates_nothing_again(changes, added):
    start = {"search": "ray_cache"} if changes.get("search") == "disc_index" else {}
    start |= {"pretest": "badouel"} if changes.get("pretest") == "none" else {}
    solver = solved(**start)
    assert sum(added) > PHOTONS
    added.clear()
    searches, before = solver._shown.estimate._searches, solver.irradiance
    solver.configure(**changes)
    assert not [p for p in solver.solve_steps() if p.picture]
    assert not added and solver.irradiance is before
    assert solver._shown.estimate._searches is not searches
    assert all(type(s) is SEARCHES[solver.setting.search] for s in solver._shown.estimate._searches)
    for poses in POSES:
        solver.move_all(poses)
        assert solver.changes.photons_cut > 0
        assert np.array_equal(solver.irradiance, solved(solver.poses).irradiance)
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        np.testing.assert_array_equal(solver.irradiance, TWIN.irradiance("tangent_plane", solver.poses))


def test_another_radius_does_estimate_again(added):
    solver = solved()
    added.clear()
    solver.configure(radius=0.1)
    solver.solve()
    assert sum(added) > PHOTONS


def test_a_switch_amid_refinement_goes_on_where_it_was(added, monkeypatch):
    monkeypatch.setattr("gi_core.solver.FIRST_PICTURE", 50)
    whole = solved().irradiance
    segments, _ = sum(added), added.clear()
    solver = fresh()
    for name in ("ray_cache", "brute_force", "auto"):
        for _, _ in zip(range(6), solver.solve_steps(), strict=False):
            pass
        solver.configure(search=name)
    solver.solve()
    assert sum(added) == segments
    assert np.array_equal(solver.irradiance, whole)


def test_a_switch_given_up_halfway_leaves_frames_as_they_were():
    solver = solved()
    solver.configure(search="ray_cache")
    steps = solver.solve_steps()
    next(steps), next(steps)
    solver.move_all(POSES[0])
    assert np.array_equal(solver.irradiance, solved(solver.poses).irradiance)
    assert type(solver._shown.estimate._searches[0]) is SEARCHES["disc_index"]
    solver.solve()
    assert type(solver._shown.estimate._searches[0]) is SEARCHES["ray_cache"]


def test_auto_has_tried_everything_before_the_first_drag(monkeypatch):
    """No frame of a motion uses a search that is slower than the one known to be fastest."""
    monkeypatch.setattr("gi_core.disc_search.auto.FEW", 4)
    solver = solved(search="auto")
    searches = solver._shown.estimate._searches
    sizes = [solver._frame.branches.size, *(near.size for near in solver._frame.near)]
    assert min(sizes) > 4
    known = [dict(s._taken) for s in searches]
    assert all(len({name for _, name in taken}) == 2 for taken in known)
    assert not list(solver._shown.estimate.rehearse(solver._frame))
    asked = []
    for search in searches:
        monkeypatch.setattr(search, "_untried", lambda size: asked.append(size))
    for poses in POSES:
        solver.move_all(poses)
    assert not asked and all(s.patient for s in searches)
    assert np.array_equal(solver.irradiance, solved(solver.poses).irradiance)


@pytest.mark.parametrize("estimator", [name for name, e in ESTIMATORS.items() if e is not TangentPlane])
def test_estimators_without_a_disc_search_do_not_mind(estimator, added):
    solver = solved(estimator=estimator)
    added.clear()
    solver.configure(search="ray_cache", pretest="badouel")
    solver.solve()
    solver.move_all(POSES[0])
    assert not added and SEED == solver.seed
    np.testing.assert_array_equal(solver.irradiance, TWIN.irradiance(estimator, solver.poses))

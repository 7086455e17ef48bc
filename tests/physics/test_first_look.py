"""The first picture does not wait for artifact control, and leaves no trace in later frames."""

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.frames import first_frame
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import relative_error, subset_to_compare
from gi_core.geometry.surfaces import evaluation_points
from gi_core.solver import Solver
from tests.support.scene_builders import solve
from tests.support.viewer_support import room

PHOTONS = 40_000


@pytest.fixture
def low_receiver_threshold(monkeypatch):
    monkeypatch.setattr(first_frame, "MANY_RECEIVERS", 1)


def opened(**settings) -> Solver:
    return Solver(load_scene("furnace"), photons=PHOTONS, radius=0.1, **settings)


def until_picture(steps) -> None:
    for progress in steps:
        if progress.picture:
            return
    raise AssertionError("no picture")


def test_first_picture_is_of_whole_discs(low_receiver_threshold):
    """It equals that of a solver without control, which is not the one with control."""
    first, plain = opened(), opened(control=False)
    until_picture(first.solve_steps())
    until_picture(plain.solve_steps())
    assert first.frame.photons == plain.frame.photons == first_frame.FIRST_PICTURE
    assert np.array_equal(first.irradiance, plain.irradiance)
    assert np.array_equal(first.irradiance, first.from_scratch())
    assert subset_to_compare(first.frame.subsets) == first.frame.photons // 2, "its noise is known, to smooth it by"
    controlled = solve(load_scene("furnace"), photons=first.frame.photons, radius=0.1)
    assert not np.array_equal(first.irradiance, controlled.irradiance)


def test_first_look_leaves_no_trace(low_receiver_threshold):
    steps, straight = opened(), opened()
    list(steps.solve_steps())
    straight.solve()
    assert np.array_equal(steps.irradiance, straight.irradiance)
    assert steps.frame.photons == straight.frame.photons == PHOTONS
    assert np.array_equal(steps.irradiance, steps.from_scratch())


@pytest.mark.parametrize("stop", [0, 1, 2, 4, 7, 11])
def test_interrupted_first_look_leaves_no_trace(low_receiver_threshold, stop):
    """Interrupted after any step, also within the first look itself, and moved meanwhile."""
    left, straight = opened(), opened()
    for _, _ in zip(range(stop), left.solve_steps(), strict=False):
        pass
    left.move_all(left.poses)
    list(left.solve_steps())
    straight.solve()
    assert np.array_equal(left.irradiance, straight.irradiance)


def test_small_scenes_and_other_estimators_have_none(low_receiver_threshold, monkeypatch):
    """If nothing is slow to build, the first picture has the requested setting."""
    counted = opened(estimator="impact_count")
    until_picture(counted.solve_steps())
    assert counted.frame.background.setting == counted.setting
    monkeypatch.setattr(first_frame, "MANY_RECEIVERS", 30_000)
    small = opened()
    until_picture(small.solve_steps())
    assert small.frame.background.setting == small.setting


def test_the_first_picture_has_the_light_of_radiosity():
    """Its error is a third of the photons' at most, and none of it is left in later frames."""
    scene = room()
    solver, plain = (Solver(scene, photons=PHOTONS, radius=0.01, light=light) for light in ("best", "photons"))
    until_picture(solver.solve_steps())
    until_picture(plain.solve_steps())
    assert solver.frame.gathered and not plain.frame.gathered
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    static = solver.surfaces.receiver_range(0)
    points, normals = evaluation_points(solver.surfaces, solver.receivers)
    truth, _ = reference_irradiance(scene, points[static], normals[static], 1 << 10, 1, model=solver.model)
    weights = solver.receivers.areas[static]
    early, photons = (relative_error(s.irradiance[static], truth, weights).l1 for s in (solver, plain))
    assert early < photons / 3

"""A frame of few photons takes the light of the static part from all of them, changed as the few say."""

from __future__ import annotations

import numpy as np
import pytest
from scene_builders import box_mobile, coloured_room

from gi_core.control_variate import frame_irradiance
from gi_core.error import relative_error
from gi_core.ladder import LOWEST
from gi_core.scene import Pose, SceneError
from gi_core.solver import Solver
from gi_core.sums import CHUNK, Evaluated

SCENE = coloured_room((box_mobile(size=0.1),))
PHOTONS = 16 * LOWEST
POSE = Pose((0.55, 0.5, 0.35))


@pytest.fixture(scope="module")
def frames() -> dict:
    """Irradiance at POSE: of few photons with either static light and of all; at rest without the box: of both."""
    solver = Solver(SCENE, photons=PHOTONS, radius=0.06)
    solver.solve()
    out = {"solver": solver, "resting": {n: solver._shown.resting(n) for n in (LOWEST, PHOTONS)}}
    for kind in ("all", "prefix"):
        solver.configure(static_light=kind)
        solver.move_all({"box": POSE}, photons=LOWEST)
        out[kind] = solver.irradiance
        solver.move("box", POSE)
        out[f"all photons, {kind}"] = solver.irradiance
    return out


def test_with_all_photons_nothing_differs(frames):
    assert np.array_equal(frames["all photons, all"], frames["all photons, prefix"])
    assert np.array_equal(frames["all photons, all"], frames["solver"].from_scratch())


def test_what_the_mobile_leaves_alone_is_as_it_is_at_rest_with_all_photons(frames):
    few, many = frames["resting"][LOWEST], frames["resting"][PHOTONS]
    static = len(few)
    unchanged = (frames["prefix"][:static] == few).all(axis=1)
    assert 0.05 < unchanged.mean() < 1
    assert np.array_equal(frames["all"][:static][unchanged], many[unchanged])
    assert np.array_equal(frames["all"][static:], frames["prefix"][static:])  # on the mobile there is nothing to keep


def test_noise_of_the_few_cancels(frames):
    truth = frames["all photons, all"]
    static = len(frames["resting"][LOWEST])
    changed = np.abs(truth[:static] - frames["resting"][PHOTONS]).sum(axis=1) > 0.02 * truth[:static].mean()
    assert changed.sum() > 20
    weights = frames["solver"].receivers.areas[:static]
    off = {
        kind: relative_error(frames[kind][:static], truth[:static], weights, changed).l1 for kind in ("all", "prefix")
    }
    assert off["all"] < 0.6 * off["prefix"]


@pytest.mark.parametrize(
    "resting, better, frame, expected",
    [
        (2.0, 3.0, 2.0, 3.0),  # not touched
        (2.0, 3.0, 1.0, 1.5),  # half of it blocked
        (2.0, 3.0, 0.0, 0.0),  # in full shadow no noise is left
        (2.0, 3.0, 2.5, 3.5),  # lit up
        (0.0, 3.0, 0.0, 3.0),  # none of the few came here
        (0.0, 3.0, 0.5, 3.5),
        (2.0, 0.0, 1.0, 0.0),
        (0.0, 0.0, 0.0, 0.0),
    ],
)
def test_the_combination(resting, better, frame, expected):
    sums = np.zeros((CHUNK, 3), np.int64)
    sums[0] = int(1000 * frame)
    area = np.ones(CHUNK)
    still, many = np.zeros((CHUNK, 3)), np.zeros((CHUNK, 3))
    still[0], many[0] = resting, better
    out = frame_irradiance(Evaluated(sums, area, np.array([True])), 1e-3, still, many, threads=1)
    assert out[0] == pytest.approx([expected] * 3)
    assert not out[1:].any()


def test_another_source_is_refused():
    solver = Solver(SCENE, photons=0)
    with pytest.raises(SceneError, match="static_light must be one of all, prefix, gathered, got 'some'"):
        solver.configure(static_light="some")

"""Stability of the program: lights and mobiles in odd places, mobiles at rest, many moves.

The first line of each test names the failure. Numbers predicted by theory are tested in test_stability_atlas.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Mobile, PointLight, Pose, Scene
from tests.support.scene_builders import box, box_mobile, grey, plane_scene
from tests.support.stability_cases import UP, assert_sound, room, solved

# -- lights in odd places -------------------------------------------------------------------------


def test_tiny_bright_lamp_just_above_the_floor(estimator):
    """Its light all lands within a millimetre: one receiver's kernel holds it, and is finite."""
    for height in (1e-2, 1e-4, 1e-6):
        scene = plane_scene(PointLight("spark", (0.01, 0.02, height), (1e6,) * 3), reflectance=0.5)
        solver = solved(scene, estimator=estimator)
        assert_sound(solver)
        arrived = solver.irradiance[:, 0] @ solver.receivers.areas
        # Half of it goes down. A photon map and discs give it to those within reach, faces to their corners.
        assert arrived > 0 or estimator != "impact_count"
        if estimator == "impact_count":
            assert arrived == pytest.approx(0.5e6, rel=0.1)


def test_light_inside_a_mobile(estimator):
    """A closed black box over a bulb leaves the room exactly dark; without it the light returns, bit for bit."""
    cover = Mobile("cover", box((-0.1,) * 3, (0.1,) * 3, 2, 0), Pose((0.5, 0.5, 5.0)))
    walls = box((0, 0, 0), (1, 1, 1), 6, 0, inward=True)
    lights = (PointLight("bulb", (0.5, 0.5, 0.5), (10.0,) * 3),)
    scene = Scene(walls, (grey(0.7, two_sided=True),), (cover,), lights, up=UP, name="room")
    solver = solved(scene, estimator=estimator)
    static = solver.surfaces.receiver_range(0)
    begun = solver.irradiance.copy()
    assert begun[static].max() > 0
    solver.move("cover", Pose((0.5, 0.5, 0.5)))
    assert_sound(solver)
    assert not solver.irradiance[static].any()
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    solver.move("cover", Pose((0.5, 0.5, 5.0)))
    assert np.array_equal(solver.irradiance, begun)


def test_a_mobile_laid_over_the_lamp(estimator):
    """It touches the lamp's own faces: light is reflected in the gap, and hardly any escapes or passes through."""
    plate = Mobile("plate", box((-0.15, -0.15, -0.01), (0.15, 0.15, 0.0), 2, 0), Pose((0.5, 0.5, 0.5)))
    solver = solved(room(plate), estimator=estimator)
    static = solver.surfaces.receiver_range(0)
    below = np.flatnonzero(solver.receivers.positions[static, 2] < 0.9)
    open_ = solver.irradiance[below].mean()
    for height in (0.9899, 0.99 - 1e-6, 0.99, 0.99 + 1e-6, 0.991):
        solver.move("plate", Pose((0.5, 0.5, height)))
        assert_sound(solver)
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        # In a gap narrower than rays are lifted off faces (4 um here) reflected photons begin behind the lamp: 1 %.
        assert solver.irradiance[below].mean() < 0.02 * open_, height


# -- mobiles in odd places ------------------------------------------------------------------------

ODD = {
    "standing exactly on the floor": Pose((0.5, 0.5, 0.1)),
    "a hair above it": Pose((0.5, 0.5, 0.1 + 1e-7)),
    "flush with two walls": Pose((0.1, 0.1, 0.1)),
    "half in the wall": Pose((0.0, 0.5, 0.5)),
    "half in a corner, turned": Pose((1.0, 1.0, 1.0), axis_angle((1, 2, 3), 40)),
    "on the lamp's plane": Pose((0.5, 0.5, 0.89)),
    "outside": Pose((3.0, 0.5, 0.5)),
    "far away": Pose((1e7, -1e7, 1e7)),
}


@pytest.mark.parametrize("where", ODD)
def test_mobile_touching_crossing_or_leaving_the_room(where, estimator):
    """No NaN, no lost flux, the same bits as from scratch."""
    solver = solved(room(box_mobile("a"), box_mobile("b", 0.1)), estimator=estimator)
    solver.move_all({"a": ODD[where], "b": ODD[where]})  # and the smaller is swallowed by the larger
    assert_sound(solver)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    if where in ("outside", "far away"):
        on_mobiles = solver.irradiance[solver.surfaces.receiver_range(0).stop :]
        assert not on_mobiles.any()
        assert solver.frame.changes.photons_cut == 0


def test_no_light_under_a_box_on_the_floor(estimator):
    """Neither leak nor acne: well inside the footprint it is exactly dark; around it no receiver is black."""
    block = Mobile("block", box((-0.25, -0.25, 0), (0.25, 0.25, 0.4), 4, 0), Pose((0.5, 0.5, 0.0)))
    solver = solved(room(block), 40_000, estimator=estimator, radius=0.08)
    p, n = solver.receivers.positions, solver.receivers.normals
    static = np.arange(len(p)) < solver.surfaces.receiver_range(0).stop
    ground = static & (p[:, 2] == 0) & (n[:, 2] > 0.9)
    off = np.abs(p[:, :2] - 0.5).max(axis=1)
    assert (ground & (off < 0.16)).any() and not solver.irradiance[ground & (off < 0.16)].any()
    beside = solver.irradiance[ground & (off > 0.26), 0]
    assert len(beside) > 20 and beside.min() > 0.1 * beside.mean()
    # Its sides do not darken towards the floor that they touch by more than the floor's own share of their view.
    side = ~static & (np.abs(n[:, 2]) < 0.1)
    low, high = side & (p[:, 2] < 1e-9), side & (np.abs(p[:, 2] - 0.2) < 1e-9)
    assert solver.irradiance[low, 0].mean() > 0.2 * solver.irradiance[high, 0].mean() > 0


# -- flicker --------------------------------------------------------------------------------------


def test_mobile_at_rest_changes_no_bit(estimator):
    solver = solved(room(box_mobile("a")), estimator=estimator)
    pose = Pose((0.5, 0.5, 0.4), axis_angle((0, 1, 0), 30))
    solver.move("a", pose)
    begun = solver.irradiance.copy()
    assert solver.frame.changes.photons_cut > 0
    for _ in range(3):
        solver.move("a", pose)
        assert np.array_equal(solver.irradiance, begun)


def test_tiny_move_changes_at_most_the_flux_of_cut_photons():
    """Photons with uncut paths before and after add the same light; only cut photons can change it.

    Each adds at most its flux per segment.
    """
    solver = solved(room(box_mobile("a")), 20_000, estimator="impact_count")
    a_photon = float(solver.frame.fates["emitted"][0]) / solver.frame.photons
    solver.move("a", Pose((0.5, 0.5, 0.4)))
    for step in (1e-7, 1e-5, 1e-3):
        before, old = solver.irradiance.copy(), solver.frame.changes
        solver.move("a", Pose((0.5 + step, 0.5, 0.4)))
        static = solver.surfaces.receiver_range(0)
        areas = solver.receivers.areas[static]
        moved = np.abs(solver.irradiance[static, 0] - before[static, 0]) @ areas
        new = solver.frame.changes
        bound = a_photon * (old.old_segments + old.new_segments + new.old_segments + new.new_segments)
        assert moved <= bound
        if step == 1e-7:
            assert moved < 1e-3 * solver.frame.fates["emitted"][0]  # none or a photon or two


# -- many moves -----------------------------------------------------------------------------------


def test_three_hundred_jumps_and_back(estimator):
    """Nothing is added to the last frame, so nothing drifts: the first picture is back, bit for bit."""
    solver = solved(room(box_mobile("a")), 500, estimator=estimator)
    begun = solver.irradiance.copy()
    rng = np.random.default_rng(4)
    for _ in range(300):
        q = rng.normal(size=4)
        solver.move("a", Pose(tuple(rng.uniform(-0.2, 1.2, 3)), tuple(q / np.sqrt((q * q).sum()))))
    assert not np.array_equal(solver.irradiance, begun)
    solver.move("a", solver.scene.mobiles[0].pose)
    assert np.array_equal(solver.irradiance, begun)

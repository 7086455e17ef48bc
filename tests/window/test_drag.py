"""Drags as pure functions: invariants of each mode; no ray moves an object out of bounds."""

import numpy as np
import pytest

from app.draw.camera import Bounds, Turntable, from_camera
from app.window import drag
from gi_core.base.vectors import frame_of
from gi_core.scene import Camera, Pose
from gi_core.scene.pose import axis_angle, carried, to_world
from tests.support.projection import projected

ASPECT = 1.5
ROOM = Bounds((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))
POINT = np.array([0.2, 0.1, 0.3])
POSE = Pose((0.1, 0.0, 0.25), (0.8, 0.6, 0.0, 0.0))
MODES = [drag.SLIDE, drag.RAISE, drag.FACE]


def camera(up=(0, 1, 0), position=(3.0, 2.0, 4.0)) -> Turntable:
    return from_camera(Camera(position, (0.0, 0.0, 0.0), 40.0), up, ROOM)


def grab(mode: str, c: Turntable, half=0.1) -> drag.Grab:
    u, v = projected(c, POINT, ASPECT)
    return drag.Grab("block", mode, POINT, POSE, c, u, v, POINT - half, POINT + half)


def moved(g: drag.Grab, u: float, v: float) -> np.ndarray:
    return np.array(drag.dragged(g, u, v, ASPECT, ROOM).position) - POSE.position


def test_modes_of_the_modifier_keys():
    assert drag.mode_of(False, False, False) == drag.SLIDE
    assert drag.mode_of(True, False, False) == drag.RAISE
    assert drag.mode_of(False, True, False) == drag.FACE
    assert drag.mode_of(False, False, True) == drag.TURN
    assert set(drag.MODES) == {drag.SLIDE, drag.RAISE, drag.FACE, drag.TURN}


@pytest.mark.parametrize("mode", [*MODES, drag.TURN])
@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (0.2, -0.9, 0.1)])
def test_returning_to_the_press_point_restores_the_pose(mode, up):
    g = grab(mode, camera(up))
    assert drag.dragged(g, g.u, g.v, ASPECT, ROOM) == POSE


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (1, 0, 0)])
def test_slide_keeps_the_height_and_follows_the_cursor(up):
    c = camera(up)
    g = grab(drag.SLIDE, c)
    shift = moved(g, g.u + 0.05, g.v + 0.04)
    assert abs(shift @ frame_of(up)[2]) < 1e-12
    assert np.allclose(projected(c, POINT + shift, ASPECT), (g.u + 0.05, g.v + 0.04))


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (1, 0, 0)])
def test_lift_moves_along_the_vertical_only_and_up_is_up(up):
    c = camera(up)
    g = grab(drag.RAISE, c)
    shift = moved(g, g.u + 0.1, g.v - 0.05)
    upward = frame_of(up)[2]
    assert shift @ upward > 0 and np.allclose(shift, (shift @ upward) * upward)
    assert projected(c, POINT + moved(g, g.u, g.v - 0.05), ASPECT)[1] == pytest.approx(g.v - 0.05, abs=2e-3)


def test_face_keeps_the_depth_and_follows_the_cursor():
    c = camera()
    g = grab(drag.FACE, c)
    shift = moved(g, g.u - 0.08, g.v - 0.06)
    assert abs(shift @ c.basis()[2]) < 1e-6, "positions have a millionth of the room"
    assert np.allclose(projected(c, POINT + shift, ASPECT), (g.u - 0.08, g.v - 0.06))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "position", [(3, 2, 4), (3, 0.11, 4), (3, 0.1, 4), (0.5, 0.6, 0.9), (0.001, 5, 0.001), (1, -3, 2)]
)
def test_no_ray_flings_the_object_out_of_the_room(mode, position):
    """Also at the horizon, in the sky and behind: the object's box stays in the room and finite."""
    g = grab(mode, camera(position=position))
    for u in np.linspace(-1, 2, 13):
        for v in np.linspace(-1, 2, 21):
            at = POINT + moved(g, u, v)
            assert np.isfinite(at).all()
            assert (at - 0.1 >= np.array(ROOM.low) - 1e-9).all() and (at + 0.1 <= np.array(ROOM.high) + 1e-9).all()


def test_crossing_the_horizon_is_no_jump():
    """A cursor that rises through the horizon moves the object away from the eye up to the limit."""
    c = camera(position=(3.0, 0.8, 0.3))
    g = grab(drag.SLIDE, c)
    steps = np.linspace(g.v, -0.2, 4001)
    path = np.array([moved(g, g.u, v) for v in steps])
    away = np.diff(path @ np.array([-1.0, 0.0, 0.0]))
    assert (away > -1e-9).all(), "it never comes back"
    assert np.abs(np.diff(path[:, 2])).max() < 0.02, "nor slides sideways"


def test_a_drag_over_a_nearly_edge_on_plane_moves_no_farther_than_in_the_picture():
    """A drawer front just under the eye, in a building of 40 m: 180 pixels upwards move it by less than 2 m."""
    building, point = Bounds((-20.0, 0.0, -20.0), (20.0, 3.0, 20.0)), np.array([0.0, 1.3, 0.0])
    for height in (1.31, 1.4, 1.55):
        c = from_camera(Camera((0.0, height, 3.0), (0.0, 1.2, 0.0), 60.0), (0, 1, 0), building)
        u, v = projected(c, point, ASPECT)
        g = drag.Grab("drawer", drag.SLIDE, point, Pose(tuple(point)), c, u, v, point - 0.2, point + 0.2)
        steps = [drag.dragged(g, u, v - k / 800, ASPECT, building).position[2] for k in range(181)]
        assert (np.diff(steps) < 0).all() and -steps[-1] < 2


def test_an_object_outside_may_stay_and_come_in_but_not_go_farther():
    c = camera()
    u, v = projected(c, POINT, ASPECT)
    g = drag.Grab("block", drag.SLIDE, POINT, POSE, c, u, v, POINT - 5, POINT + 5)
    assert np.allclose(moved(g, u + 0.2, v), 0)


@pytest.mark.parametrize("way", [(0.5, 0, 0), (0.6, 0, -0.1), (0.1, 0, 0.6), (0.3, 0, -0.2), (0.5, 0, 0.5)])
def test_a_wide_group_slides_along_walls(way):
    """Its room is small and may begin behind the point below the eye: it goes where the cursor goes, or stays."""
    c = camera(position=(1.5, 1.2, 1.9))
    u, v = projected(c, POINT, ASPECT)
    half = np.array([1.4, 0.1, 1.3])
    g = drag.Grab("block", drag.SLIDE, POINT, POSE, c, u, v, POINT - half, POINT + half)
    shift = moved(g, *projected(c, POINT + way, ASPECT))
    allowed = np.clip(way, np.array(ROOM.low) - (POINT - half), np.array(ROOM.high) - (POINT + half))
    assert np.allclose(shift, allowed, atol=1e-9) and np.linalg.norm(shift) > 0.05


def test_a_flat_scene_has_headroom_and_far_things_do_not_widen_the_box():
    flat, far = Bounds((0, 0, 0), (4, 0, 3)), Bounds((-1, 0, 0), (448e3, 448e3, 3))
    room = drag.room_for(flat, flat, (0, 1, 0))
    assert np.allclose(room.low, (0, 0, 0)) and np.allclose(room.high, (4, 2.5, 3))
    down = drag.room_for(flat, flat, (0, -1, 0))
    assert np.allclose(down.low, (0, -2.5, 0))
    assert drag.room_for(ROOM, ROOM, (0, 1, 0)) == ROOM
    assert drag.room_for(far, flat, (0, 1, 0)) == Bounds((-1, 0, 0), (6.5, 2.5, 3))


def test_a_turn_of_several_goes_round_their_middle():
    c, middle = camera(), np.array([1.0, 5.0, -0.5])
    u, v = projected(c, POINT, ASPECT)
    g = grab(drag.TURN, c)._replace(pivot=middle)
    after = drag.dragged(g, u + 0.1, v, ASPECT, ROOM)
    alone = drag.dragged(grab(drag.TURN, c), u + 0.1, v, ASPECT, ROOM)
    assert after.quaternion == pytest.approx(alone.quaternion) and alone.position == POSE.position
    up = frame_of(c.up)[2]
    before, now = (np.array(p.position) - middle for p in (POSE, after))
    assert now @ up == pytest.approx(before @ up) and np.linalg.norm(now) == pytest.approx(np.linalg.norm(before))
    degrees = 0.1 * ASPECT * drag.TURN_SPEED
    flat = [x - (x @ up) * up for x in (before, now)]
    assert flat[0] @ flat[1] / (flat[0] @ flat[0]) == pytest.approx(np.cos(np.radians(degrees)))
    assert drag.dragged(g, u, v, ASPECT, ROOM) == POSE, "back at the press: bit for bit"


@pytest.mark.parametrize("turn", [0.0, 70.0])
def test_others_are_carried_by_one_rigid_motion(turn):
    q = axis_angle((1, 2, 3), turn)
    others = {"a": Pose((1.0, 2.0, 3.0), (0.6, 0.0, 0.8, 0.0)), "b": POSE}
    after = carried({"": POSE}, Pose((0.3, 0.2, 0.1)), Pose((0.5, 0.2, -0.4), q))[""]
    moved = carried(others, POSE, after)
    assert moved["b"].position == pytest.approx(after.position)
    corners = np.random.default_rng(1).normal(size=(4, 3))
    groups = [
        np.concatenate([to_world(p, corners) for p in (*given, last)])
        for *given, last in ((others["a"], others["b"], POSE), (moved["a"], moved["b"], after))
    ]
    lengths = [np.linalg.norm(g[:, None] - g, axis=2) for g in groups]
    np.testing.assert_allclose(*lengths, atol=1e-12)
    if turn == 0.0:
        assert moved["a"].quaternion == others["a"].quaternion, "bit for bit"

"""The turntable: agreement with the scene's camera, and invariants of each motion."""

import numpy as np
import pytest

from app.draw.camera import MAX_PITCH, Bounds, Turntable, from_camera
from gi_core.base.vectors import frame_of
from gi_core.scene import Camera
from tests.support.projection import projected

BOUNDS = Bounds((0.0, 0.0, 0.0), (2.0, 1.0, 3.0))
UPS = [(0, 1, 0), (0, 0, 1), (1, 0, 0), (0, -1, 0), (0.3, 0.8, -0.2)]


def camera(up=(0, 1, 0)) -> Turntable:
    return from_camera(Camera((4.0, 2.0, 5.0), (1.0, 0.5, 1.0), 40.0), up, BOUNDS)


@pytest.mark.parametrize("up", UPS)
def test_frame_is_right_handed(up):
    east, north, upward = frame_of(up)
    assert np.allclose(np.cross(east, north), upward)
    assert np.allclose([east @ east, north @ north, upward @ upward], 1)


@pytest.mark.parametrize("up", UPS)
def test_shows_the_scene_camera(up):
    c = camera(up)
    assert np.allclose(c.eye(), (4, 2, 5))
    back = c.as_camera()
    assert np.allclose(back.position, (4, 2, 5)) and np.allclose(back.target, (1, 0.5, 1))
    assert back.vertical_fov_degrees == pytest.approx(40)
    assert np.allclose(projected(c, (1.0, 0.5, 1.0), 1.6), (0.5, 0.5))
    right, upward, _ = c.basis()
    assert abs(right @ np.array(up, float)) < 1e-12  # no roll
    assert upward @ np.array(up, float) > 0


def test_camera_straight_down_and_camera_on_its_target_are_survived():
    down = from_camera(Camera((0, 5, 0), (0, 0, 0), 40.0), (0, 1, 0), BOUNDS)
    assert np.isfinite(down.view()).all() and down.pitch <= MAX_PITCH
    assert np.isfinite(from_camera(Camera((1, 1, 1), (1, 1, 1), 40.0), (0, 1, 0), BOUNDS).view()).all()


@pytest.mark.parametrize("up", UPS)
def test_without_a_camera_everything_is_in_view_from_above(up):
    c = from_camera(None, up, BOUNDS)
    corners = np.array([[x, y, z] for x in (0, 2) for y in (0, 1) for z in (0, 3)], float)
    for p in corners:
        u, v = projected(c, p, 1.5)
        assert 0 <= u <= 1 and 0 <= v <= 1
    assert (c.eye() - BOUNDS.centre) @ frame_of(up)[2] > 0


@pytest.mark.parametrize("up", UPS)
def test_a_ray_goes_where_its_points_appear(up):
    c = camera(up).orbit(0.2, -0.1)
    for u, v in [(0.5, 0.5), (0.0, 0.0), (0.9, 0.2)]:
        origin, direction = c.ray(u, v, 1.7)
        assert np.allclose(projected(c, origin + 2.3 * direction, 1.7), (u, v))
    assert np.linalg.norm(c.ray(0.1, 0.9, 1.7)[1]) == pytest.approx(1)


def test_orbit_keeps_pivot_and_distance_and_stops_at_the_poles():
    c = camera()
    o = c.orbit(0.3, 0.2)
    assert np.linalg.norm(o.eye() - np.array(c.pivot)) == pytest.approx(c.distance)
    for dy in (50.0, -50.0):
        steep = c.orbit(0, dy)
        assert abs(steep.pitch) == pytest.approx(MAX_PITCH) and np.isfinite(steep.view()).all()


def test_dragging_right_turns_the_scene_right():
    c = camera()
    near = np.array(c.pivot) - 0.3 * c.basis()[2]  # in front of the pivot
    assert projected(c.orbit(0.05, 0), near, 1.5)[0] > 0.5
    assert projected(c.orbit(0, 0.05), near, 1.5)[1] > 0.5


def test_panned_pivot_stays_under_the_hand():
    c = camera()
    p = c.pan(0.1, -0.05)  # in picture heights: right, up
    u, v = projected(p, c.pivot, 2.0)
    assert (u - 0.5) * 2.0 == pytest.approx(0.1) and v - 0.5 == pytest.approx(-0.05)


def test_pan_and_dolly_stay_near_the_scene():
    c = camera()
    for _ in range(500):
        c = c.pan(1, 1)
    assert np.linalg.norm(np.array(c.pivot) - BOUNDS.centre) <= 3 * BOUNDS.radius * 1.001
    for notches in (1e4, -1e4):
        assert np.isfinite(c.dolly(notches).projection(1.5)).all() and c.dolly(notches).distance > 0


def test_dolly_goes_nearer_and_back():
    c = camera()
    assert c.dolly(1).distance < c.distance
    assert c.dolly(1).dolly(-1).distance == pytest.approx(c.distance)


def test_chosen_pivot_moves_to_the_centre_at_its_depth():
    c = camera()
    point = np.array([1.5, 0.2, 2.0])
    depth = (point - c.eye()) @ c.basis()[2]
    p = c.centred(point)
    assert np.allclose(projected(p, point, 1.5), (0.5, 0.5)) and p.distance == pytest.approx(depth)
    assert (p.yaw, p.pitch) == (c.yaw, c.pitch)


def test_blend_has_both_ends_and_the_shorter_turn():
    a = camera().orbit(0.97, 0.1).dolly(3)  # nearly half a turn
    b = camera()
    assert np.allclose(a.towards(b, 0).eye(), a.eye())
    assert a.towards(b, 1).eye() == pytest.approx(b.eye())
    full_turn = b.orbit(1.9, 0)  # 342 degrees away is 18 degrees away
    assert np.allclose(full_turn.towards(b, 0.5).yaw % (2 * np.pi), (b.yaw + np.radians(9)) % (2 * np.pi))


@pytest.mark.parametrize("distance", [0.1, 1.0, 20.0])
def test_the_planes_hold_the_scene(distance):
    c = from_camera(Camera((1, 0.5, 1.5 + distance), (1, 0.5, 1.5), 40.0), (0, 1, 0), BOUNDS)
    depths = []
    for p in np.array([[x, y, z] for x in (0, 2) for y in (0, 1) for z in (0, 3)], float):
        x, y, z, w = c.projection(1.5) @ c.view() @ [*p, 1]
        if w > 0.02 * BOUNDS.radius:
            depths.append(z / w)
    assert len(depths) >= 4 and max(depths) < 1 and min(depths) > -1

"""Views that are kept, flown to and seen in parallel."""

from dataclasses import replace

import numpy as np
import pytest

from app.cli import saved_scene
from app.draw.camera import Bounds, from_camera
from gi_core.scene import Camera
from tests.support import viewer_support as support
from tests.support.projection import projected
from tests.support.viewer_hand import errors, in_window, keys

BOUNDS = Bounds((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
CAMERA = from_camera(Camera((0.5, 0.55, 2.9), (0.5, 0.45, 0.5), 38.0), (0, 1, 0), BOUNDS)


def test_looking_keeps_the_eye_and_flying_moves_it():
    looked = CAMERA.look(0.2, -0.1)
    assert looked.eye() == pytest.approx(CAMERA.eye()) and looked.distance == CAMERA.distance
    turn = np.arccos(looked.basis()[2] @ CAMERA.basis()[2])
    assert turn == pytest.approx(np.hypot(0.2, 0.1) * CAMERA.fov, rel=0.02), "the scene follows the cursor"
    point = CAMERA.eye() + CAMERA.ray(0.4, 0.5, 1.0)[1]
    assert projected(CAMERA.look(0.1, 0.0), point, 1.0)[0] == pytest.approx(0.5, abs=0.01)
    right, _, forward = CAMERA.basis()
    moved = CAMERA.fly(0.1, 0.2, 0.3)
    assert moved.eye() - CAMERA.eye() == pytest.approx(0.1 * right + np.array([0, 0.2, 0]) + 0.3 * forward)
    assert moved.basis()[2] == pytest.approx(forward)
    far = CAMERA.fly(0.0, 0.0, 1e6)
    assert np.linalg.norm(np.array(far.pivot) - BOUNDS.centre) <= 3.001 * BOUNDS.radius, "the scene stays findable"


def test_a_parallel_view_keeps_sizes_at_the_pivot_and_parallels_parallel():
    flat = CAMERA.with_fov(np.radians(2.0))
    assert flat.is_parallel and not CAMERA.is_parallel
    across = CAMERA.basis()[0]
    for x in (-0.4, 0.3):
        at = np.array(CAMERA.pivot) + x * across
        assert projected(flat, at, 1.3) == pytest.approx(projected(CAMERA, at, 1.3), abs=1e-6)
    ends = [[projected(flat, (x, 0.2, z), 1.0)[0] for z in (0.0, 1.0)] for x in (0.1, 0.9)]
    assert np.ptp(ends, axis=1) == pytest.approx(0, abs=0.01) and ends[1][0] - ends[0][0] > 0.4
    for camera in (flat, flat.with_fov(CAMERA.fov)):
        assert camera.dolly(0.0).distance == pytest.approx(camera.distance), "within the limits of the wheel"
    assert flat.with_fov(CAMERA.fov).eye() == pytest.approx(CAMERA.eye())


def test_views_are_kept_shown_and_saved(play, tmp_path):
    def script(hand, viewer):
        viewport, session, K = viewer.viewport, viewer.session, keys()
        hand.wait_for_light()
        first = viewport.view.camera
        hand.press(K.b)
        viewport.view.camera = first.orbit(0.2, 0.1).dolly(2.0)
        second = viewport.view.camera
        hand.press(K.b)
        assert [name for name, _ in session.settings.cameras] == ["view 1", "view 2"]
        assert viewer.files.has_changed(session)
        hand.press(int(K.mod_ctrl) | int(K._1))
        hand.wait(lambda: viewport.control.flight is None)
        assert viewport.view.camera.eye() == pytest.approx(first.eye())
        assert viewport.view.camera.fov == pytest.approx(first.fov)
        assert session.settings.estimator == support.SETTINGS.estimator or session.settings.estimator == "tangent_plane"
        hand.press(int(K.mod_ctrl) | int(K._2))
        hand.wait(lambda: viewport.control.flight is None)
        assert viewport.view.camera.eye() == pytest.approx(second.eye())
        hand.press(int(K.mod_ctrl) | int(K._3))
        assert viewport.control.flight is None, "there is no third"
        file, _ = viewer.files.save(session, viewport, str(tmp_path / "a.toml"))
        assert saved_scene.read(str(file)).cameras == session.settings.cameras
        hand.press(int(K.mod_ctrl) | int(K.z))
        assert [name for name, _ in session.settings.cameras] == ["view 1"]

        hand.press(K.o)
        assert viewport.view.camera.is_parallel
        hand.press(K.o)
        assert viewport.view.camera.eye() == pytest.approx(second.eye(), abs=1e-6)

    scene = tmp_path / "room.glb"
    scene.touch()
    settings = replace(support.SETTINGS, scene=str(scene))
    assert errors(play(script, settings, support.opening(support.room()))) == []


@in_window()
def test_the_right_button_looks_around_and_letters_fly(hand, viewer):
    viewport, session, K = viewer.viewport, viewer.session, keys()
    start, exposure = viewport.view.camera, session.settings.exposure
    corner = viewport.view.origin[0] + 20, viewport.view.origin[1] + 20  # no surface
    hand.move(corner)
    hand.ctx.mouse_down(1)
    hand.move((corner[0] + 40, corner[1]))
    assert viewport.control.is_looking
    assert viewport.view.camera.eye() == pytest.approx(start.eye()) and viewport.view.camera.yaw != start.yaw
    looked = viewport.view.camera
    for key, axis, sign in ((K.w, 2, 1), (K.a, 0, -1)):
        hand.ctx.key_down(key)
        hand.ctx.yield_(6)
        hand.ctx.key_up(key)
        hand.ctx.yield_()
        step = viewport.view.camera.eye() - looked.eye()
        assert sign * (step @ looked.basis()[axis]) > 0.9 * np.linalg.norm(step) > 0
        looked = viewport.view.camera
    assert session.settings.exposure == exposure, "A flies, and meters nothing"
    hand.ctx.mouse_up(1)
    hand.ctx.yield_(2)
    assert not viewport.control.is_looking
    hand.ctx.key_down(K.w)
    hand.ctx.yield_(4)
    hand.ctx.key_up(K.w)
    assert viewport.view.camera == looked

"""Views that are kept, flown to and seen in parallel; handles that move the selected object."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from app.cli import saved_scene
from app.draw.camera import Bounds, from_camera
from app.session.session import Motion, Session
from app.window import gizmo
from app.window.gizmo import MOVE, TURN, moved_pose
from gi_core.model import Model
from gi_core.scene import Camera, Pose
from gi_core.scene.pose import as_pose, axis_angle, quaternion_of, to_world
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


@pytest.mark.parametrize("held", [False, True])
def test_handles_wait_for_the_picture_unless_they_are_held(held, monkeypatch):
    """After an undo the object stays until its light is there; handles that are held follow the cursor."""
    places = []

    def manipulate(view, projection, operation, mode, matrix, *_) -> bool:
        places.append(matrix.values[12:15])
        return False

    names = "begin_frame", "allow_axis_flip", "set_drawlist", "set_rect", "set_gizmo_size_clip_space", "is_over"
    fake = SimpleNamespace(
        **{name: lambda *_: None for name in names}, manipulate=manipulate, is_using=lambda: held,
        MODE=SimpleNamespace(world=0), Matrix16=gizmo.G.Matrix16,
    )  # fmt: skip
    monkeypatch.setattr(gizmo, "G", fake)
    io = SimpleNamespace(key_ctrl=False)
    given = {"get_window_draw_list": None, "get_font_size": 13.0, "get_io": io}
    monkeypatch.setattr(gizmo, "imgui", SimpleNamespace(**{k: lambda v=v: v for k, v in given.items()}))
    room = support.room(1)
    shown, asked = room.mobiles[0].pose, Pose((0.7, 0.3, 0.5))
    session = SimpleNamespace(
        poses={"block": asked}, light=SimpleNamespace(snapshot=SimpleNamespace(poses={"block": shown})),
        model=Model(room), chosen=SimpleNamespace(scene_size=1.0), begin_drag=lambda: None, motion=Motion(),
    )  # fmt: skip
    session.box_of = partial(Session.box_of, session)
    view = SimpleNamespace(origin=(0, 0), size=(100, 100), camera=CAMERA, aspect=1.0)
    handles = gizmo.Gizmo()
    handles.mode = MOVE
    handles.draw(session, view, ("block",), BOUNDS)
    handles._middle = np.array(asked.position)  # where the cursor holds it
    handles.draw(session, view, ("block",), BOUNDS)
    assert places[0] == pytest.approx(shown.position, abs=1e-6)
    assert places[1] == pytest.approx((asked if held else shown).position, abs=1e-6)


@pytest.mark.parametrize("turn", [None, 40.0])
def test_handles_move_the_middle_of_an_object(turn):
    pose = as_pose(Pose((0.3, -0.2, 0.5), axis_angle((1, 2, 3), 70.0)))
    middle, to = np.array([0.5, 0.1, 0.2]), np.array([0.6, 0.1, 0.1])
    rotation = None
    if turn is not None:
        M = to_world(Pose((0, 0, 0), axis_angle((0, 0, 1), turn)), np.eye(3)).T
        rotation = (M + 1e-7 * np.arange(9).reshape(3, 3)).astype(np.float32)  # not quite a rotation
    moved = moved_pose(pose, middle, to, rotation)
    local = np.linalg.inv(to_world(pose._replace(position=(0, 0, 0)), np.eye(3)).T) @ (middle - pose.position)
    assert to_world(moved, local[None])[0] == pytest.approx(to, abs=1e-9)
    if turn is None:
        assert moved.quaternion == pose.quaternion, "bit for bit"
    else:
        assert moved.quaternion == pytest.approx(quaternion_of(M), abs=1e-6)
        assert as_pose(moved) == moved


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


@in_window()
def test_an_arrow_moves_the_selected_object_along_its_axis(hand, viewer):
    viewport, session, K = viewer.viewport, viewer.session, keys()
    viewport.view.camera = viewport.view.camera.orbit(0.12, 0.1)
    hand.press(K.g)
    assert viewport.gizmo.mode == MOVE and viewport.selection == ("block",)
    start = session.poses["block"]
    middle, beside = (np.array(hand.at(np.array(start.position) + x)) for x in ((0, 0, 0), (0.1, 0, 0)))
    along = (beside - middle) / np.linalg.norm(beside - middle)
    handle = middle + 38 * along
    for snaps in (False, True):
        before = session.poses["block"].position
        hand.move(tuple(handle))
        assert viewport.gizmo.takes_mouse
        hand.drag(tuple(handle), tuple(handle + 50 * along), modifier=K.mod_ctrl if snaps else None)
        pose = session.poses["block"]
        dx, dy, dz = np.subtract(pose.position, before)
        assert abs(dx) > 0.03 and abs(dy) < 1e-6 and abs(dz) < 1e-6, (dx, dy, dz)
        assert pose.quaternion == start.quaternion and not session.motion.dragging
        if snaps:
            assert abs(dx) == pytest.approx(0.01 * round(abs(dx) / 0.01), abs=1e-6)
        assert hand.light_is_that_from_scratch()
        viewer._do("undo")
        hand.wait_for_light()
        assert session.poses["block"].position == pytest.approx(start.position), "one step of undo"
    hand.press(K.g)
    assert viewport.gizmo.mode == TURN
    hand.press(K.g)
    hand.ctx.yield_(2)
    assert viewport.gizmo.mode == "" and not viewport.gizmo.takes_mouse

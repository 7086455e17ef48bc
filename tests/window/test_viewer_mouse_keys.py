"""Mouse and keys in the window, driven by ImGui's test engine."""

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import Image

from app.window import drag
from tests.support.viewer_hand import BLOCK_FRONT, errors, in_window, keys


@in_window()
def test_dragged_mobile_and_its_light_move_in_the_same_frame(hand, viewer):
    K = keys()
    seen = []
    session, viewport = viewer.session, viewer.viewport
    start, before = session.poses["block"], hand.pixels()

    # A hovered mobile has a hint.
    hand.move(hand.at(BLOCK_FRONT))
    assert viewport.pointer.hover is not None and "Shift: up and down" in viewport.hint()
    hand.pixels()

    # A plain drag: another place at the same height. Each frame's picture belongs to that frame's pose.
    upload = viewer.painter.renderer.set_colours

    def watched(o, front, back, weights):
        if o == 0:
            seen.append((session.version, session.poses["block"], session.irradiance))
        upload(o, front, back, weights)

    viewer.painter.renderer.set_colours = watched
    start_at = hand.at(BLOCK_FRONT)
    hand.drag(start_at, (start_at[0] + 90, start_at[1] - 8))
    moved = session.poses["block"]
    assert moved.position[0] > start.position[0] + 0.08
    assert moved.position[1] == pytest.approx(start.position[1], abs=1e-12)
    assert len(seen) >= 3
    for version, _, irradiance in seen[:-1]:
        assert irradiance is not session.irradiance or version == session.version
    assert hand.light_is_that_from_scratch(), "the light of this very pose"
    hand.move(hand.at((0.1, 0.9, 0.1)))
    after = hand.pixels()
    assert (np.abs(after.astype(int) - before).max(axis=2) > 8).mean() > 0.02

    # Undo and redo.
    hand.press(int(K.mod_ctrl) | int(K.z))
    assert session.poses["block"] == start
    hand.press(int(K.mod_ctrl) | int(K.mod_shift) | int(K.z))
    assert session.poses["block"] == moved

    # Shift: vertically. Alt: in the picture. Ctrl: turned in place.
    at = hand.at((moved.position[0], 0.3, moved.position[2] + 0.1))
    hand.drag(at, (at[0] + 30, at[1] - 50), modifier=K.mod_shift)
    lifted = session.poses["block"]
    assert lifted.position[1] > moved.position[1] + 0.05
    assert lifted.position[0] == moved.position[0] and lifted.position[2] == moved.position[2]
    at = hand.at((lifted.position[0], lifted.position[1], lifted.position[2] + 0.1))
    hand.drag(at, (at[0] - 40, at[1] + 30), modifier=K.mod_alt)
    facing = session.poses["block"]
    assert facing.position[0] < lifted.position[0] and facing.position[1] < lifted.position[1]
    at = hand.at((facing.position[0], facing.position[1], facing.position[2] + 0.1))
    hand.drag(at, (at[0] + 40, at[1]), modifier=K.mod_ctrl)
    assert session.poses["block"].quaternion != facing.quaternion
    assert session.poses["block"].position == facing.position

    # Esc puts it back while the button is still down.
    current = session.poses["block"]
    at = hand.at((current.position[0], current.position[1], current.position[2]))
    hand.move(at)
    hand.ctx.mouse_down(0)
    hand.move((at[0] - 60, at[1]))
    assert viewport.mobile_drag.grab is not None and viewport.mobile_drag.grab.mode == drag.SLIDE
    assert session.poses["block"] != current
    hand.press(K.escape)
    assert session.poses["block"] == current
    hand.move((at[0] - 90, at[1]))
    hand.ctx.mouse_up(0)
    assert session.poses["block"] == current

    # R: the initial state.
    hand.press(K.r)
    assert session.poses["block"] == start


@in_window()
def test_camera_by_mouse(hand, viewer):
    K = keys()
    viewport = viewer.viewport
    home, pose = viewport.view.camera, dict(viewer.session.poses)
    wall = hand.at((0.15, 0.8, 0.0))
    hand.drag(wall, (wall[0] + 60, wall[1] + 20))
    orbited = viewport.view.camera
    assert orbited.yaw != home.yaw and orbited.pitch != home.pitch and orbited.pivot == home.pivot
    hand.drag(wall, (wall[0] + 60, wall[1]), modifier=K.mod_shift)
    panned = viewport.view.camera
    assert panned.pivot != home.pivot and panned.yaw == orbited.yaw
    hand.drag(wall, (wall[0], wall[1] + 30), button=2)
    assert viewport.view.camera.pivot != panned.pivot
    hand.ctx.mouse_wheel_y(2)
    hand.ctx.yield_(2)
    assert viewport.view.camera.distance < home.distance
    hand.press(K.home)
    hand.wait(lambda: viewport.control.flight is None)
    assert viewport.view.camera == home

    # A double click makes the point under the cursor the pivot.
    hand.move(hand.at((0.2, 0.6, 0.0)))
    hand.ctx.mouse_double_click(0)
    hand.ctx.yield_(2)
    hand.wait(lambda: viewport.control.flight is None)
    assert viewport.view.camera.pivot == pytest.approx((0.2, 0.6, 0.0), abs=0.03)
    assert viewer.session.poses == pose, "no camera motion moves an object"


def test_keys(play, folder):
    K = keys()

    def script(hand, viewer):
        session = viewer.session
        hand.wait_for_light()
        width = viewer.viewport.view.size[0]
        hand.press(K.tab)
        assert not viewer.params.docking_params.dockable_window_of_name("Panel").is_visible
        hand.wait(lambda: viewer.viewport.view.size[0] > width)
        hand.press(K.tab)
        hand.wait(lambda: viewer.viewport.view.size[0] == width)
        hand.press(K.h)
        assert viewer.help_open
        hand.press(K.h)
        assert not viewer.help_open

        # Esc closes a list that is open, and nothing else.
        hand.press(K.h)
        hand.ctx.set_ref("Panel")
        hand.ctx.item_click("##Tone map")
        assert len(imgui.get_current_context().open_popup_stack) == 1
        hand.press(K.escape)
        assert len(imgui.get_current_context().open_popup_stack) == 0 and viewer.help_open
        hand.press(K.escape)
        assert not viewer.help_open

        start = session.poses["block"]
        hand.press(K.space)
        assert session.motion.playing
        hand.wait(lambda: session.poses["block"] != start)
        hand.press(K.space)
        assert not session.motion.playing
        moved = session.poses["block"]
        hand.ctx.yield_(3)
        assert session.poses["block"] == moved

        hand.press(int(K.mod_shift) | int(K.p))
        assert not list(folder.glob("*.png")), "a key with another modifier is another key"
        hand.press(K.p)
        hand.press(K.f12)
        assert "gi-viewer-002.png" in viewer.log.last.text
        hand.press(K.a)
        assert "metered" in viewer.log.last.text
        hand.press(int(K.mod_ctrl) | int(K.q))
        assert viewer.files.question.is_open, "the block has moved"
        hand.press(int(K.mod_ctrl) | int(K.q))

    viewer = play(script, quits=True)
    assert errors(viewer) == []
    assert viewer.params.app_shall_exit
    parameters = Image.open(folder / "gi-viewer-001.png").text
    assert parameters["scene"] == "room" and parameters["photons"] == "8192"
    assert parameters["estimator"] == "tangent_plane"
    assert parameters["radius"] == "0.06 m" and parameters["neighbours"] == "40" and parameters["seed"] == "0"
    assert parameters["pose block"].count(",") == 6 and "EV" in parameters["exposure"]
    assert parameters["camera"].startswith("position 0.5,0.55,2.9 target 0.5,0.45,0.5")
    with Image.open(folder / "gi-viewer-001.png") as picture:
        assert picture.size == tuple(map(round, viewer.viewport.view.size))
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(colours, axis=0)) > 500, "a lit room"

"""Drags between two frames of a slow window: Dear ImGui shows their release in the frame after the press."""

from types import SimpleNamespace

import numpy as np
import pytest
from imgui_bundle import imgui

from app.draw.camera import Bounds, from_camera
from app.session.session import Motion
from app.window import drag
from app.window.camera_control import ORBIT, CameraControl, View
from app.window.drag import MobileDrag
from gi_core.scene import Camera, Pose

SIZE = 800.0, 600.0
ROOM = Bounds((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))
START, END = (400.0, 300.0), (460.0, 330.0)


@pytest.fixture
def io():
    """Input of a window without a backend."""
    before, context = imgui.get_current_context(), imgui.create_context()
    imgui.set_current_context(context)
    io = imgui.get_io()
    io.set_ini_filename("")
    io.display_size, io.backend_flags = imgui.ImVec2(*SIZE), imgui.BackendFlags_.renderer_has_textures
    yield io
    imgui.destroy_context(context)
    if before is not None:
        imgui.set_current_context(before)


@pytest.fixture
def view() -> View:
    view = View()
    view.size, view.camera = SIZE, from_camera(Camera((0.0, 1.5, 4.0), (0.0, 0.0, 0.0), 40.0), (0, 1, 0), ROOM)
    return view


def frame(act=None):
    """Draw a frame; return what acting in it returns."""
    imgui.new_frame()
    out = act() if act is not None else None
    imgui.end_frame()
    return out


def flick(io, start=START, end=END) -> None:
    """Press at start, move to end, release and move on, all between two frames."""
    io.add_mouse_pos_event(*start)
    io.add_mouse_button_event(0, True)
    for share in (0.3, 0.7, 1.0):
        io.add_mouse_pos_event(*(a + share * (b - a) for a, b in zip(start, end, strict=True)))
    io.add_mouse_button_event(0, False)
    io.add_mouse_pos_event(10.0, 10.0)


class Room(SimpleNamespace):
    """A session with one mobile."""

    def __init__(self) -> None:
        super().__init__(scene=SimpleNamespace(mobiles=[SimpleNamespace(name="block")]), motion=Motion(playing=True))
        self.poses, self.ended = {"block": Pose((0.0, 0.0, 0.0))}, []

    def box_of(self, names):
        return np.full(3, -0.1), np.full(3, 0.1)

    def begin_drag(self) -> None:
        self.motion.before = dict(self.poses)

    def end_drag(self, keep: bool = True) -> None:
        self.ended.append(keep)

    def move(self, poses) -> None:
        self.poses = {**self.poses, **poses}


def dragged(io, view, mouse) -> Room:
    """Return the session after a drag in two frames; mouse: sends its events."""
    room, held = Room(), MobileDrag(ROOM)
    frame()
    mouse(io)
    hit = SimpleNamespace(object=1, point=np.zeros(3))
    frame(lambda: held.begin(room, view, hit, drag.SLIDE))
    frame(lambda: held.follow(room, view))
    assert held.grab is None and room.ended == [True]
    return room


def test_a_mobile_goes_to_the_place_of_the_release(io, view):
    room = dragged(io, view, flick)
    grab = drag.Grab(
        "block", drag.SLIDE, np.zeros(3), Pose((0.0, 0.0, 0.0)), view.camera,
        START[0] / SIZE[0], START[1] / SIZE[1], np.full(3, -0.1), np.full(3, 0.1),
    )  # fmt: skip
    wanted = drag.dragged(grab, END[0] / SIZE[0], END[1] / SIZE[1], view.aspect, ROOM)
    assert room.poses["block"] == wanted and wanted.position[0] > 0.2


def test_a_click_and_a_cursor_outside_move_no_mobile(io, view):
    still = Pose((0.0, 0.0, 0.0))
    assert dragged(io, view, lambda io: flick(io, START, (401.0, 300.0))).poses["block"] == still
    nowhere = -3.4028234663852886e38
    assert dragged(io, view, lambda io: flick(io, START, (nowhere, nowhere))).poses["block"] == still


@pytest.mark.parametrize("end, turns", [(END, True), ((401.0, 301.0), False)])
def test_the_camera_follows_a_drag_and_no_click(io, view, end, turns):
    control, before = CameraControl(view), view.camera
    frame()
    flick(io, START, end)
    frame(lambda: control.begin(ORBIT, 0))
    assert frame(lambda: control.steer(io, 0.0)) is False and not control.is_steering
    wanted = before.orbit((END[0] - START[0]) / SIZE[1], (END[1] - START[1]) / SIZE[1]) if turns else before
    assert view.camera == wanted and (wanted != before) == turns

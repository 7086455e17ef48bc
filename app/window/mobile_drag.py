"""A drag on a mobile: the mouse moves it until the button is released."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imgui_bundle import imgui

from app.window import drag

if TYPE_CHECKING:
    from app.draw.camera import Bounds
    from app.draw.picking import Hit
    from app.session.session import Session
    from app.window.view import View

THRESHOLD_PIXELS = 2.0  # shorter motions are a click
LEFT, RIGHT = 0, 1  # buttons that drag


class MobileDrag:
    """`begin` at a press, `follow` in each frame after it; `room`: box that mobiles stay in."""

    def __init__(self, room: Bounds | None = None) -> None:
        self.room = room
        self.grab: drag.Grab | None = None  # None: nothing is dragged

    def begin(self, session: Session, view: View, hit: Hit, mode: str) -> None:
        """Grab a mobile where the cursor meets it."""
        mobile = session.scene.mobiles[hit.object - 1].name
        u, v = view.uv(imgui.get_io().mouse_pos)
        session.playing = False
        session.begin_drag()
        box = session.model.vertices_at(hit.object, session.poses)
        low, high = box.min(axis=0), box.max(axis=0)
        self.grab = drag.Grab(mobile, mode, hit.point, session.poses[mobile], view.camera, u, v, low, high)

    def follow(self, session: Session, view: View) -> None:
        """Move the mobile to the cursor; end when the button is released."""
        button = LEFT if imgui.is_mouse_down(LEFT) else RIGHT
        if not imgui.is_mouse_down(button):
            self.grab = None
            session.end_drag()
            return
        if imgui.is_mouse_dragging(button, THRESHOLD_PIXELS) or session.poses != session.before_drag:
            # The camera may have dollied since the press: the ray is of the current camera.
            grab = self.grab._replace(camera=view.camera)
            pose = drag.dragged(grab, *view.uv(imgui.get_io().mouse_pos), view.aspect, self.room)
            if pose != session.poses[grab.mobile]:
                session.move({grab.mobile: pose})

    def cancel(self, session: Session) -> bool:
        """Restore the mobile's pose; return False without a drag."""
        if self.grab is None:
            return False
        self.grab = None
        session.end_drag(keep=False)
        return True

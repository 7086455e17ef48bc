"""A drag on mobiles: the mouse moves them until the button is released, and to its place then.

Press, motion and release may come between two frames. Dear ImGui then shows the release in the frame after the press.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from imgui_bundle import imgui

from app.window import drag
from app.window.view import CLICK_PIXELS
from gi_core.scene.pose import carried

if TYPE_CHECKING:
    from app.draw.camera import Bounds
    from app.draw.picking import Hit
    from app.session.session import Session
    from app.window.view import View
    from gi_core.scene import Pose

LEFT, RIGHT = 0, 1  # buttons that drag


class MobileDrag:
    """`begin` at a press, `follow` in each frame after it; `room`: box that mobiles stay in."""

    def __init__(self, room: Bounds | None = None) -> None:
        self.room = room
        self.grab: drag.Grab | None = None  # None: nothing is dragged
        self.others: dict[str, Pose] = {}  # poses at the press of mobiles that move with the grabbed one

    def begin(self, session: Session, view: View, hit: Hit, mode: str, names: tuple[str, ...] = ()) -> None:
        """Grab a mobile where the cursor meets it; names: mobiles that move as one, the grabbed one among them."""
        mobile = session.scene.mobiles[hit.object - 1].name
        self.others = {name: session.poses[name] for name in names if name != mobile}
        u, v = view.uv(imgui.get_io().mouse_pos)
        session.motion.playing = False
        session.begin_drag()
        low, high = session.box_of((mobile, *self.others))
        pivot = (low + high) / 2 if self.others else None
        self.grab = drag.Grab(mobile, mode, hit.point, session.poses[mobile], view.camera, u, v, low, high, pivot)

    def follow(self, session: Session, view: View) -> None:
        """Move the mobiles to the cursor; end when the button is released."""
        u, v = view.uv(imgui.get_io().mouse_pos)
        way = math.hypot((u - self.grab.u) * view.size[0], (v - self.grab.v) * view.size[1])
        # A cursor that leaves the window has no place for a moment.
        if imgui.is_mouse_pos_valid() and (way >= CLICK_PIXELS or session.poses != session.motion.before):
            # The camera may have dollied since the press: the ray is of the current camera.
            grab = self.grab._replace(camera=view.camera)
            pose = drag.dragged(grab, u, v, view.aspect, self.room)
            if pose != session.poses[grab.mobile]:
                session.move({grab.mobile: pose, **carried(self.others, grab.pose, pose)})
        if not (imgui.is_mouse_down(LEFT) or imgui.is_mouse_down(RIGHT)):
            self.grab = None
            session.end_drag()

    def cancel(self, session: Session) -> bool:
        """Restore the poses; return False without a drag."""
        if self.grab is None:
            return False
        self.grab = None
        session.end_drag(keep=False)
        return True

"""The pointer: surface and light under the cursor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.draw.readout import Reading, read
from gi_core.display.dilation import Drawn

if TYPE_CHECKING:
    from app.draw.picking import Hit
    from app.session.session import Session
    from app.window.view import View
    from app.window.view_content import Side


class Pointer:
    """`update` in each frame with the cursor over the picture, `leave` in others."""

    def __init__(self) -> None:
        self.hover: Hit | None = None  # mobile under the cursor
        self.pointed: Hit | None = None  # surface under the cursor
        self.reading: Reading | None = None  # light there
        self._asked: tuple | None = None  # arguments of the last pick

    def update(self, session: Session, view: View, side: Side | None) -> None:
        """Find surface and light; side: of the picture under the cursor, None before the first light."""
        mouse = imgui.get_io().mouse_pos
        asked = (tuple(mouse), view.camera, session.version, session.settings.cull, side is None)
        if asked == self._asked:
            return
        self._asked = asked
        hit = pick(session, view, mouse)
        self.pointed, self.hover = hit, hit if hit is not None and hit.object > 0 else None
        self.reading = None if hit is None or side is None else _read(hit, session, view, side)
        session.receiver = -1 if hit is None else _receiver(hit, session, view)

    def leave(self) -> None:
        """Forget the point under the cursor."""
        self.hover = self.pointed = self.reading = self._asked = None


def pick(session: Session, view: View, mouse) -> Hit | None:
    """Return the surface that the picture shows at a point of the window; None without one."""
    return session.picker.pick(*view.ray(mouse), session.pose_list, session.settings.cull)


def _receiver(hit: Hit, s: Session, view: View) -> int:
    """Return the receiver nearest to a hit, on the side that is seen; -1 on the back of a one-sided face."""
    surfaces, poses = s.model.surfaces, s.light.snapshot.poses
    vertices = surfaces.faces[hit.object][hit.face]
    corners = s.model.vertices_at(hit.object, poses)[vertices]
    f = surfaces.first_face[hit.object] + hit.face
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    front = normal @ (hit.point - view.camera.eye()) < 0
    nearest = int(np.argmin(((corners - hit.point) ** 2).sum(axis=1)))
    return int((surfaces.corner_front if front else surfaces.corner_back)[f][nearest])


def _read(hit: Hit, s: Session, view: View, side: Side) -> Reading:
    """Return the light of the picture at a hit under the cursor."""
    io = imgui.get_io()
    _, direction = view.ray(io.mouse_pos)
    height = round(view.size[1] * io.display_framebuffer_scale.y)
    drawn, mesh = Drawn(side.irradiance, side.weights), s.meshes[hit.object]
    shown = s.light.snapshot
    return read(hit, direction, view.camera, height, s.scene, s.model, shown.poses, mesh, drawn, shown.gloss)

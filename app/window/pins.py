"""Pins: read-outs at points of surfaces, with the light of the picture."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.draw.readout import Pinned, new_pin, read_pin
from app.session.readouts import free_name
from gi_core.display.dilation import Drawn

if TYPE_CHECKING:
    from app.draw.picking import Hit
    from app.session.session import Session
    from app.window.view import View
    from app.window.view_content import Shown


class Pins:
    """`read` once per frame; `add` and `remove` change the settings, which hold the pins."""

    def __init__(self) -> None:
        self.waiting = False  # the next click pins a read-out
        self.shown: tuple[Pinned, ...] = ()  # light at the pins
        self._asked: tuple | None = None  # arguments of these

    def add(self, session: Session, view: View, at: Hit | None) -> None:
        """Pin a read-out to a surface; without one, the next click does."""
        if at is None:
            self.waiting = not self.waiting
            return
        self.waiting = False
        pins, direction = session.settings.pins, at.point - view.camera.eye()
        name = free_name(pin.name for pin in pins)
        pin = new_pin(name, at, direction, session.model, session.light.snapshot.poses)
        session.edit(pins=(*pins, pin))

    def remove(self, session: Session, view: View) -> None:
        """Remove the pin under the cursor, else the last one."""
        pins, under = session.settings.pins, self._under_cursor(view)
        if pins:
            k = len(pins) - 1 if under is None else under
            session.edit(pins=pins[:k] + pins[k + 1 :])

    def places(self, view: View) -> list[tuple[float, float] | None]:
        """Return where the pins are in the window; None behind the eye."""
        return view.on_screen(np.array([p.position for p in self.shown]).reshape(-1, 3))

    def _under_cursor(self, view: View) -> int | None:
        mouse, em = imgui.get_io().mouse_pos, imgui.get_font_size()
        for k, at in enumerate(self.places(view)):
            if at is not None and math.hypot(at[0] - mouse.x, at[1] - mouse.y) < em:
                return k
        return None

    def read(self, s: Session, shown: Shown | None) -> None:
        """Read the light at the pins, when it or they have changed; shown: None before the first light."""
        asked = s.settings.pins, s.version, shown is None
        if asked == self._asked:
            return
        self._asked = asked
        if shown is None:
            self.shown = ()
            return
        side, light = shown.sides[0], s.light.snapshot
        drawn = Drawn(side.irradiance, side.weights)
        self.shown = tuple(
            read_pin(pin, s.picker, s.scene, s.model, light.poses, s.meshes, drawn, light.gloss)
            for pin in s.settings.pins
        )

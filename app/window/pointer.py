"""The pointer and pins: surface and light under the cursor, and read-outs at points that stay."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from app.draw.picking import Hit
from app.draw.readout import Pinned, Reading, nearest_receiver, new_pin, read, read_pin
from app.session.readouts import free_name
from app.session.session import Session
from app.window.camera_control import View
from app.window.view_content import Change, Shown, lit
from gi_core.display.dilation import Drawn


class Pointer:
    """`update` in each frame with the cursor over the picture, `leave` in others."""

    def __init__(self) -> None:
        self.hover: Hit | None = None  # mobile under the cursor
        self.pointed: Hit | None = None  # surface under the cursor
        self.reading: Reading | None = None  # light there
        self._asked: tuple | None = None  # arguments of the last pick

    def update(self, session: Session, view: View, shown: Shown | None) -> None:
        """Find surface and light; shown: None before the first light."""
        mouse = imgui.get_io().mouse_pos
        asked = (tuple(mouse), view.camera, session.version, session.settings.cull, id(shown))  # drawn later
        if asked == self._asked:
            return
        self._asked = asked
        hit = pick(session, view, mouse)
        self.pointed, self.hover = hit, hit if hit is not None and hit.object > 0 else None
        self.reading = None if hit is None or shown is None else _read(hit, session, view, shown)
        session.receiver = -1
        if hit is not None:
            ray, poses = hit.point - view.camera.eye(), session.light.snapshot.poses
            session.receiver = nearest_receiver(session.model, poses, hit, ray)

    def leave(self) -> None:
        """Forget the point under the cursor."""
        self.hover = self.pointed = self.reading = self._asked = None


def pick(session: Session, view: View, mouse) -> Hit | None:
    """Return the surface that the picture shows at a point of the window; None without one."""
    return session.picker.pick(*view.ray(mouse), session.pose_list, session.settings.cull)


def _read(hit: Hit, s: Session, view: View, shown: Shown) -> Reading:
    """Return the light of the picture at a hit under the cursor; on a map of changes light A too."""
    io = imgui.get_io()
    _, direction = view.ray(io.mouse_pos)
    height = round(view.size[1] * io.display_framebuffer_scale.y)
    light = lit(s, shown)
    reading, of = read(light, hit, direction, view.camera, height), shown.errors
    if not isinstance(of, Change):
        return reading
    light = replace(light, drawn=Drawn(of.before, None), deviation=of.deviation)
    before = read(light, hit, direction, view.camera, height)
    return reading._replace(before=(before.irradiance, before.error))


class Pins:
    """`read` once per frame; `add` and `remove` change the settings, which hold the pins."""

    def __init__(self) -> None:
        self.waiting = False  # the next click pins a read-out
        self._asks = False  # and asks it where its light comes from
        self.shown: tuple[Pinned, ...] = ()  # light at the pins
        self._asked: tuple | None = None  # arguments of these

    def add(self, session: Session, view: View, at: Hit | None, asks: bool = False) -> None:
        """Pin a read-out to a surface, and ask where its light comes from; without a surface, the next click does."""
        asks = asks or (self.waiting and self._asks)
        if at is None:
            self.waiting, self._asks = not self.waiting, asks
            return
        self.waiting = False
        pins, direction = session.settings.pins, at.point - view.camera.eye()
        name = free_name(pin.name for pin in pins)
        pin = new_pin(name, at, direction, session.model, session.light.snapshot.poses)
        session.edit(pins=(*pins, pin))
        if asks:
            session.want(replace(session.settings, asked=pin))

    def remove(self, session: Session, view: View) -> None:
        """Remove the pin under the cursor, else the last one."""
        pins, under = session.settings.pins, self._under_cursor(view)
        if pins:
            k = len(pins) - 1 if under is None else under
            session.edit(pins=pins[:k] + pins[k + 1 :])

    def ask(self, session: Session, view: View) -> bool:
        """Ask the pin under the cursor for the origins of its light, or no longer; return False without one."""
        k, s = self._under_cursor(view), session.settings
        if k is None or k >= len(s.pins):
            return False
        session.want(replace(s, asked=None if s.asked == s.pins[k] else s.pins[k]))
        return True

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
        light = lit(s, shown)
        self.shown = tuple(read_pin(pin, s.picker, light) for pin in s.settings.pins)

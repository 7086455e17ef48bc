"""Lamps over the picture: a mark per light that has a place, which the mouse selects, moves, turns and aims."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from imgui_bundle import imgui

from app.draw.bare_lights import rectangle_of
from app.draw.camera import Bounds
from app.session.lights import Directed, LightId, towards, turned, words_for
from app.session.session import Session
from app.window import drag, theme
from app.window.camera_control import CLICK_PIXELS, View
from gi_core.files import edits
from gi_core.files.edits import Values
from gi_core.scene import Pose
from gi_core.scene.pose import rotation
from gi_core.scene.types import Light, PhotometricLight, PlacedLight

AIM = "aim"  # beside the modes of a drag
WORDS = {**drag.MODES, AIM: "shines at the surface under the cursor"}


class Mark(NamedTuple):
    """A light in the picture."""

    id: LightId
    light: PlacedLight
    at: tuple[float, float]  # [points] in the window
    hidden: bool  # behind a surface


class Held(NamedTuple):
    """A light that the mouse holds."""

    id: LightId
    light: PlacedLight  # at the press
    mode: str
    grab: drag.Grab


class LampHandles:
    """`update` and `draw` once per frame; `press`, then `follow` in each frame until `held` is None."""

    def __init__(self) -> None:
        self.are_shown = True
        self.selected: LightId | None = None  # number 1 where a lamp consists of faces
        self.held: Held | None = None
        self._marks: list[Mark] = []
        self._aim: tuple[float, float] | None = None  # of the selected light, in the window
        self._under: tuple[LightId, bool] | None = None  # light under the cursor; whether its aim is
        self._asked: tuple | None = None
        self._moved = False  # since the press

    @property
    def takes_mouse(self) -> bool:
        """Whether the cursor is over a mark, or holds one."""
        return self.held is not None or self._under is not None

    @property
    def under_cursor(self) -> LightId | None:
        """The light whose mark is under the cursor."""
        mark = self._nearest(imgui.get_io().mouse_pos)
        return mark[0] if mark is not None else None

    def adopt(self, session: Session, before: Session | None) -> None:
        """Show the lamps of a session; before: the one before an edit. The light that it adds is then selected.

        Not those of daylight, which has a section of its own.
        """
        self._asked, now = None, session.lights
        if before is not None:
            earlier = before.lights
            added = [light_id for light_id in now if light_id not in earlier]
            same_day = session.scene.daylight == before.scene.daylight
            self.selected = added[-1] if added and same_day else self.selected
        if self.selected is not None and self.selected not in now:
            names = session.model.emitters.lamps.names
            self.selected = LightId(self.selected.name) if self.selected.name in names else None

    # Marks ------------------------------------------------------------------------------------------

    def update(self, session: Session, view: View, hovered: bool) -> None:
        """Find the marks, and the one under the cursor; hovered: the cursor is over the picture."""
        lights = session.lights if self.are_shown else {}
        asked = view.camera, view.origin, view.size, tuple(lights.items()), session.version, self.selected
        if asked != self._asked:
            self._asked = asked
            placed = {light_id: light for light_id, light in lights.items() if isinstance(light, PlacedLight)}
            points = np.array([light.position for light in placed.values()], np.float64).reshape(-1, 3)
            self._marks = [
                Mark(light_id, light, at, self._is_hidden(session, view, light))
                for (light_id, light), at in zip(placed.items(), view.on_screen(points), strict=True)
                if at is not None
            ]
            self._find_aim(session, view, lights.get(self.selected) if self.selected is not None else None)
        if self.held is None:
            self._under = self._nearest(imgui.get_io().mouse_pos) if hovered else None

    def _is_hidden(self, session: Session, view: View, light: PlacedLight) -> bool:
        eye = view.camera.eye()
        way = np.array(light.position) - eye
        far = float(np.linalg.norm(way))
        hit = session.picker.pick(eye, way / max(far, 1e-300), session.pose_list, session.settings.cull)
        # a surface within 0.03 of the scene's size of a light, such as its shade, does not hide it
        return hit is not None and hit.distance < far - 0.03 * session.chosen.scene_size

    def _find_aim(self, session: Session, view: View, light: Light | None) -> None:
        self._aim = None
        if isinstance(light, PlacedLight) and isinstance(light, Directed):
            place, d = np.array(light.position), np.array(light.direction, np.float64)
            d /= np.linalg.norm(d)
            hit = session.picker.pick(place, d, session.pose_list, False)
            # where the light meets nothing, the aim is 0.2 of the scene's size away
            target = place + d * 0.2 * session.chosen.scene_size if hit is None else hit.point
            (self._aim,) = view.on_screen(target[None])

    def _nearest(self, mouse) -> tuple[LightId, bool] | None:
        """Return the mark under the cursor; hidden ones count only while they are selected."""
        reach = 0.8 * imgui.get_font_size()  # reach of the mouse: 0.8 em
        if self._aim is not None and math.dist(self._aim, mouse) < reach:
            return self.selected, True
        near = [(math.dist(m.at, mouse), m) for m in self._marks if not m.hidden or m.id == self.selected]
        distance, mark = min(near, key=lambda pair: pair[0], default=(math.inf, None))
        return (mark.id, False) if distance < reach else None

    # Drags ------------------------------------------------------------------------------------------

    def press(self, session: Session, view: View, mode: str) -> bool:
        """Take a press of the mouse on a mark; return False where there is none."""
        if self._under is None:
            return False
        light_id, aims = self._under
        light = session.lights.get(light_id)
        if not isinstance(light, PlacedLight):
            return False
        u, v = view.uv(imgui.get_io().mouse_pos)
        place = np.array(light.position, np.float64)
        grab = drag.Grab(light_id.name, mode, place, Pose(light.position), view.camera, u, v, place, place)
        self.selected, self._moved = light_id, False
        self.held = Held(light_id, light, AIM if aims else mode, grab)
        return True

    def follow(self, session: Session, view: View, room: Bounds) -> None:
        """Change the light by the cursor; end when no button is down."""
        held, io = self.held, imgui.get_io()
        u, v = view.uv(io.mouse_pos)
        way = math.hypot((u - held.grab.u) * view.size[0], (v - held.grab.v) * view.size[1])
        if imgui.is_mouse_pos_valid() and (way >= CLICK_PIXELS or self._moved):
            self._change(session, self._values(session, view, u, v, room))
        if not (imgui.is_mouse_down(0) or imgui.is_mouse_down(1)):
            self.held = None

    def _values(self, session: Session, view: View, u: float, v: float, room: Bounds) -> Values:
        light, grab = self.held.light, self.held.grab._replace(camera=view.camera)
        if self.held.mode == AIM and isinstance(light, Directed):
            hit = session.picker.pick(*view.camera.ray(u, v, view.aspect), session.pose_list, session.settings.cull)
            way = hit.point - np.array(light.position) if hit is not None else np.zeros(3)
            return towards(light, way) if np.linalg.norm(way) > 0 else ()
        pose = drag.dragged(grab, u, v, view.aspect, room)
        if self.held.mode == drag.TURN:
            return turned(light, rotation(pose))
        return (("position", pose.position),)

    def _change(self, session: Session, values: Values) -> None:
        light_id, now = self.held.id, session.lights.get(self.held.id)
        if values and now is not None and any(getattr(now, key) != value for key, value in values):
            session.change_scene(edits.Light(light_id.name, values, number=light_id.number))
            self._moved = True

    def cancel(self, session: Session) -> bool:
        """Restore the light; return False without a drag."""
        if self.held is None:
            return False
        self.held = None
        if self._moved:
            session.undo()
        return True

    # Drawing ----------------------------------------------------------------------------------------

    def draw(self, session: Session, view: View) -> None:
        """Draw the marks into the current window."""
        (x, y), (w, h) = view.origin, view.size
        levels = dict(zip(session.model.emitters.lamps.names, session.light.snapshot.levels.max(axis=1), strict=True))
        drawing = imgui.get_window_draw_list()
        drawing.push_clip_rect((x, y), (x + w, y + h), True)
        for mark in self._marks:
            self._draw_mark(mark, view, levels.get(mark.id.name, 1.0) > 0)
        drawing.pop_clip_rect()

    def _draw_mark(self, mark: Mark, view: View, is_on: bool) -> None:
        mark_rays = 8  # of a mark
        em, drawing = imgui.get_font_size(), imgui.get_window_draw_list()
        chosen = mark.id == self.selected
        pointed = self._under is not None and self._under[0] == mark.id
        opacity = 1.0 if chosen or pointed or not mark.hidden else 0.35  # marks behind surfaces are faint
        edge = imgui.get_color_u32((*(theme.ACCENT if chosen else (0.05, 0.05, 0.06)), opacity))
        fill = imgui.get_color_u32((*((1.0, 0.88, 0.6) if is_on else (0.55, 0.55, 0.57)), opacity))
        if chosen:
            _draw_outline(mark.light, view, edge)
            self._draw_aim(mark, edge)
        r = 0.42 * em * (1.15 if pointed else 1.0)
        for k in range(mark_rays):
            c, s = math.cos(2 * math.pi * k / mark_rays), math.sin(2 * math.pi * k / mark_rays)
            a, b = r * 1.25, r * 1.25 + 0.24 * em
            ends = (mark.at[0] + a * c, mark.at[1] + a * s), (mark.at[0] + b * c, mark.at[1] + b * s)
            drawing.add_line(*ends, imgui.get_color_u32((0.05, 0.05, 0.06, 0.8 * opacity)), theme.pixels(3.0))
            drawing.add_line(*ends, fill, theme.pixels(1.5))
        drawing.add_circle_filled(mark.at, r, fill)
        drawing.add_circle(mark.at, r, edge, 0, theme.pixels(2.0))

    def _draw_aim(self, mark: Mark, colour: int) -> None:
        aim_em = 0.34  # radius of aims
        if self._aim is None:
            return
        em, drawing = imgui.get_font_size(), imgui.get_window_draw_list()
        drawing.add_line(mark.at, self._aim, colour, theme.pixels(1.5))
        drawing.add_circle(self._aim, aim_em * em, colour, 0, theme.pixels(2.0))
        drawing.add_circle_filled(self._aim, 0.3 * aim_em * em, colour)

    def hint(self, mode: str) -> str:
        """Return one line about the current drag, or a drag of the mark under the cursor; "" for neither."""
        if self.held is not None:
            return f"{words_for(self.held.id.name)} {WORDS[self.held.mode]}  ·  Esc cancels"
        if self._under is None:
            return ""
        light_id, aims = self._under
        if aims:
            return f"Drag the aim of {words_for(light_id.name)}: it {WORDS[AIM]}"
        keys = "" if mode != drag.SLIDE else "  ·  Shift: up and down  ·  Alt: in the image plane  ·  Ctrl: turn"
        return f"Drag {words_for(light_id.name)}: it {WORDS[mode]}{keys}"


def _draw_outline(light: PlacedLight, view: View, colour: int) -> None:
    """Draw the rectangle of a luminaire that has a size."""
    if not isinstance(light, PhotometricLight) or min(light.size) <= 0:
        return
    places = view.on_screen(rectangle_of(light))
    for p, q in zip(places, [*places[1:], places[0]], strict=True):
        if p is not None and q is not None:
            imgui.get_window_draw_list().add_line(p, q, colour, theme.pixels(2.0))

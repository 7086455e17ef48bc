"""Pins and the measuring plane over the picture, with their values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.draw.colour_map import sequential_colours
from app.window import label, theme

if TYPE_CHECKING:
    from app.rest.measuring_plane import PlaneLight
    from app.window.viewport import Viewport

DOT_EM = 0.28
MOST_NUMBERS = 300  # in the picture
LINE = (*theme.ACCENT, 0.9)


def draw(viewport: Viewport) -> None:
    """Draw the measuring plane and the pins into the current window."""
    (x, y), (w, h) = viewport.view.origin, viewport.view.size
    drawing = imgui.get_window_draw_list()
    drawing.push_clip_rect((x, y), (x + w, y + h), True)
    s = viewport.session
    if (plane := s.settings.plane) is not None:
        from app.rest.measuring_plane import grid_of

        _outline(viewport.view.on_screen(grid_of(plane, s.level).corners))
        light = s.light.snapshot.rest.plane
        if light is not None and light.plane == plane:
            _points(viewport, light)
    em = imgui.get_font_size()
    for (pin, _, reading), at in zip(viewport.pins.shown, viewport.pins.places(viewport.view), strict=True):
        if at is not None:
            _dot(at, theme.ACCENT, 1.0)
            known = reading is not None and math.isfinite(reading.irradiance)
            value = f": {number(reading.irradiance)} {reading.units.per_area}" if known else ""
            label.write(pin.name + value, at[0] + 0.6 * em, at[1] - 0.9 * em)
    drawing.pop_clip_rect()


def number(value: float) -> str:
    """Return a value in three digits, large ones in whole numbers."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _outline(corners: list[tuple[float, float] | None]) -> None:
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        if a is not None and b is not None:
            imgui.get_window_draw_list().add_line(a, b, imgui.get_color_u32(LINE), 1.5)


def _points(viewport: Viewport, light: PlaneLight) -> None:
    """Draw a dot per point, and its value where no other one stands."""
    em, drawing = imgui.get_font_size(), imgui.get_window_draw_list()
    known, scale = np.isfinite(light.values), viewport.picture.scale
    most = float(light.values[known].max(initial=0.0))
    position = light.values / max(most, 1e-300) if scale is None else scale.position(light.values)
    colours = sequential_colours(np.nan_to_num(position)).tolist()
    alpha = 1.0 if light.is_current else 0.4
    under = imgui.get_color_u32((*label.COLOUR[:3], label.COLOUR[3] * alpha))
    text_colour = imgui.get_color_u32((*theme.TEXT, alpha))
    written: list[tuple[float, float, float]] = []  # x, y and width of numbers
    for k, at in enumerate(viewport.view.on_screen(light.grid.positions)):
        if at is None or not known[k]:
            continue
        red, green, blue = colours[k]
        _dot(at, (red, green, blue), alpha)
        text = number(float(light.values[k]))
        size = imgui.calc_text_size(text)
        x, y, wide = at[0] - size.x / 2, at[1] + 0.35 * em, size.x + 0.6 * em
        if len(written) < MOST_NUMBERS and all(abs(x - a) > max(wide, b) or abs(y - c) > em for a, c, b in written):
            written.append((x, y, wide))
            drawing.add_rect_filled((x - 0.2 * em, y), (x + size.x + 0.2 * em, y + size.y), under, 0.2 * em)
            drawing.add_text((x, y), text_colour, text)


def _dot(at: tuple[float, float], colour: tuple[float, float, float], alpha: float) -> None:
    em, drawing = imgui.get_font_size(), imgui.get_window_draw_list()
    drawing.add_circle_filled(at, DOT_EM * em, imgui.get_color_u32((*colour, alpha)))
    drawing.add_circle(at, DOT_EM * em, imgui.get_color_u32((0.0, 0.0, 0.0, 0.8 * alpha)), 0, 1.2)

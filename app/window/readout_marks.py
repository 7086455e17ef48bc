"""Pins and the measuring plane over the picture, with their values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.draw.colour_map import sequential_colours
from app.window import label, legend, theme
from app.window.label_places import LabelPlaces

if TYPE_CHECKING:
    from app.rest.measuring_plane import PlaneLight
    from app.window.label_places import Box
    from app.window.viewport import Viewport

DOT_EM, GAP_EM = 0.28, 0.6  # radius of a dot, distance of its label
MOST_NUMBERS = 300  # in the picture
LINE = (*theme.ACCENT, 0.9)


def draw(viewport: Viewport) -> None:
    """Draw the measuring plane and the pins into the current window; their labels avoid the legend and each other."""
    (x, y), (w, h) = viewport.view.origin, viewport.view.size
    shown = viewport.legend
    places = LabelPlaces((x, y, x + w, y + h), [] if shown is None else [legend.box(shown, viewport.view)])
    drawing = imgui.get_window_draw_list()
    drawing.push_clip_rect((x, y), (x + w, y + h), True)
    pins = _labels_of_pins(viewport, places)
    s = viewport.session
    if (plane := s.settings.plane) is not None:
        from app.rest.measuring_plane import grid_of

        _outline(viewport.view.on_screen(grid_of(plane, s.level).corners))
        light = s.light.snapshot.rest.plane
        if light is not None and light.plane == plane:
            _points(viewport, light, places)
    for at, text, box in pins:
        _dot(at, theme.ACCENT, 1.0)
        if box is not None:
            _leader(at, box)
            label.draw(text, box)
    drawing.pop_clip_rect()


def _labels_of_pins(viewport: Viewport, places: LabelPlaces) -> list[tuple[tuple[float, float], str, Box | None]]:
    """Return point, text and box of the label of each pin in the picture; a label without room has no box."""
    em, seen = imgui.get_font_size(), []
    for (pin, _, reading), at in zip(viewport.pins.shown, viewport.pins.places(viewport.view), strict=True):
        if at is not None and viewport.view.contains(imgui.ImVec2(*at)):
            known = reading is not None and math.isfinite(reading.irradiance)
            value = f": {number(reading.irradiance)} {reading.units.per_area}" if known else ""
            seen.append((at, pin.name + value))
    for (px, py), _ in seen:
        places.take([(px - DOT_EM * em, py - DOT_EM * em, px + DOT_EM * em, py + DOT_EM * em)])
    return [(at, text, places.take(places.beside(at, label.plate(text), GAP_EM * em))) for at, text in seen]


def _leader(at: tuple[float, float], box: Box) -> None:
    """Draw a line from a point to a label that is not right beside it."""
    left, top, right, bottom = box
    if not top <= at[1] <= bottom:
        end = min(max(at[0], left), right), top if top > at[1] else bottom
        imgui.get_window_draw_list().add_line(at, end, imgui.get_color_u32(LINE), theme.pixels(1.0))


def number(value: float) -> str:
    """Return a value in three digits, large ones in whole numbers."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _outline(corners: list[tuple[float, float] | None]) -> None:
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        if a is not None and b is not None:
            imgui.get_window_draw_list().add_line(a, b, imgui.get_color_u32(LINE), theme.pixels(1.5))


def _points(viewport: Viewport, light: PlaneLight, places: LabelPlaces) -> None:
    """Draw a dot per point, and its value where there is room."""
    em, drawing = imgui.get_font_size(), imgui.get_window_draw_list()
    known, scale = np.isfinite(light.values), viewport.picture.scale
    most = float(light.values[known].max(initial=0.0))
    position = light.values / max(most, 1e-300) if scale is None else scale.position(light.values)
    colours = sequential_colours(np.nan_to_num(position)).tolist()
    alpha = 1.0 if light.is_current else 0.4
    under = imgui.get_color_u32((*label.COLOUR[:3], label.COLOUR[3] * alpha))
    text_colour = imgui.get_color_u32((*theme.TEXT, alpha))
    written = 0
    for k, at in enumerate(viewport.view.on_screen(light.grid.positions)):
        if at is None or not known[k]:
            continue
        red, green, blue = colours[k]
        _dot(at, (red, green, blue), alpha)
        text = number(float(light.values[k]))
        size = imgui.calc_text_size(text)
        x, y = at[0] - size.x / 2, at[1] + 0.35 * em
        box = x - 0.3 * em, y, x + size.x + 0.3 * em, y + size.y
        if written < MOST_NUMBERS and places.take([box]) is not None:
            written += 1
            drawing.add_rect_filled((x - 0.2 * em, y), (x + size.x + 0.2 * em, y + size.y), under, 0.2 * em)
            drawing.add_text((x, y), text_colour, text)


def _dot(at: tuple[float, float], colour: tuple[float, float, float], alpha: float) -> None:
    em, drawing = imgui.get_font_size(), imgui.get_window_draw_list()
    drawing.add_circle_filled(at, DOT_EM * em, imgui.get_color_u32((*colour, alpha)))
    drawing.add_circle(at, DOT_EM * em, imgui.get_color_u32((0.0, 0.0, 0.0, 0.8 * alpha)), 0, theme.pixels(1.2))

"""Pins, calculation surfaces and names of colours over the picture, in the window and in saved pictures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from imgui_bundle import imgui

from app.draw.colour_map import sequential_colours
from app.draw.legend import DOT_EM, LINE, LINE_EM, RIM_EM, RIM_OPACITY, Dot, Label, Marks, Point
from app.rest.calculation_surface import Grid, SurfaceLight
from app.session.readouts import unit_of
from app.window import label, legend
from app.window.camera_control import View
from app.window.label import Box, LabelPlaces
from app.window.view_content import RECOMPUTED, RECOMPUTED_NAMES
from app.window.viewport import Viewport
from gi_core.lights.daylight import axes_of, sun_of
from gi_core.scene.types import UNITS, CalculationSurface, Daylight

OF_BEFORE = 0.4  # opacity of numbers of the light before
COMPASS_EM, COMPASS_AT_EM = 1.8, (3.2, 6.0)  # radius of the compass; its middle from the lower left corner
SUN_COLOUR = 1.0, 0.83, 0.3


def draw(viewport: Viewport) -> None:
    """Draw calculation surfaces and pins into the current window."""
    (x, y), (w, h) = viewport.view.origin, viewport.view.size
    drawing, shapes = imgui.get_window_draw_list(), marks(viewport)
    em, line = shapes.em, imgui.get_color_u32((*LINE, 0.9))
    drawing.push_clip_rect((x, y), (x + w, y + h), True)
    for a, b in shapes.lines:
        drawing.add_line((x + a[0], y + a[1]), (x + b[0], y + b[1]), line, LINE_EM * em)
    for (across, down), colour, opacity in shapes.dots:
        at = x + across, y + down
        drawing.add_circle_filled(at, DOT_EM * em, imgui.get_color_u32((*colour, opacity)))
        rim = imgui.get_color_u32((0.0, 0.0, 0.0, RIM_OPACITY * opacity))
        drawing.add_circle(at, DOT_EM * em, rim, 0, RIM_EM * em)
    for text, (left, top, right, bottom), opacity, colour in shapes.labels:
        label.draw(text, (x + left, y + top, x + right, y + bottom), colour, opacity)
    drawing.pop_clip_rect()


def marks(viewport: Viewport) -> Marks:
    """Return the marks of surfaces, pins and colours; their labels avoid the legend and each other."""
    view, shown, em = viewport.view, viewport.legend, imgui.get_font_size()
    shapes = Marks(em, [], [], list(_names_of_colours(viewport)))
    taken = [named.box for named in shapes.labels]
    taken += [] if shown is None else [_in_picture(legend.box(shown, view), view)]
    places = LabelPlaces((0.0, 0.0, *view.size), taken)
    pins = _labels_of_pins(viewport, places)
    s = viewport.session
    lights = {light.surface: light for light in s.light.snapshot.rest.surfaces}
    for surface, grid in s.grids:
        corners = _seen(viewport, grid.corners)
        around = zip(corners, [*corners[1:], corners[0]], strict=True)
        shapes.lines.extend((a, b) for a, b in around if a is not None and b is not None)
        if surface.name in view.folded:
            _mean(viewport, surface, lights.get(surface), grid, places, shapes)
        elif (light := lights.get(surface)) is not None:
            _points(viewport, light, places, shapes)
    if s.daylight is not None:
        _compass(viewport, s.daylight, shapes)
    for at, text, box in pins:
        shapes.dots.append(Dot(at, LINE, 1.0))
        if box is not None:
            left, top, right, bottom = box
            if not top <= at[1] <= bottom:  # not right beside its point
                shapes.lines.append((at, (min(max(at[0], left), right), top if top > at[1] else bottom)))
            shapes.labels.append(Label(text, box, 1.0 if s.is_current else OF_BEFORE))
    return shapes


def _compass(viewport: Viewport, daylight: Daylight, shapes: Marks) -> None:
    """Add a sun-path diagram: its rim is the horizon, its middle the zenith, and its top where the camera looks."""
    scene, em = viewport.session.scene, shapes.em
    east, north, up = axes_of(daylight, scene.up)
    right = viewport.view.camera.basis()[0]
    ahead = np.cross(up, right)
    middle = COMPASS_AT_EM[0] * em, viewport.view.size[1] - COMPASS_AT_EM[1] * em

    def place(direction: np.ndarray, radius: float) -> Point:
        r = COMPASS_EM * em * radius / max(math.hypot(direction @ right, direction @ ahead), 1e-9)
        return middle[0] + r * float(direction @ right), middle[1] - r * float(direction @ ahead)

    turns = np.linspace(0, 2 * np.pi, 33)
    shapes.lines.extend(itertools.pairwise(place(np.cos(t) * north + np.sin(t) * east, 1.0) for t in turns))
    shapes.lines.append((place(north, 0.7), place(north, 1.0)))
    (x, y), (w, h) = place(north, 1.45), imgui.calc_text_size("N")
    shapes.labels.append(Label("N", (x - w / 2, y - h / 2, x + w / 2, y + h / 2), 1.0))
    sun = sun_of(daylight)
    if sun.altitude > 0:
        a = math.radians(sun.azimuth)
        shapes.dots.append(Dot(place(math.cos(a) * north + math.sin(a) * east, 1 - sun.altitude / 90), SUN_COLOUR, 1.0))


def _names_of_colours(viewport: Viewport) -> Iterator[Label]:
    """Yield the names of the colours that show how receivers were computed, down the right edge of the picture."""
    shown, em = viewport.shown, imgui.get_font_size()
    if shown is None or shown.recomputed is None:
        return
    right = viewport.view.size[0] - em
    for k, (name, colour) in enumerate(zip(RECOMPUTED_NAMES, RECOMPUTED, strict=True)):
        width, height = label.plate(name)
        top = (1 + 1.7 * (k + bool(shown.coming))) * em  # the work to come is written in the first row
        yield Label(name, (right - width, top, right, top + height), 1.0, colour)


def _in_picture(box: Box, view: View) -> Box:
    """Return a box of the window relative to the picture's upper left corner."""
    (x, y), (left, top, right, bottom) = view.origin, box
    return left - x, top - y, right - x, bottom - y


def _seen(viewport: Viewport, points: np.ndarray) -> list[Point | None]:
    """Return where points (n, 3) [m] are in the picture; None behind the eye."""
    x, y = viewport.view.origin
    return [None if at is None else (at[0] - x, at[1] - y) for at in viewport.view.on_screen(points)]


def _labels_of_pins(viewport: Viewport, places: LabelPlaces) -> list[tuple[Point, str, Box | None]]:
    """Return point, text and box of the label of each pin in the picture; a label without room has no box."""
    em, texts = imgui.get_font_size(), []
    (w, h), pins = viewport.view.size, viewport.pins.shown
    seen = _seen(viewport, np.array([p.position for p in pins]).reshape(-1, 3))
    for (pin, _, reading), at in zip(pins, seen, strict=True):
        if at is not None and 0 <= at[0] < w and 0 <= at[1] < h:
            is_finite = reading is not None and math.isfinite(reading.irradiance)
            value = f": {number(reading.irradiance)} {reading.units.per_area}" if is_finite else ""
            texts.append((at, pin.name + value))
    for (x, y), _ in texts:
        places.take([(x - DOT_EM * em, y - DOT_EM * em, x + DOT_EM * em, y + DOT_EM * em)])
    # 0.6 em between a pin and its label
    return [(at, text, places.take(places.beside(at, label.plate(text, w), 0.6 * em))) for at, text in texts]


def number(value: float) -> str:
    """Return a value in three digits, large ones in whole numbers."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _mean(
    viewport: Viewport, surface: CalculationSurface, light: SurfaceLight | None, grid: Grid, places: LabelPlaces,
    shapes: Marks,
) -> None:  # fmt: skip
    """Add name and mean of a surface, near its middle; light: None before it is measured."""
    (at,), text = _seen(viewport, grid.corners.mean(axis=0)[None]), surface.name
    if light is not None and math.isfinite(mean := light.numbers.mean[0]):
        text += f": {number(mean)} {unit_of(surface, UNITS[viewport.session.scene.units])}".rstrip()
    if at is not None and (box := places.take(places.beside(at, label.plate(text), 0.0))) is not None:
        shapes.labels.append(Label(text, box, 1.0 if light is None or light.is_current else OF_BEFORE))


def _points(viewport: Viewport, light: SurfaceLight, places: LabelPlaces, shapes: Marks) -> None:
    """Add a dot per point, and its value where there is room."""
    em = shapes.em
    finite, scale = np.isfinite(light.values), viewport.picture.scale
    most = float(light.values[finite].max(initial=0.0))
    position = light.values / max(most, 1e-300) if scale is None else scale.position(light.values)
    colours = sequential_colours(np.nan_to_num(position)).tolist()
    opacity = 1.0 if light.is_current else OF_BEFORE
    for at, is_known, (red, green, blue), value in zip(
        _seen(viewport, light.grid.positions), finite, colours, light.values.tolist(), strict=True
    ):
        if at is None or not is_known:
            continue
        shapes.dots.append(Dot(at, (red, green, blue), opacity))
        text = number(value)
        size = imgui.calc_text_size(text)
        half, top = size.x / 2 + 0.3 * em, at[1] + 0.35 * em
        box = at[0] - half, top, at[0] + half, top + size.y
        if len(shapes.labels) < 300 and places.take([box]) is not None:  # 300 numbers in the picture at most
            shapes.labels.append(Label(text, box, opacity))

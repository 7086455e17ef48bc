"""Legends of the error map and of false colours: colour scale, ticks, units; the scale that suits the picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from app.draw.camera import Turntable
from app.draw.colour_map import UNKNOWN_COLOUR, signed_colours
from app.draw.false_colour import LIGHT_FROM, LINE_OPACITY, LINE_PIXELS, Scale, automatic_scale, fixed_scale
from app.draw.legend import COLOUR_STEPS, PLATE, PLATE_OPACITY, TICK_EM, Layout, Legend, layout
from app.draw.raycast import visible_light
from app.session.session import Session
from app.settings import FALSE_COLOURS
from app.window import theme
from app.window.camera_control import View
from app.window.label import Box
from app.window.view_content import Change, Errors, Shown

NO_DATA = "no reference yet"
MINUS = "\N{MINUS SIGN}"


def of_errors(errors: Errors | Change) -> Legend:
    """Return the legend of an error map, or of a map of changes."""
    colours, places = signed_colours(np.linspace(-1, 1, COLOUR_STEPS + 1)), (1, 0.5, 0, -0.5, -1)
    if isinstance(errors, Errors):
        ticks = [((1 + tick) / 2, tick_text(tick, errors.scale)) for tick in places]
        return Legend(texts(errors), ticks, colours, unknown=NO_DATA)
    ends = {1.0: " or more", -1.0: " or less"}
    ticks = [((1 + k) / 2, f"{k * errors.scale:+g}{ends.get(k, '')}".replace("-", MINUS)) for k in places if k]
    lines = [f"Change since A [{errors.units.per_area}]", "grey: below two standard errors"]
    return Legend(lines, [*ticks, (0.5, "0")], colours, unknown="error not yet known")


def _layout(legend: Legend, view: View) -> Layout:
    em = imgui.get_font_size()
    right, bottom = (o + s - em for o, s in zip(view.origin, view.size, strict=True))
    return layout(legend, em, lambda text: imgui.calc_text_size(text).x, right, bottom)


def box(legend: Legend, view: View) -> Box:
    """Return the legend's box, in the lower right corner of the picture."""
    return _layout(legend, view).plate


def draw(legend: Legend, view: View) -> None:
    """Draw the legend over the picture."""
    em, at, drawing = imgui.get_font_size(), _layout(legend, view), imgui.get_window_draw_list()
    text, dim = imgui.get_color_u32((*theme.TEXT, 1.0)), imgui.get_color_u32((*theme.DIM_TEXT, 1.0))
    drawing.add_rect_filled(at.plate[:2], at.plate[2:], imgui.get_color_u32((*PLATE, PLATE_OPACITY)), 0.35 * em)
    for k, (corner, caption) in enumerate(zip(at.captions, legend.lines, strict=True)):
        drawing.add_text(corner, text if k == 0 else dim, caption)
    left, _, right, _ = at.bar
    colours = legend.colours
    for k in range(COLOUR_STEPS):
        upper, lower = (imgui.get_color_u32((*map(float, colours[i]), 1.0)) for i in (k + 1, k))
        high, low = (at.y(i / COLOUR_STEPS) for i in (k + 1, k))
        drawing.add_rect_filled_multi_color((left, high), (right, low), upper, upper, lower, lower)
    for position in legend.marks:
        mark = imgui.get_color_u32((*([1.0] if position < LIGHT_FROM else [0.0]) * 3, LINE_OPACITY))
        drawing.add_line((left, at.y(position)), (right, at.y(position)), mark, theme.pixels(LINE_PIXELS))
    for position, words in legend.ticks:
        y = at.y(position)
        drawing.add_line((right, y), (right + TICK_EM * em, y), dim, theme.pixels(1.0))
        drawing.add_text((at.labels, y - 0.5 * em), text, words)
    if legend.unknown:
        upper_left, lower_right = at.swatch[:2], at.swatch[2:]
        drawing.add_rect_filled(upper_left, lower_right, imgui.get_color_u32((*UNKNOWN_COLOUR, 1.0)), 0.2 * em)
        drawing.add_rect(upper_left, lower_right, dim, 0.2 * em)
        drawing.add_text((at.labels, at.swatch[1]), dim, legend.unknown)


def texts(errors: Errors) -> list[str]:
    """Return the caption, one string per line."""
    noise = f"reference noise ±{100 * errors.noise:.2g} %" if math.isfinite(errors.noise) else "reference noise unknown"
    return ["Error of irradiance", "relative to the reference", noise]


def tick_text(tick: float, scale: float) -> str:
    """Return the label of a tick; the ends of the scale include all larger errors."""
    if tick == 0:
        return "0 %"
    number = f"{100 * tick * scale:+.3g} %".replace("-", MINUS)
    return number + {1.0: " or more (too bright)", -1.0: " or less (too dark)"}.get(tick, "")


class ScaleFit:
    """`update` once per frame, `forget` with each new session. A fit takes 3 to 5 ms, of luminance with gloss 17."""

    def __init__(self) -> None:
        self.scale: Scale | None = None
        self._asked: tuple | None = None  # arguments of the last scale
        self._levels: bytes | None = None  # of the lamps in the last scale; None: of another scene, or none
        self._seen_from: Turntable | None = None  # camera of the last frame

    def update(self, s: Session, view: View, shown: Shown | None, at_rest: bool) -> None:
        """Fit the scale to the picture: with other lamps at once, else at rest, so that colours do not flicker."""
        at_rest, self._seen_from = at_rest and view.camera == self._seen_from, view.camera  # the wheel turns, or not
        if s.settings.show not in FALSE_COLOURS or shown is None:
            self.scale = self._asked = None
            return
        quantity, ends, lines = s.settings.show, s.settings.false_colour_range, s.settings.false_colour_lines
        asked = s.version, view.camera, view.aspect, s.settings.cull, quantity, ends, lines
        levels = s.light.snapshot.levels.tobytes()
        if asked == self._asked or not (at_rest or self.scale is None or levels != self._levels):
            return
        self._asked, self._levels = asked, levels
        if ends is not None:
            self.scale = fixed_scale(*ends, quantity).with_lines(lines)
            return
        lit, camera = replace(s.lit, drawn=shown.side.drawn), view.camera.relative_to(s.model.origins[0])
        seen = visible_light(lit, camera, view.aspect, s.settings.cull)
        self.scale = automatic_scale(seen, quantity).with_lines(lines)

    def forget(self) -> None:
        """Fit again in the next frame."""
        self._asked = self._levels = None

"""Legends of the error map and of false colours: colour scale, ticks, units."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.draw.colour_map import UNKNOWN, signed_colours
from app.draw.false_colour import LIGHT_FROM, LINE_OPACITY, LINE_PIXELS
from app.draw.legend import COLOUR_STEPS, HEIGHT_EM, WIDTH_EM, Legend
from app.draw.marks import PLATE, PLATE_OPACITY
from app.window import theme
from app.window.view_content import Errors

if TYPE_CHECKING:
    from app.window.label import Box
    from app.window.view import View

BESIDE_EM = WIDTH_EM + 0.6  # from the bar's left edge to the ticks' labels
PAD_EM, CAPTION_EM = 0.7, 1.25
NO_DATA = "no reference yet"
TICKS = (1.0, 0.5, 0.0, -0.5, -1.0)  # of the scale


def of_errors(errors: Errors) -> Legend:
    """Return the legend of an error map."""
    ticks = [((1 + tick) / 2, tick_text(tick, errors.scale)) for tick in TICKS]
    return Legend(texts(errors), ticks, signed_colours(np.linspace(-1, 1, COLOUR_STEPS + 1)), unknown=NO_DATA)


def box(legend: Legend, view: View) -> Box:
    """Return the legend's box, in the lower right corner of the picture."""
    em = imgui.get_font_size()
    right, bottom = (o + s - em for o, s in zip(view.origin, view.size, strict=True))
    swatch_label = [legend.unknown] if legend.unknown else []
    widest = max(imgui.calc_text_size(text).x for text in (*(t for _, t in legend.ticks), *swatch_label))
    width = max(widest + BESIDE_EM * em, *(imgui.calc_text_size(text).x for text in legend.lines))
    lines = len(legend.lines) + (2.2 if legend.unknown else 1.0)
    height = HEIGHT_EM + lines * CAPTION_EM
    return right - width - 2 * PAD_EM * em, bottom - (height + 2 * PAD_EM) * em, right, bottom


def draw(legend: Legend, view: View) -> None:
    """Draw the legend over the picture."""
    em = imgui.get_font_size()
    pad, line, beside = PAD_EM * em, CAPTION_EM * em, BESIDE_EM * em
    x, y, right, bottom = box(legend, view)
    drawing = imgui.get_window_draw_list()
    text, dim = imgui.get_color_u32((*theme.TEXT, 1.0)), imgui.get_color_u32((*theme.DIM, 1.0))
    drawing.add_rect_filled((x, y), (right, bottom), imgui.get_color_u32((*PLATE, PLATE_OPACITY)), 0.35 * em)
    for k, caption in enumerate(legend.lines):
        drawing.add_text((x + pad, y + pad + k * line), text if k == 0 else dim, caption)
    top = y + pad + (len(legend.lines) + 0.5) * line
    left = x + pad
    colours = legend.colours[::-1]
    for k in range(COLOUR_STEPS):
        a, b = (imgui.get_color_u32((*map(float, colours[i]), 1.0)) for i in (k, k + 1))
        low, high = (top + HEIGHT_EM * em * i / COLOUR_STEPS for i in (k, k + 1))
        drawing.add_rect_filled_multi_color((left, low), (left + WIDTH_EM * em, high), a, a, b, b)
    for position in legend.marks:
        at = top + HEIGHT_EM * em * (1 - position)
        mark = imgui.get_color_u32((*([1.0] if position < LIGHT_FROM else [0.0]) * 3, LINE_OPACITY))
        drawing.add_line((left, at), (left + WIDTH_EM * em, at), mark, theme.pixels(LINE_PIXELS))
    for position, words in legend.ticks:
        at = top + HEIGHT_EM * em * (1 - position)
        drawing.add_line((left + WIDTH_EM * em, at), (left + (WIDTH_EM + 0.3) * em, at), dim, theme.pixels(1.0))
        drawing.add_text((left + beside, at - 0.5 * em), text, words)
    if not legend.unknown:
        return
    swatch = top + HEIGHT_EM * em + 0.5 * line
    drawing.add_rect_filled(
        (left, swatch), (left + WIDTH_EM * em, swatch + em), imgui.get_color_u32((*UNKNOWN, 1.0)), 0.2 * em
    )
    drawing.add_rect((left, swatch), (left + WIDTH_EM * em, swatch + em), dim, 0.2 * em)
    drawing.add_text((left + beside, swatch), dim, legend.unknown)


def texts(errors: Errors) -> list[str]:
    """Return the caption, one string per line."""
    noise = f"reference noise ±{100 * errors.noise:.2g} %" if math.isfinite(errors.noise) else "reference noise unknown"
    return ["Error of irradiance", "relative to the reference", noise]


def tick_text(tick: float, scale: float) -> str:
    """Return the label of a tick; the ends of the scale include all larger errors."""
    if tick == 0:
        return "0 %"
    number = f"{100 * tick * scale:+.3g} %".replace("-", "\N{MINUS SIGN}")
    return number + {1.0: " or more (too bright)", -1.0: " or less (too dark)"}.get(tick, "")

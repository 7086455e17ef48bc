"""Legends and marks over a picture, drawn into files.

A legend is of false colours or of the error map; its layout serves the window too (app/window/legend.py). Marks are
lines, dots and labels, which readout_marks.py draws into the window.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from app.draw.colour_map import UNKNOWN_COLOUR, sequential_colours
from app.draw.false_colour import LIGHT_FROM, Scale
from gi_core.scene.types import Units

HEIGHT_EM, WIDTH_EM = 11.0, 1.1  # of the bar
TICK_EM = 0.3  # from the bar to the ends of ticks
COLOUR_STEPS = 64

Box = tuple[float, float, float, float]  # left, top, right, bottom
DOT_EM, LINE_EM, RIM_EM = 0.28, 0.09, 0.075  # radius of a dot, width of lines and of a dot's rim
LINE = (0.918, 0.655, 0.298)
RIM_OPACITY = 0.8
PLATE, TEXT = (0.06, 0.062, 0.068), (0.870, 0.875, 0.885)
PLATE_OPACITY, ROUND_EM = 0.78, 0.3

Point = tuple[float, float]


class Legend(NamedTuple):
    """Content of a legend."""

    lines: list[str]  # caption; the first is the title
    ticks: list[tuple[float, str]]  # position from 0 (bottom) to 1 (top), label
    colours: np.ndarray  # (COLOUR_STEPS + 1, 3) display colours from bottom to top
    marks: tuple[float, ...] = ()  # positions of isolines
    unknown: str = ""  # label of the colour for surfaces without a value; "": there are none


def of_scale(scale: Scale, units: Units) -> Legend:
    """Return the legend of false colours."""
    marks = tuple(scale.position(np.array(scale.lines)).tolist()) if scale.lines else ()
    return Legend(scale.title(units), scale.labels, sequential_colours(np.linspace(0, 1, COLOUR_STEPS + 1)), marks)


class Layout(NamedTuple):
    """Places of a legend's parts."""

    plate: Box
    captions: list[tuple[float, float]]  # upper left corner of each line
    bar: Box
    labels: float  # x of the labels' left ends
    swatch: Box  # of the colour for surfaces without a value, if there are any

    def y(self, position: float) -> float:
        """Return the height of a position of the scale, from 0 (bottom) to 1 (top)."""
        _, top, _, bottom = self.bar
        return top + (bottom - top) * (1 - position)


def layout(legend: Legend, em: float, width_of: Callable[[str], float], right: float, bottom: float) -> Layout:
    """Return the layout of a legend whose plate ends at `right` and `bottom`; em: height of the font, in their unit.

    width_of: the width of a text.
    """
    pad_em, row_em = 0.7, 1.25
    pad, row, bar = pad_em * em, row_em * em, WIDTH_EM * em
    beside = (WIDTH_EM + 0.6) * em
    labels = [text for _, text in legend.ticks] + ([legend.unknown] if legend.unknown else [])
    width = max(max(map(width_of, labels)) + beside, *map(width_of, legend.lines))
    rows = len(legend.lines) + (2.2 if legend.unknown else 1.0)
    x, y = right - width - 2 * pad, bottom - (HEIGHT_EM + rows * row_em + 2 * pad_em) * em
    left, top = x + pad, y + pad + (len(legend.lines) + 0.5) * row
    end = top + HEIGHT_EM * em
    captions = [(left, y + pad + k * row) for k in range(len(legend.lines))]
    swatch = left, end + 0.5 * row, left + bar, end + 0.5 * row + em
    return Layout((x, y, right, bottom), captions, (left, top, left + bar, end), left + beside, swatch)


def with_legend(picture: np.ndarray, legend: Legend) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 with the legend in its lower right corner; unchanged if it is too small."""
    legend_text = (235, 236, 238)
    h, w = picture.shape[:2]
    em = max(h // 50, 9)
    font = ImageFont.load_default(em)
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image, "RGBA")
    at = layout(legend, em, lambda text: draw.textlength(plain(text), font), w - em, h - em)
    if min(at.plate) < 0:
        return picture
    _draw_plate(draw, at.plate, 0.35 * em, (15, 16, 17, 210))
    for corner, line in zip(at.captions, legend.lines, strict=True):
        draw.text(corner, plain(line), legend_text, font)
    left, top, right, _ = at.bar
    rows = round(HEIGHT_EM * em)
    places, steps = np.linspace(1, 0, rows), np.linspace(0, 1, len(legend.colours))
    bar = np.round(255 * np.stack([np.interp(places, steps, c) for c in legend.colours.T], axis=1)).astype(np.uint8)
    image.paste(Image.fromarray(np.repeat(bar[:, None], round(WIDTH_EM * em), axis=1)), (round(left), round(top)))
    for position in legend.marks:
        y = at.y(position)
        draw.line((left, y, right, y), (255, 255, 255, 255) if position < LIGHT_FROM else (0, 0, 0, 255))
    for position, text in legend.ticks:
        y = at.y(position)
        draw.line((right, y, right + TICK_EM * em, y), legend_text)
        draw.text((at.labels, y), plain(text), legend_text, font, anchor="lm")
    if legend.unknown:
        draw.rectangle(at.swatch, tuple(round(255 * c) for c in UNKNOWN_COLOUR), legend_text)
        draw.text((at.labels, (at.swatch[1] + at.swatch[3]) / 2), plain(legend.unknown), legend_text, font, anchor="lm")
    return np.asarray(image)


def _draw_plate(draw: ImageDraw.ImageDraw, box: Box, radius: float, colour: tuple[int, int, int, int]) -> None:
    """Draw a plate between whole pixels: elsewhere Pillow draws some of its parts twice."""
    draw.rounded_rectangle(tuple(map(round, box)), round(radius), colour)


def plain(text: str) -> str:
    """Return text without characters that Pillow's font lacks."""
    return text.replace("²", "2").replace("\N{MINUS SIGN}", "-")


class Dot(NamedTuple):
    """A point of light."""

    at: Point
    colour: tuple[float, float, float]
    opacity: float


class Label(NamedTuple):
    """A text in the middle of a plate."""

    text: str
    box: tuple[float, float, float, float]  # left, top, right, bottom
    opacity: float
    colour: tuple[float, float, float] = TEXT


class Marks(NamedTuple):
    """Marks in the order of drawing: lines, dots, labels; places in points from the picture's upper left corner."""

    em: float  # height of the font [points]
    lines: list[tuple[Point, Point]]
    dots: list[Dot]
    labels: list[Label]


def with_marks(picture: np.ndarray, marks: Marks, scale: float) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 with the marks; scale: pixels per point."""
    image, em = Image.fromarray(picture), marks.em * scale
    draw = ImageDraw.Draw(image, "RGBA")
    font = ImageFont.load_default(max(0.86 * em, 6))  # size of Pillow's font, of the height of a line
    for a, b in marks.lines:
        draw.line([(scale * x, scale * y) for x, y in (a, b)], _colour(LINE, 0.9), max(round(LINE_EM * em), 1))
    for (x, y), colour, opacity in marks.dots:
        around = [scale * c + sign * DOT_EM * em for sign in (-1, 1) for c in (x, y)]
        rim = _colour((0.0, 0.0, 0.0), RIM_OPACITY * opacity)
        draw.ellipse(around, _colour(colour, opacity), rim, max(round(RIM_EM * em), 1))
    for text, box, opacity, colour in marks.labels:
        left, top, right, bottom = (scale * side for side in box)
        middle = (left + right) / 2, (top + bottom) / 2
        _draw_plate(draw, (left, top, right, bottom), ROUND_EM * em, _colour(PLATE, PLATE_OPACITY * opacity))
        draw.text(middle, plain(text), _colour(colour, opacity), font, anchor="mm")
    return np.asarray(image)


def _colour(rgb: tuple[float, float, float], opacity: float) -> tuple[int, int, int, int]:
    red, green, blue = (round(255 * c) for c in rgb)
    return red, green, blue, round(255 * opacity)

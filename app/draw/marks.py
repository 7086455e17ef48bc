"""Marks over a picture: lines, dots and labels; drawn into picture files here, into the window by readout_marks.py."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from app.draw.legend import plain

DOT_EM, LINE_EM, RIM_EM = 0.28, 0.09, 0.075  # radius of a dot, width of lines and of a dot's rim
LINE = (0.918, 0.655, 0.298)
RIM_OPACITY = 0.8
PLATE, TEXT = (0.06, 0.062, 0.068), (0.870, 0.875, 0.885)
PLATE_OPACITY, ROUND_EM = 0.78, 0.3
FONT, LEAST_PIXELS = 0.86, 6  # size of Pillow's font, of the height of a line; least size

Point = tuple[float, float]


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
    font = ImageFont.load_default(max(FONT * em, LEAST_PIXELS))
    for a, b in marks.lines:
        draw.line([(scale * x, scale * y) for x, y in (a, b)], _colour(LINE, 0.9), max(round(LINE_EM * em), 1))
    for (x, y), colour, opacity in marks.dots:
        around = [scale * c + sign * DOT_EM * em for sign in (-1, 1) for c in (x, y)]
        rim = _colour((0.0, 0.0, 0.0), RIM_OPACITY * opacity)
        draw.ellipse(around, _colour(colour, opacity), rim, max(round(RIM_EM * em), 1))
    for text, box, opacity in marks.labels:
        left, top, right, bottom = (scale * side for side in box)
        middle = (left + right) / 2, (top + bottom) / 2
        draw.rounded_rectangle((left, top, right, bottom), ROUND_EM * em, _colour(PLATE, PLATE_OPACITY * opacity))
        draw.text(middle, plain(text), _colour(TEXT, opacity), font, anchor="mm")
    return np.asarray(image)


def _colour(rgb: tuple[float, float, float], opacity: float) -> tuple[int, int, int, int]:
    red, green, blue = (round(255 * c) for c in rgb)
    return red, green, blue, round(255 * opacity)

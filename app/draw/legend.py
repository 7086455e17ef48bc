"""Legends of false colours and of the error map, drawn into a picture file; app/window/legend.py draws the window's."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from app.draw.colour_map import sequential_colours
from app.draw.false_colour import LIGHT_FROM, Scale
from app.draw.units import Units

HEIGHT_EM, WIDTH_EM = 11.0, 1.1  # of the bar
ROW_EM = 1.3
MARGIN_EM = 0.8
PLATE, TEXT = (15, 16, 17, 210), (235, 236, 238)
LIGHT_MARK, DARK_MARK = (255, 255, 255, 255), (0, 0, 0, 255)
LEAST_EM = 9  # pixels
COLOUR_STEPS = 64


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


def with_legend(picture: np.ndarray, legend: Legend) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 with the legend in its lower right corner; unchanged if it is too small."""
    h, w = picture.shape[:2]
    em = max(h // 50, LEAST_EM)
    font = ImageFont.load_default(em)
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image, "RGBA")
    lines, labels = [plain(line) for line in legend.lines], [(at, plain(text)) for at, text in legend.ticks]
    margin = MARGIN_EM * em
    beside = (WIDTH_EM + 0.6) * em
    width = max(*(draw.textlength(t, font) for t in lines), *(beside + draw.textlength(t, font) for _, t in labels))
    head = (len(lines) + 0.5) * ROW_EM * em
    height = head + (HEIGHT_EM + 0.5) * em
    left, top = w - width - 2 * margin, h - height - 2 * margin
    if left < 0 or top < 0:
        return picture
    draw.rounded_rectangle((left - margin, top - margin, w - margin, h - margin), 0.35 * em, PLATE)
    for k, line in enumerate(lines):
        draw.text((left, top + k * ROW_EM * em), line, TEXT, font)
    rows = round(HEIGHT_EM * em)
    places, steps = np.linspace(1, 0, rows), np.linspace(0, 1, len(legend.colours))
    bar = np.round(255 * np.stack([np.interp(places, steps, c) for c in legend.colours.T], axis=1)).astype(np.uint8)
    image.paste(
        Image.fromarray(np.repeat(bar[:, None], round(WIDTH_EM * em), axis=1)), (round(left), round(top + head))
    )
    for position in legend.marks:
        y = top + head + (1 - position) * (rows - 1)
        draw.line((left, y, left + WIDTH_EM * em, y), LIGHT_MARK if position < LIGHT_FROM else DARK_MARK)
    for position, text in labels:
        y = top + head + (1 - position) * (rows - 1)
        draw.line((left + WIDTH_EM * em, y, left + (WIDTH_EM + 0.3) * em, y), TEXT)
        draw.text((left + beside, y), text, TEXT, font, anchor="lm")
    return np.asarray(image)


def plain(text: str) -> str:
    """Return text without characters that Pillow's font lacks."""
    return text.replace("²", "2").replace("\N{MINUS SIGN}", "-")

"""The legend of false colours in a picture file; app/window/legend.py draws the window's."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from app.draw.colour_map import sequential_colours
from app.draw.false_colour import Scale
from app.draw.units import Units

HEIGHT_EM, WIDTH_EM = 11.0, 1.1  # of the bar
LINE_EM = 1.3
MARGIN_EM = 0.8
PLATE, TEXT = (15, 16, 17, 210), (235, 236, 238)
LEAST_EM = 9  # pixels


def with_legend(picture: np.ndarray, scale: Scale, units: Units) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 with the legend in its lower right corner; unchanged if it is too small."""
    h, w = picture.shape[:2]
    em = max(h // 50, LEAST_EM)
    font = ImageFont.load_default(em)
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image, "RGBA")
    lines = [line.replace("²", "2") for line in scale.title(units)]  # Pillow's font has no superscripts
    labels, margin = scale.labels, MARGIN_EM * em
    beside = (WIDTH_EM + 0.6) * em
    width = max(*(draw.textlength(t, font) for t in lines), *(beside + draw.textlength(t, font) for _, t in labels))
    head = (len(lines) + 0.5) * LINE_EM * em
    height = head + (HEIGHT_EM + 0.5) * em
    left, top = w - width - 2 * margin, h - height - 2 * margin
    if left < 0 or top < 0:
        return picture
    draw.rounded_rectangle((left - margin, top - margin, w - margin, h - margin), 0.35 * em, PLATE)
    for k, line in enumerate(lines):
        draw.text((left, top + k * LINE_EM * em), line, TEXT, font)
    rows = round(HEIGHT_EM * em)
    bar = np.round(255 * sequential_colours(np.linspace(1, 0, rows))).astype(np.uint8)
    image.paste(
        Image.fromarray(np.repeat(bar[:, None], round(WIDTH_EM * em), axis=1)), (round(left), round(top + head))
    )
    for position, text in labels:
        y = top + head + (1 - position) * (rows - 1)
        draw.line((left + WIDTH_EM * em, y, left + (WIDTH_EM + 0.3) * em, y), TEXT)
        draw.text((left + beside, y), text, TEXT, font, anchor="lm")
    return np.asarray(image)

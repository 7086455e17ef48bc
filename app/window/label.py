"""Text on a dark plate over the picture."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from imgui_bundle import imgui

from app.draw.legend import PLATE, PLATE_OPACITY, ROUND_EM
from app.window import theme

MARGIN_EM = 1.0  # between plates and the edges of the window


def plate(text: str, room: float | None = None) -> tuple[float, float]:
    """Return width and height [points] of a text's plate; lines wrap at `room`, by default that of the window."""
    pad, vertical = _pads()
    size = imgui.calc_text_size(text, wrap_width=max(_room(room) - 2 * pad, 1.0))
    return size.x + 2 * pad, size.y + 2 * vertical


def box(text: str, x: float, y: float, centred: bool = False, right: bool = False, room: float | None = None) -> Box:
    """Return the box of a text's plate, arguments as for write(); it ends above the lower edge of the window."""
    width, height = plate(text, room)
    if centred:
        x, y = x - width / 2, y - height / 2
    x -= width if right else 0.0
    y = min(y, imgui.get_window_pos().y + imgui.get_window_height() - MARGIN_EM * imgui.get_font_size() - height)
    return x, y, x + width, y + height


def write(
    text: str, x: float, y: float, colour=theme.TEXT, centred=False, right=False, room: float | None = None
) -> None:
    """Write text on a dark plate, readable on any scene.

    (x, y): upper left corner of the plate, its centre if `centred`, upper right if `right`; room: largest width
    [points].
    """
    draw(text, box(text, x, y, centred, right, room), colour)


def draw(text: str, at: Box, colour=theme.TEXT, opacity: float = 1.0) -> None:
    """Draw a text in the middle of a plate; at: the plate's box."""
    left, top, right, bottom = at
    size, (pad, _) = imgui.get_font_size(), _pads()
    drawing, under = imgui.get_window_draw_list(), (*PLATE, PLATE_OPACITY * opacity)
    drawing.add_rect_filled((left, top), (right, bottom), imgui.get_color_u32(under), ROUND_EM * size)
    wrap = right - left - pad  # wider than the text of a plate, narrower than the plate
    text_size = imgui.calc_text_size(text, wrap_width=wrap)
    start = (left + right - text_size.x) / 2, (top + bottom - text_size.y) / 2
    drawing.add_text(imgui.get_font(), size, start, imgui.get_color_u32((*colour, opacity)), text, wrap_width=wrap)


def _pads() -> tuple[float, float]:
    em = imgui.get_font_size()
    return 0.6 * em, 0.3 * em


def _room(room: float | None) -> float:
    return imgui.get_window_width() - 2 * MARGIN_EM * imgui.get_font_size() if room is None else room


ROWS, COLUMNS = 8, 2  # of boxes above and below a point, and on either side of it
SLACK = 1.0  # points that neighbours may share
Box = tuple[float, float, float, float]  # left, top, right, bottom [points]


class LabelPlaces:
    """Boxes that are taken, inside an area."""

    def __init__(self, area: Box, taken: Iterable[Box] = ()) -> None:
        self._area = area
        self._taken = list(taken)

    def take(self, wanted: Iterable[Box]) -> Box | None:
        """Take the first box that is free and inside the area, and return it; None without one."""
        left, top, right, bottom = self._area
        for box in wanted:
            a, b, c, d = box
            inside = a >= left and b >= top and c <= right and d <= bottom
            a, b, c, d = a + SLACK, b + SLACK, c - SLACK, d - SLACK
            if inside and all(c <= x or a >= z or d <= y or b >= w for x, y, z, w in self._taken):
                self._taken.append(box)
                return box
        return None

    def beside(self, at: tuple[float, float], size: tuple[float, float], gap: float) -> Iterator[Box]:
        """Yield boxes of a size around a point, the nearest first: right of it, left, above, below, farther away."""
        (x, y), (width, height) = at, size
        right = [x + gap + k * width for k in range(COLUMNS)]
        left = [x - gap - (k + 1) * width for k in range(COLUMNS)]
        for start in (right[0], left[0]):
            yield start, y - height / 2, start + width, y + height / 2
        rows = ((row, row * height + y) for row in range(-ROWS, ROWS + 1))
        boxes = [
            (start, middle - height / 2, start + width, middle + height / 2)
            for row, middle in rows
            for start in (*right, *left, *([x - width / 2] if row else []))
        ]
        yield from sorted(boxes, key=lambda box: _distance(at, box))


def _distance(at: tuple[float, float], box: Box) -> float:
    """Return the distance from a point to a box."""
    (x, y), (left, top, right, bottom) = at, box
    return math.hypot(max(left - x, 0.0, x - right), max(top - y, 0.0, y - bottom))

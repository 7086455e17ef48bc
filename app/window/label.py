"""Text on a dark plate over the picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imgui_bundle import imgui

from app.draw.marks import PLATE, PLATE_OPACITY, ROUND_EM
from app.window import theme

if TYPE_CHECKING:
    from app.window.label_places import Box

PAD_EM = (0.6, 0.3)  # of the plate
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
    text: str,
    x: float,
    y: float,
    colour=theme.TEXT,
    centred: bool = False,
    right: bool = False,
    room: float | None = None,
) -> None:
    """Write text on a dark plate, readable on any scene; (x, y) is the upper left corner of the plate, or its centre if
    `centred`, or its upper right corner if `right`; room: largest width [points]."""
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
    return PAD_EM[0] * em, PAD_EM[1] * em


def _room(room: float | None) -> float:
    return imgui.get_window_width() - 2 * MARGIN_EM * imgui.get_font_size() if room is None else room

"""Text on a dark plate over the picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imgui_bundle import imgui

from app.window import theme

if TYPE_CHECKING:
    from app.window.label_places import Box

COLOUR = (0.06, 0.062, 0.068, 0.78)


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


def draw(text: str, at: Box, colour=theme.TEXT) -> None:
    """Draw a text on its plate; at: box() of the text, or one of the size plate()."""
    left, top, right, bottom = at
    (pad, vertical), size = _pads(), imgui.get_font_size()
    drawing = imgui.get_window_draw_list()
    drawing.add_rect_filled((left, top), (right, bottom), imgui.get_color_u32(COLOUR), 0.35 * size)
    start, ink, wrap = (left + pad, top + vertical), imgui.get_color_u32((*colour, 1.0)), right - left - 2 * pad
    drawing.add_text(imgui.get_font(), size, start, ink, text, wrap_width=wrap + 1.0)


def _pads() -> tuple[float, float]:
    em = imgui.get_font_size()
    return PAD_EM[0] * em, PAD_EM[1] * em


def _room(room: float | None) -> float:
    return imgui.get_window_width() - 2 * MARGIN_EM * imgui.get_font_size() if room is None else room

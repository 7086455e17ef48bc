"""Text on a dark plate over the picture."""

from __future__ import annotations

from imgui_bundle import imgui

from app.window import theme

COLOUR = (0.06, 0.062, 0.068, 0.78)


def write(text: str, x: float, y: float, colour=theme.TEXT, centred: bool = False, right: bool = False) -> None:
    """Write text on a dark plate, readable on any scene; (x, y) is the upper left corner of the plate, or its centre if
    `centred`, or its upper right corner if `right`."""
    em = imgui.get_font_size()
    size = imgui.calc_text_size(text)
    pad = (0.6 * em, 0.3 * em)
    if centred:
        x, y = x - size.x / 2 - pad[0], y - size.y / 2 - pad[1]
    x -= size.x + 2 * pad[0] if right else 0.0
    draw = imgui.get_window_draw_list()
    under = imgui.get_color_u32(COLOUR)
    draw.add_rect_filled((x, y), (x + size.x + 2 * pad[0], y + size.y + 2 * pad[1]), under, 0.35 * em)
    draw.add_text((x + pad[0], y + pad[1]), imgui.get_color_u32((*colour, 1.0)), text)

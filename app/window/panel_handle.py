"""A handle at the right edge of the picture that hides and shows the panel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imgui_bundle import imgui

from app.draw.marks import PLATE, PLATE_OPACITY, ROUND_EM
from app.window import theme

if TYPE_CHECKING:
    from app.window.label_places import Box
    from app.window.view import View

WIDTH_EM, HEIGHT_EM = 1.1, 3.2
ARROW_EM = 0.28  # half its width


def box(view: View) -> Box:
    """Return the handle's box, in the middle of the picture's right edge."""
    em, (x, y), (w, h) = imgui.get_font_size(), view.origin, view.size
    right, middle = x + w, y + h / 2
    return right - WIDTH_EM * em, middle - HEIGHT_EM * em / 2, right, middle + HEIGHT_EM * em / 2


def draw(view: View, is_shown: bool) -> bool:
    """Draw the handle; return whether it was clicked. is_shown: the panel."""
    left, top, right, bottom = box(view)
    imgui.set_cursor_screen_pos((left, top))
    clicked = imgui.invisible_button("panel handle", (right - left, bottom - top))
    hovered, em = imgui.is_item_hovered(), imgui.get_font_size()
    imgui.set_item_tooltip(f"{'Hide' if is_shown else 'Show'} the panel. Key Tab.")
    drawing, half = imgui.get_window_draw_list(), (ARROW_EM if is_shown else -ARROW_EM) * em
    plate = imgui.get_color_u32((*PLATE, 1.0 if hovered else PLATE_OPACITY))
    drawing.add_rect_filled((left, top), (right, bottom), plate, ROUND_EM * em)
    x, y = (left + right) / 2, (top + bottom) / 2
    tip, ends = (x + half, y), ((x - half, y - 2 * abs(half)), (x - half, y + 2 * abs(half)))
    drawing.add_triangle_filled(tip, *ends, imgui.get_color_u32((*(theme.ACCENT if hovered else theme.TEXT), 1.0)))
    return clicked

"""The wipe: a vertical line across the picture, to drag, between two labelled pictures."""

from __future__ import annotations

from imgui_bundle import imgui

from app.window import label, theme


class Wipe:
    """`at`: position of the line, as a share of the width; `held`: it is dragged."""

    def __init__(self) -> None:
        self.at = 0.5
        self.held = False

    def is_near(self, x: float, left: float, width: float) -> bool:
        return abs(x - (left + self.at * width)) <= 0.5 * imgui.get_font_size()  # the line is grabbed within 0.5 em

    def handle(self, io, left: float, width: float, hovered: bool) -> bool:
        """Read the mouse of this frame; return whether the line takes it."""
        near = hovered and self.is_near(io.mouse_pos.x, left, width)
        if near and imgui.is_mouse_clicked(0):
            self.held = True
        takes = near or self.held
        if self.held and imgui.is_mouse_pos_valid():
            self.at = min(max((io.mouse_pos.x - left) / max(width, 1.0), 0.02), 0.98)
        self.held &= imgui.is_mouse_down(0)
        if takes:
            imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
        return takes

    def draw(self, area: tuple[float, float, float, float], names: tuple[str, str]) -> None:
        """Draw the line and both labels into an area (x, y, width, height)."""
        wipe_line = (1.0, 1.0, 1.0, 0.85)
        em = imgui.get_font_size()
        x, y, w, h = area
        line = x + self.at * w
        draw = imgui.get_window_draw_list()
        draw.add_line((line, y), (line, y + h), imgui.get_color_u32(wipe_line), 0.1 * em)
        middle = y + h / 2
        draw.add_circle_filled((line, middle), 0.55 * em, imgui.get_color_u32((*theme.FRAME, 0.95)))
        draw.add_circle((line, middle), 0.55 * em, imgui.get_color_u32(wipe_line), 0, 0.1 * em)
        gap = 0.6 * em
        label.write(names[0], line - gap, y + em, right=True)
        label.write(names[1], line + gap, y + em)

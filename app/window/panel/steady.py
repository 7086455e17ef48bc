"""The panel stays where it is: as wide in letters at every interface size, and its rows under the mouse."""

from __future__ import annotations

import math
from contextlib import suppress

from imgui_bundle import hello_imgui, imgui

PANEL_WIDTH = "panel"  # in the window's ini file


class Steady:
    """`load` after the window opens; `begin`, `mark` each section, then `end`, once per frame; `save` at its end."""

    def __init__(self) -> None:
        self._letters = 22.0  # the panel's width in letters
        self._width = 0.0  # the same as set last [points]
        self._font = 0.0  # size [points] when the panel was drawn last; 0: not yet
        self._at: dict[str, float] = {}  # section -> its place in the whole of the panel [points]
        self._before: dict[str, float] = {}  # the same of the last frame
        self._used = ""  # the section that the mouse was on last

    def load(self) -> None:
        with suppress(ValueError):
            self._letters = max(float(hello_imgui.load_user_pref(PANEL_WIDTH)), 1.0)

    def save(self) -> None:
        hello_imgui.save_user_pref(PANEL_WIDTH, f"{self._letters:g}")

    def begin(self) -> None:
        """Keep the panel's width in letters, where the user has drawn its edge."""
        font, node = imgui.get_font_size(), imgui.internal.get_current_window().dock_node
        if node is not None:
            if font == self._font and node.size.x != self._width:  # the user has moved its edge
                self._letters, self._width = node.size.x / font, node.size.x
            if font != self._font:
                most = 0.55 * imgui.get_main_viewport().work_size.x  # the picture has the rest
                self._width = math.floor(min(self._letters * font, most))
                imgui.internal.dock_builder_set_node_size(node.id_, (self._width, node.size.y))
                self._before.clear()
        self._font = font
        self._at.clear()

    def mark(self, section: str) -> None:
        """Remember where a section begins."""
        self._at[section] = imgui.get_cursor_pos_y()
        if imgui.is_window_hovered() and imgui.get_cursor_screen_pos().y <= imgui.get_mouse_pos().y:
            self._used = section

    def end(self) -> None:
        """Keep the section that the mouse was on where it was, after a click in the picture has made others longer."""
        if not imgui.is_window_hovered() and self._used in self._at and self._used in self._before:
            shift = self._at[self._used] - self._before[self._used]
            if shift:
                imgui.set_scroll_y(imgui.get_scroll_y() + shift)
        self._before = dict(self._at)

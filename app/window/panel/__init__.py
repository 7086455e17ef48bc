"""The panel: settings in, settings out, and the numbers of the frame. It changes nothing itself.

`draw(window, folds)` returns the edited settings and the requested actions: names, or tuples of a name and values.
Sections about the method are in RESEARCH; one switch shows them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

from imgui_bundle import hello_imgui, imgui

from app.settings import Settings
from app.window.panel import chart, lamps, lights, material, objects, picture, quality, readouts, research, scene
from app.window.panel import widgets as ui
from app.window.parts import Window

PREFERENCE = "sections"  # in the window's ini file
PANEL_WIDTH = "panel"  # in the window's ini file
FOLDED, UNFOLDED = "-", "+"


class Steady:
    """The panel stays where it is: as wide in letters at every interface size, and its rows under the mouse.

    `load` after the window opens; `begin`, `mark` each section, then `end`, once per frame; `save` at its end.
    """

    def __init__(self) -> None:
        self._letters = 22.0  # the panel's width in letters
        self._width = 0.0  # the same as set last [points]
        self._font = 0.0  # size [points] when the panel was drawn last; 0: not yet
        self._at: dict[str, float] = {}  # section -> its place in the whole of the panel [points]
        self._before: dict[str, float] = {}  # the same of the last frame
        self._used = ""  # the section that the mouse was on last
        self._gap = "", 0.0  # empty space [points] before a section: how far the scroll is below 0

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
        """Remember where a section begins, but for the gap."""
        above, gap = self._gap
        self._at[section] = imgui.get_cursor_pos_y() - (gap if above in self._at else 0.0)
        if section == above:
            imgui.set_cursor_pos_y(self._at[section] + gap)
        if imgui.is_window_hovered() and imgui.get_cursor_screen_pos().y <= imgui.get_mouse_pos().y:
            self._used = section

    def end(self) -> None:
        """Keep the section that the mouse was on where it was, after a click has changed those above."""
        used, (above, gap), scroll = self._used, self._gap, imgui.get_scroll_y()
        at, before = self._at, self._before
        if used in at and used in before and ((shift := at[used] - before[used]) or (gap and scroll)):
            scroll += shift - (gap if at.get(above, math.inf) <= at[used] else 0.0)
            imgui.set_scroll_y(max(scroll, 0.0))
            self._gap = used, max(-scroll, 0.0)
        self._before = dict(self._at)


class Folds:
    """Fold state per section: `load` after the window opens, `header` per section, `save` before it closes."""

    def __init__(self) -> None:
        self.steady = Steady()
        self._unfolded: dict[str, bool] = {}
        self._just_unfolded = ""

    def load(self) -> None:
        """Read the state that the last session saved; other sections keep their default."""
        self.steady.load()
        for line in hello_imgui.load_user_pref(PREFERENCE).splitlines():
            if line[:1] in (FOLDED, UNFOLDED):
                self._unfolded[line[1:]] = line[:1] == UNFOLDED

    def save(self) -> None:
        self.steady.save()
        lines = [(UNFOLDED if unfolded else FOLDED) + title for title, unfolded in self._unfolded.items()]
        hello_imgui.save_user_pref(PREFERENCE, "\n".join(lines))

    def header(self, title: str, unfolded: bool) -> bool:
        """Draw a header; return whether its section is unfolded. `unfolded`: the default."""
        imgui.set_next_item_open(self._unfolded.setdefault(title, unfolded), imgui.Cond_.once)
        before, now = self._unfolded[title], imgui.collapsing_header(title)
        self._unfolded[title] = now
        if now and not before:
            self._just_unfolded = title
        return now

    def switch(self, title: str, about: str) -> bool:
        """Draw a switch of more sections; return whether they are shown."""
        changed, on = imgui.checkbox(title, self._unfolded.setdefault(title, False))
        ui.tip(about)
        self._unfolded[title] = on
        return on

    def show_whole(self, title: str) -> None:
        """Scroll to the end of the section just drawn if the user has just unfolded it and it ends below the panel."""
        if self._just_unfolded == title:
            self._just_unfolded = ""
            if imgui.get_cursor_screen_pos().y > imgui.get_window_pos().y + imgui.get_window_height():
                imgui.set_scroll_here_y(1.0)


__all__ = ["RESEARCH", "SECTIONS", "Folds", "Section", "draw", "quality"]


class Section(NamedTuple):
    """A part of the panel under a folding header."""

    title: str
    draw: Callable[[Settings, Window, set[str]], Settings]
    unfolded: bool = True  # at the first start; later starts restore the last state
    visible: Callable[[Window], bool] = lambda window: True


SECTIONS = (
    Section("Scene", scene.draw),
    Section("Objects", objects.draw),
    Section("Material", material.draw, unfolded=False),
    Section("Lamps", lamps.draw),
    Section("Daylight", lights.daylight, visible=lambda window: window.session.scene.daylight is not None),
    Section("Picture", picture.draw),
    Section("Read-outs", readouts.draw),
    Section("Quality", quality.draw),
    Section("Scene notes", scene.notes, unfolded=False, visible=lambda window: bool(window.session.scene.notes)),
)
RESEARCH = (
    Section("Method", research.method),
    Section("Motion", research.motion),
    Section("Error", research.error),
    Section("Error against time", chart.draw, unfolded=False),
    Section("Bias correction", research.artifacts, unfolded=False),
    Section("Disc search", research.search, False, lambda window: bool(window.session.light.snapshot.search_summary)),
    Section("Rays", research.rays, unfolded=False),
    Section("Timings", research.timings, unfolded=False),
    Section("Statistics", research.statistics, unfolded=False),
)


def draw(window: Window, folds: Folds) -> tuple[Settings, set[str]]:
    """Draw the panel; return the edited settings and the requested actions, keys of `app.window.actions`."""
    actions: set[str] = set()
    folds.steady.begin()
    settings = _draw(SECTIONS, window.session.settings, window, folds, actions)
    imgui.separator()
    if folds.switch("Research", "Show the parameters, errors and timings of the method."):
        settings = _draw(RESEARCH, settings, window, folds, actions)
    folds.steady.end()
    return settings, actions


def _draw(
    sections: tuple[Section, ...], settings: Settings, window: Window, folds: Folds, actions: set[str]
) -> Settings:
    for section in sections:
        folds.steady.mark(section.title)
        if section.visible(window) and folds.header(section.title, section.unfolded):
            settings = section.draw(settings, window, actions)
            folds.show_whole(section.title)
    return settings

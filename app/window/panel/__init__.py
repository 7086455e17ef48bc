"""The panel: settings in, settings out, and the numbers of the frame. It changes nothing itself.

`draw(window, folds)` returns the edited settings and the requested actions. The frame compares old and new
settings and restarts the first stage that a change affects.

A section is one file with `draw(settings, window, actions) -> Settings` and one line in SECTIONS, or in RESEARCH if it
is about the method: one switch shows those. A new setting is one entry of a group in app/settings.py. Numbers are read
from the session (app/session/session.py) and from `session.light.snapshot`, the frame on show. Widgets with label and
tooltip are in widgets.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from imgui_bundle import hello_imgui, imgui

from app.settings import Settings
from app.window.panel import (
    artifacts,
    chart,
    error,
    lamps,
    material,
    method,
    motion,
    notes,
    objects,
    picture,
    quality,
    rays,
    readouts,
    scene,
    search,
    statistics,
    status,
    timings,
)
from app.window.panel import widgets as ui
from app.window.panel.steady import Steady
from app.window.parts import Window

PREFERENCE = "sections"  # in the window's ini file
FOLDED, UNFOLDED = "-", "+"


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
        """Scroll to the end of the section just drawn if the user has just unfolded it."""
        if self._just_unfolded == title:
            self._just_unfolded = ""
            imgui.set_scroll_here_y(1.0)


__all__ = ["RESEARCH", "SECTIONS", "Folds", "Section", "draw", "status"]


def _always(window: Window) -> bool:
    return True


def _has_discs(window: Window) -> bool:
    return bool(window.session.light.snapshot.search_summary)


class Section(NamedTuple):
    """A part of the panel under a folding header."""

    title: str
    draw: Callable[[Settings, Window, set[str]], Settings]
    unfolded: bool = True  # at the first start; later starts restore the last state
    visible: Callable[[Window], bool] = _always


SECTIONS = (
    Section("Scene", scene.draw),
    Section("Objects", objects.draw),
    Section("Material", material.draw, unfolded=False),
    Section("Lamps", lamps.draw),
    Section("Picture", picture.draw),
    Section("Read-outs", readouts.draw),
    Section("Quality", quality.draw),
    Section("Scene notes", notes.draw, unfolded=False, visible=lambda window: bool(window.session.scene.notes)),
)
RESEARCH = (
    Section("Method", method.draw),
    Section("Motion", motion.draw),
    Section("Error", error.draw),
    Section("Error against time", chart.draw, unfolded=False),
    Section("Bias correction", artifacts.draw, unfolded=False),
    Section("Disc search", search.draw, unfolded=False, visible=_has_discs),
    Section("Rays", rays.draw, unfolded=False),
    Section("Timings", timings.draw, unfolded=False),
    Section("Statistics", statistics.draw, unfolded=False),
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

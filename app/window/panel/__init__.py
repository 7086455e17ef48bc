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

from imgui_bundle import imgui

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
from app.window.panel.folds import Folds
from app.window.parts import Window

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
    settings = _draw(SECTIONS, window.session.settings, window, folds, actions)
    imgui.separator()
    if folds.switch("Research", "Show the parameters, errors and timings of the method."):
        settings = _draw(RESEARCH, settings, window, folds, actions)
    return settings, actions


def _draw(
    sections: tuple[Section, ...], settings: Settings, window: Window, folds: Folds, actions: set[str]
) -> Settings:
    for section in sections:
        if section.visible(window) and folds.header(section.title, section.unfolded):
            settings = section.draw(settings, window, actions)
            folds.show_whole(section.title)
    return settings

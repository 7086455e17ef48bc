"""The panel: settings in, settings out, and the numbers of the frame. It changes nothing itself.

`draw(settings, facts, folds)` returns the edited settings and the requested actions. The frame compares old and new
settings and restarts the first stage that a change affects.

A section is one file with `draw(settings, facts, actions) -> Settings` and one line in SECTIONS. Sections for
engineers start folded. A new setting is a field of `Settings` (app/settings.py); a solver's setting is also named
in SOLVER_SETTINGS there. A new read-out is a field of `Facts` (facts.py). Widgets with label and tooltip are in
widgets.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from app.settings import Settings
from app.window.panel import (
    artifacts,
    chart,
    error,
    light,
    motion,
    notes,
    picture,
    probes,
    scene,
    search,
    statistics,
    timings,
)
from app.window.panel.facts import Facts, facts_of
from app.window.panel.folds import Folds

__all__ = ["SECTIONS", "Facts", "Folds", "Section", "draw", "facts_of"]


def _always(facts: Facts) -> bool:
    return True


class Section(NamedTuple):
    """A part of the panel under a folding header."""

    title: str
    draw: Callable[[Settings, Facts, set[str]], Settings]
    unfolded: bool = True  # at the first start; later starts restore the last state
    visible: Callable[[Facts], bool] = _always


SECTIONS = (
    Section("Scene", scene.draw),
    Section("Light", light.draw),
    Section("Probes", probes.draw, visible=lambda facts: bool(facts.probes)),
    Section("Motion", motion.draw),
    Section("Error", error.draw),
    Section("Picture", picture.draw),
    Section("Error against time", chart.draw, unfolded=False),
    Section("Bias correction", artifacts.draw, unfolded=False),
    Section("Disc search", search.draw, unfolded=False, visible=lambda facts: bool(facts.search_summary)),
    Section("Timings", timings.draw, unfolded=False),
    Section("Statistics", statistics.draw, unfolded=False),
    Section("Scene notes", notes.draw, visible=lambda facts: bool(facts.notes)),
)


def draw(settings: Settings, facts: Facts, folds: Folds) -> tuple[Settings, set[str]]:
    """Draw the panel; return the edited settings and the requested actions, keys of `app.window.actions`."""
    actions: set[str] = set()
    for section in SECTIONS:
        if section.visible(facts) and folds.header(section.title, section.unfolded):
            settings = section.draw(settings, facts, actions)
            folds.show_whole(section.title)
    return settings, actions

"""The panel: settings in, settings out, and the numbers of the frame. It changes nothing itself.

`draw(settings, facts, folds)` returns the settings that the user wants and the actions asked for; the frame
compares and re-enters the work at the first stage that is affected.

A section is a file of its own with `draw(settings, facts, actions) -> Settings`, and a line in SECTIONS: the order
is that of reading, what only an engineer asks for is folded at first. A new setting goes into `Settings`
(app/settings.py) and, if the solver takes it, into SOLVER_SETTINGS there; what a section tells beyond
settings goes into `Facts` (facts.py). Widgets with label and tooltip are in widgets.py.
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
    paths,
    picture,
    probes,
    scene,
    search,
    timings,
)
from app.window.panel.facts import Facts, facts_of
from app.window.panel.folds import Folds

__all__ = ["SECTIONS", "Facts", "Folds", "Section", "draw", "facts_of"]


def _always(facts: Facts) -> bool:
    return True


class Section(NamedTuple):
    """A part of the panel under a header that folds it."""

    title: str
    draw: Callable[[Settings, Facts, set[str]], Settings]
    unfolded: bool = True  # at the first start; later as the user left it
    there: Callable[[Facts], bool] = _always  # whether there is anything to show


SECTIONS = (
    Section("Scene", scene.draw),
    Section("Light", light.draw),
    Section("Probes", probes.draw, there=lambda facts: bool(facts.probes)),
    Section("Motion", motion.draw),
    Section("Error", error.draw),
    Section("Picture", picture.draw),
    Section("Error against time", chart.draw, unfolded=False),
    Section("Edges and contact", artifacts.draw, unfolded=False),
    Section("Disc search", search.draw, unfolded=False, there=lambda facts: bool(facts.search_summary)),
    Section("Time", timings.draw, unfolded=False),
    Section("Paths", paths.draw, unfolded=False),
    Section("Notes on the scene", notes.draw, there=lambda facts: bool(facts.notes)),
)


def draw(settings: Settings, facts: Facts, folds: Folds) -> tuple[Settings, set[str]]:
    """Draw the panel; return settings wanted and actions: "play", "reset view", "reset poses", "meter", ..."""
    actions: set[str] = set()
    for section in SECTIONS:
        if section.there(facts) and folds.header(section.title, section.unfolded):
            settings = section.draw(settings, facts, actions)
            folds.show_whole(section.title)
    return settings, actions

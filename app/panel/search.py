"""How tangent_plane finds the segments that cross its discs: the picture is the same, the times are not."""

from __future__ import annotations

from imgui_bundle import imgui

from app.panel import widgets as ui
from app.panel.facts import Facts
from app.settings import Settings

PRETEST_NAMES = {
    "none": "None",
    "badouel": "Badouel",
    "pluecker": "Plücker",
    "moeller_trumbore": "Möller-Trumbore",
}


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    from gi_core.disc_search import PRETESTS, SEARCHES  # loaded long since; at the top it would hold the window up

    s = ui.choice(s, "Search", "search", {key: ui.title(key) for key in SEARCHES},
                  "How tangent_plane finds the segments that cross a disc: discs in a grid that segments walk "
                  "through, segments in spheres around receivers, every pair of them, or (auto) whichever of the first "
                  "two has taken less time. The picture is the same, bit for bit, and goes on meanwhile.")  # fmt: skip
    s = ui.choice(s, "Pre-test", "pretest", {key: PRETEST_NAMES.get(key, key) for key in PRETESTS},
                  "A triangle around each disc, tried before the disc itself. It was worth its time where a disc "
                  "test was slow; here it is not.")  # fmt: skip
    cost = facts.timings.get("estimate") if facts.search_told else None
    ui.number("Takes", "-" if cost is None else ui.ms(cost),
              "Finding crossings and adding them up in the last frame: what search and pre-test change.")  # fmt: skip
    if facts.search_told:
        imgui.push_text_wrap_pos(0.0)
        imgui.text_disabled(facts.search_told)
        imgui.pop_text_wrap_pos()
    return s

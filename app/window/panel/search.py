"""How tangent_plane finds the segments that cross its discs: the picture is the same, the times are not."""

from __future__ import annotations

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    from gi_core.discs.search import SEARCHES  # loaded long since; at the top it would hold the window up

    s = ui.choice(s, "Search", "search", {key: ui.title(key) for key in SEARCHES},
                  "How tangent_plane finds the segments that cross a disc: discs in a grid that segments walk "
                  "through, segments in spheres around receivers, or every pair of them. The picture is the same, "
                  "bit for bit; it stays while the light is estimated again.")  # fmt: skip
    cost = facts.timings.get("estimate")
    ui.number("Takes", "-" if cost is None else ui.ms(cost),
              "Finding crossings and adding them up in the last frame: what the search changes.")  # fmt: skip
    imgui.push_text_wrap_pos(0.0)
    imgui.text_disabled(facts.search_summary)
    imgui.pop_text_wrap_pos()
    return s

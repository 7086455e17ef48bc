"""Disc search of tangent_plane: choice, time, size of the index."""

from __future__ import annotations

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    from gi_core.discs.search import SEARCHES  # already loaded here; at the top it would delay the window

    s = ui.choice(s, "Search", "search", {key: ui.title(key) for key in SEARCHES},
                  "Method that finds path segments through a disc: a grid of discs, spheres, or all pairs.\n"
                  "It changes the time, not the picture.")  # fmt: skip
    snapshot = window.session.light.snapshot
    cost = snapshot.timings.get("estimate")
    ui.number("Estimate time", ui.DASH if cost is None else ui.ms(cost),
              "Time to find and sum disc intersections in the last frame.")  # fmt: skip
    imgui.push_text_wrap_pos(0.0)
    imgui.text_disabled(snapshot.search_summary)
    imgui.pop_text_wrap_pos()
    return s

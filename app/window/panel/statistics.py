"""Counts: photons, path segments changed by mobiles, triangles, receivers."""

from __future__ import annotations

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    ui.label("Photons traced")
    share = facts.photons_traced / facts.photons_goal if facts.photons_goal else 1.0
    imgui.progress_bar(min(share, 1.0), (-1, 0), "")
    ui.write_over(f"{ui.thousands(facts.photons_traced)} of {ui.thousands(facts.photons_goal)}")
    ui.tip(f"Photons traced, of those requested. They have {ui.thousands(facts.segments)} path segments.")
    n = max(facts.photons_shown, 1)
    ui.number("Photons cut", f"{ui.thousands(facts.photons_cut)}   ({100 * facts.photons_cut / n:.2g} %)",
              "Photons with a path that a movable object blocks. Only these are traced again.")  # fmt: skip
    ui.number(
        "Segments removed",
        ui.thousands(facts.old_segments),
        "Path segments behind such an object, subtracted.",
    )
    ui.number(
        "Segments added",
        ui.thousands(facts.new_segments),
        "Path segments from such an object on, added.",
    )
    ui.number("Triangles", ui.thousands(facts.triangles), "Triangles of the static part and the mobiles.")
    ui.number("Receivers", ui.thousands(facts.receivers), "Sides of vertices; each stores irradiance.")
    return s

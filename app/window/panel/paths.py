"""Photons traced, and what of their paths the mobiles change."""

from __future__ import annotations

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    ui.label("Traced")
    share = facts.photons_traced / facts.photons_goal if facts.photons_goal else 1.0
    imgui.progress_bar(min(share, 1.0), (-1, 0), "")
    ui.write_over(f"{ui.thousands(facts.photons_traced)} of {ui.thousands(facts.photons_goal)}")
    there = f"{ui.thousands(facts.segments)} path segments"
    ui.tip(f"Photons that the picture is made of at rest, and photons wanted: {there}.")
    n = max(facts.photons_shown, 1)
    ui.number("Photons cut", f"{ui.thousands(facts.photons_cut)}   ({100 * facts.photons_cut / n:.2g} %)",
            "Photons whose path through the static scene a mobile blocks: the only ones traced anew.")  # fmt: skip
    ui.number("Old segments", ui.thousands(facts.old_segments), "Path segments that the mobiles take out.")
    ui.number("New segments", ui.thousands(facts.new_segments), "Path segments that the mobiles put in.")
    ui.number("Triangles", ui.thousands(facts.triangles), "Of the static part and the mobiles together.")
    ui.number("Receivers", ui.thousands(facts.receivers), "One-sided points where irradiance is computed.")
    return s

"""Playback, resets, and the time budget of a frame while something moves."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

BUDGET_RANGE = (8, 100)  # [ms]; 101: off


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    third = (imgui.get_content_region_avail().x - 2 * imgui.get_style().item_spacing.x) / 3
    imgui.begin_disabled(facts.mobiles == 0)
    if imgui.button(("Pause" if facts.playing else "Play") + "###Play", (third, 0)):
        actions.add("play")
    ui.tip("Move the objects along their paths, or one on a circle. Key Space.")
    imgui.same_line()
    if imgui.button("Reset poses", (third, 0)):
        actions.add("reset poses")
    ui.tip("Return every object to its start pose. Key R resets the view too.")
    imgui.end_disabled()
    imgui.same_line()
    if imgui.button("Reset view", (third, 0)):
        actions.add("reset view")
    ui.tip("Return the camera to its start. Key Home.")
    ui.label("Time budget")
    low, high = BUDGET_RANGE
    value = round(s.budget) if s.budget > 0 else high + 1
    changed, value = imgui.slider_int("##Time budget", value, low, high + 1, "%d ms" if value <= high else "off")
    if changed:
        s = replace(s, budget=float(value) if value <= high else 0.0)
    ui.tip(
        "Time for computing light per frame while something moves. It limits photons and paths; at rest all are used.\n"
        "Off: every frame uses all photons."
    )
    shown = f"{ui.thousands(facts.photons_shown)} of {ui.thousands(facts.photons_traced)}"
    ui.number("Photons shown", shown, "Photons in this picture, of those in the picture at rest.")
    paths = ui.thousands(facts.paths_shown) if facts.paths_shown else ui.DASH
    ui.number("Paths per vertex", paths, "Paths traced per vertex of objects that move. A dash: photons light them.")
    return s

"""Playing, going back to the start, and what a frame may cost while something moves."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

BUDGET_RANGE = (8, 100)  # [ms]; one beyond it: off


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    third = (imgui.get_content_region_avail().x - 2 * imgui.get_style().item_spacing.x) / 3
    imgui.begin_disabled(facts.mobiles == 0)
    if imgui.button(("Pause" if facts.playing else "Play") + "###Play", (third, 0)):
        actions.add("play")
    ui.tip("Move the mobiles along their paths (a circle where the scene gives none). Space.")
    imgui.same_line()
    if imgui.button("Reset pose", (third, 0)):
        actions.add("reset poses")
    ui.tip("Put every mobile back where it was at the start. Key R also brings the view home.")
    imgui.end_disabled()
    imgui.same_line()
    if imgui.button("Reset view", (third, 0)):
        actions.add("reset view")
    ui.tip("Bring the camera back to where it was at the start. Home key.")
    ui.label("Budget")
    low, high = BUDGET_RANGE
    value = round(s.budget) if s.budget > 0 else high + 1
    changed, value = imgui.slider_int("##Budget", value, low, high + 1, "%d ms" if value <= high else "off")
    if changed:
        s = replace(s, budget=float(value) if value <= high else 0.0)
    ui.tip(
        "What light may take in a frame while something moves: as many photons are used as fit, and all of them "
        "as soon as it rests. Off: always all, however long it takes."
    )
    told = f"{ui.thousands(facts.photons_shown)} of {ui.thousands(facts.photons_traced)} photons"
    if facts.paths_shown:
        told += f", {facts.paths_shown} paths"
    ui.number(
        "Moving" if facts.moving else "At rest",
        told,
        "Photons that this picture is made of, and all there are; paths that a vertex of a mobile gathers.",
    )
    return s

"""What keeps light in its place at edges, corners, and where things touch: switches, and whom they concern."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

SWITCHES = {
    "control": (
        "Artifact control",
        "tangent_plane: light counts only on the part of a disc that it can reach, mobiles considered.\n"
        "Off: a little faster, but corners and the feet of things turn dark, and light leaks through thin walls.",
    ),
    "border_correction": (
        "Border correction",
        "photon_map: at borders and corners only hits on the own surface, over the part of a disc that it covers.\n"
        "Off: borders are too dark, and surfaces that meet light each other. Costs nothing in a frame.",
    ),
    "textbook": (
        "Textbook k",
        "photon_map counts the k-th hit as well, as in the report: too bright by k / (k - 1) on the average.\n"
        "It costs nothing.",
    ),
}


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    for field, (name, about) in SWITCHES.items():
        changed, on = imgui.checkbox(name, getattr(s, field))
        if changed:
            s = replace(s, **{field: on})
        ui.tip(about)
    told = facts.control
    ui.number("Concerned", f"{100 * told.share:.1f} %", "Of all points, those whose discs walls or edges cut off.")
    ui.number("   in contact", ui.thousands(told.stale),
              "Points of the static part whose discs a mobile enters: estimated again in the last frame.")  # fmt: skip
    ui.number("   on mobiles", ui.thousands(told.on_mobiles), "Points of mobiles whose discs other things enter.")
    cost = facts.timings.get("contact")
    ui.number("   to find out", "-" if cost is None else ui.ms(cost), "What finding these took in the last frame.")
    return s

"""Bias correction: switches of the estimators, and the receivers that artifact control concerns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

SWITCHES = {
    "control": (
        "Artifact control",
        "tangent_plane: light counts only on the part of a disc that light can reach past other objects.\n"
        "Off: slightly faster, but corners and contacts darken and light leaks through thin walls.",
    ),
    "border_correction": (
        "Border correction",
        "photon_map: near borders and corners, only hits on the receiver's own surface count, divided by its part of "
        "the disc.\nOff: borders darken and adjacent surfaces light each other.",
    ),
    "textbook": (
        "Count k-th hit",
        "photon_map: the k-th hit counts too, as in the report. Light is too bright by the factor k / (k - 1).",
    ),
}


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    for field, (name, about) in SWITCHES.items():
        changed, on = imgui.checkbox(name, getattr(s, field))
        if changed:
            change: dict[str, Any] = {field: on}
            s = replace(s, **change)
        ui.tip(about)
    control = facts.control
    ui.number("Clipped discs", f"{100 * control.share:.1f} %", "Receivers with a wall or an edge in their disc.")
    ui.number("   stale", ui.thousands(control.stale),
              "Static receivers with a movable object in their disc. The last frame estimated them again.")  # fmt: skip
    ui.number(
        "   on mobiles",
        ui.thousands(control.on_mobiles),
        "Mobile receivers with another object in their disc.",
    )
    cost = facts.timings.get("contact")
    ui.number("   contact time", ui.DASH if cost is None else ui.ms(cost), "Time to find these in the last frame.")
    return s

"""Bias correction: switches of the estimators, and the receivers that artifact control concerns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window

SWITCHES = {  # field -> estimator, name, explanation
    "control": (
        "tangent_plane",
        "Artifact control",
        "light counts only on the part of a disc that light can reach past other objects.\n"
        "Off: slightly faster, but corners and contacts darken and light leaks through thin walls.",
    ),
    "border_correction": (
        "photon_map",
        "Border correction",
        "a vertex on a border or a crease counts hits on its own surface alone, divided by the part of the disc that "
        "this surface covers. Vertices beside a border are not corrected.\n"
        "Off: free borders are dark; at creases, hits on the other surface count too.",
    ),
    "textbook": (
        "photon_map",
        "Count k-th hit",
        "the k-th hit counts too, as in the report. Light is too bright by the factor k / (k - 1).",
    ),
}


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    for field, (of, name, about) in SWITCHES.items():
        with ui.idle(ui.only(of, s)):
            changed, on = imgui.checkbox(name, getattr(s, field))
            if changed:
                change: dict[str, Any] = {field: on}
                s = replace(s, **change)
            ui.tip(f"{of}: {about}")
    snapshot = window.session.light.snapshot
    control = snapshot.control
    ui.number(
        "Clipped discs",
        f"{100 * control.share:.1f} %",
        "Receivers with a wall or an edge in their disc; for photon_map, on a border.",
    )
    ui.number("   stale", ui.thousands(control.stale),
              "Static receivers with a movable object in their disc. The last frame estimated them again.")  # fmt: skip
    ui.number(
        "   on mobiles",
        ui.thousands(control.on_mobiles),
        "Mobile receivers with another object in their disc.",
    )
    cost = snapshot.timings.get("contact")
    ui.number("   contact time", ui.DASH if cost is None else ui.ms(cost), "Time to find these in the last frame.")
    return s

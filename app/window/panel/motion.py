"""The time budget of a frame while something moves."""

from __future__ import annotations

from dataclasses import replace

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window

BUDGET_RANGE = (8, 100)  # [ms]; 101: off


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    snapshot = window.session.light.snapshot
    low, high = BUDGET_RANGE
    value = round(s.budget) if s.budget > 0 else high + 1
    with ui.idle("" if snapshot.poses else "the scene has no movable object"):
        changed, value = ui.int_slider("Time budget", value, low, high + 1, f"{value} ms" if value <= high else "off")
        if changed:
            s = replace(s, budget=float(value) if value <= high else 0.0)
        ui.tip(
            "Time for computing light per frame while something moves. It limits photons and paths; at rest all are "
            "used.\nOff: every frame uses all photons."
        )
    shown = f"{ui.thousands(snapshot.photons)} of {ui.thousands(snapshot.photons_at_rest)}"
    ui.number("Photons shown", shown, "Photons in this picture, of those in the picture at rest.")
    paths = ui.thousands(snapshot.paths) if snapshot.paths else ui.DASH
    ui.number("Paths per vertex", paths, "Paths traced per vertex of objects that move. A dash: photons light them.")
    return s

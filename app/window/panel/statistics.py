"""Counts: photons, path segments changed by mobiles, triangles, receivers."""

from __future__ import annotations

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    session, snapshot = window.session, window.session.light.snapshot
    traced, goal, changes = snapshot.photons_at_rest, session.settings.photons, snapshot.changes
    ui.label("Photons traced")
    share = traced / goal if goal else 1.0
    imgui.progress_bar(min(share, 1.0), (-1, 0), "")
    ui.write_over(f"{ui.thousands(traced)} of {ui.thousands(goal)}")
    ui.tip(f"Photons traced, of those requested. They have {ui.thousands(snapshot.segments)} path segments.")
    n = max(snapshot.photons, 1)
    ui.number("Photons cut", f"{ui.thousands(changes.photons_cut)}   ({100 * changes.photons_cut / n:.2g} %)",
              "Photons with a path that a movable object blocks. Only these are traced again.")  # fmt: skip
    ui.number(
        "Segments removed",
        ui.thousands(changes.old_segments),
        "Path segments behind such an object, subtracted.",
    )
    ui.number(
        "Segments added",
        ui.thousands(changes.new_segments),
        "Path segments from such an object on, added.",
    )
    triangles = sum(len(mesh.triangles) for mesh in session.meshes)
    ui.number("Triangles", ui.thousands(triangles), "Triangles of the static part and the mobiles.")
    ui.number("Receivers", ui.thousands(len(snapshot.irradiance)), "Sides of vertices; each stores irradiance.")
    return s

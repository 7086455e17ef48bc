"""What a frame takes, stage by stage."""

from __future__ import annotations

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    fps = f"{1 / facts.frame_seconds:.0f} a second" if facts.frame_seconds > 0 else ""
    whole = f"Everything, drawing and waiting for the screen included: {fps}."
    ui.number("Whole frame", ui.ms(facts.frame_seconds), whole)
    gi = ui.ms(facts.gi_seconds) if facts.gi_seconds > 0 else "nothing moved yet"
    ui.number("GI", gi, "From new poses to irradiance: the median of the last moves.")
    for stage, seconds in facts.timings.items():
        ui.number("   " + stage, ui.ms(seconds), f"The stage '{stage}' of the last light computed.")
    return s

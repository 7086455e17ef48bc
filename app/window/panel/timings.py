"""Times of a frame and of its stages."""

from __future__ import annotations

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    fps = f" ({1 / facts.frame_seconds:.0f} fps)" if facts.frame_seconds > 0 else ""
    ui.number("Frame", ui.ms(facts.frame_seconds) + fps, "Of frames with a new picture, including drawing and display.")
    gi = ui.ms(facts.gi_seconds) if facts.gi_seconds > 0 else ui.DASH
    ui.number("GI update", gi, "Time from new poses to irradiance: median of the last moves.")
    for stage, seconds in facts.timings.items():
        ui.number("   " + stage, ui.ms(seconds), f"Time of the stage '{stage}' in the last update.")
    return s

"""Times of a frame and of its stages."""

from __future__ import annotations

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    session, frame = window.session, window.frame_seconds.value
    gi_seconds = session.light.gi_seconds.value
    fps = f" ({1 / frame:.0f} fps)" if frame > 0 else ""
    ui.number("Frame", ui.ms(frame) + fps, "Of frames with a new picture, including drawing and display.")
    gi = ui.ms(gi_seconds) if gi_seconds > 0 else ui.DASH
    ui.number("GI update", gi, "Time from new poses to irradiance: median of the last moves.")
    for stage, seconds in session.light.snapshot.timings.items():
        ui.number("   " + stage, ui.ms(seconds), f"Time of the stage '{stage}' in the last update.")
    return s

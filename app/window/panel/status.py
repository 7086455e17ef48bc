"""State of the light in words: converging or converged, its error; frames per second."""

from __future__ import annotations

import math
from typing import NamedTuple

from imgui_bundle import imgui

from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

BAR_EM = 0.35  # height of the progress bar


class Status(NamedTuple):
    text: str
    fraction: float  # of the work until the light has converged, 0 .. 1


def status_of(facts: Facts) -> Status:
    """Return the state of the light on show."""
    if facts.moving:
        return Status("in motion", 0.0)
    parts = [facts.photons_traced / max(facts.photons_goal, 1)]
    if facts.gathered is not None:
        parts.append(facts.gathered.fraction)
        if facts.mobiles:
            parts.append(facts.at_poses.fraction if facts.at_poses is not None else 0.0)
    done = facts.all_done or min(parts) >= 1
    # Work that has not begun counts fully; the percentage never reads 100 before the end.
    fraction = 1.0 if done else min(sum(min(part, 1.0) for part in parts) / len(parts), 0.99)
    text = "converged" if done else f"converging {100 * fraction:.0f} %"
    error = error_of(facts)
    if error is not None:
        text += f", {100 * error:.1f} %" if done else f", error {100 * error:.1f} %"
    return Status(text, fraction)


def error_of(facts: Facts) -> float | None:
    """Return the error of the light on show: measured, else of the gathered light alone; None: unknown."""
    if facts.report is not None and not math.isnan(facts.report.total):
        return facts.report.total
    if facts.gathered is not None and facts.gathered.used and facts.gathered.error < 1:
        return facts.gathered.error
    return None


def frame_rate(facts: Facts) -> str:
    """Return the frames per second of the last drawn frames."""
    return f"{1 / facts.frame_seconds:.0f} frames/s" if facts.frame_seconds > 0 else ""


def draw(facts: Facts) -> None:
    """Write the status, with a progress bar below."""
    status = status_of(facts)
    ui.number("Light", status.text, "Error of the light in the picture: measured, mean over all surfaces.")
    imgui.progress_bar(status.fraction, (-1, BAR_EM * imgui.get_font_size()), "")
    ui.tip("Photons, then paths, until the light has converged. A drag interrupts and keeps them.")

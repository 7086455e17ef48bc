"""State of the light in words: converging or converged, its error; frames per second."""

from __future__ import annotations

import math
from typing import NamedTuple

from imgui_bundle import imgui

from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

BAR_EM = 0.35  # height of the progress bar
PHOTONS = 0.1  # of the progress; paths take longer

ERROR = "Error of the light in the picture, mean over all surfaces: as its paths state it, then as measured."


class Status(NamedTuple):
    text: str
    fraction: float  # of the work until the light has converged, 0 .. 1


def status_of(facts: Facts) -> Status:
    """Return the state of the light on show."""
    if facts.moving:
        return Status("in motion", 0.0)
    photons, paths = min(facts.photons_traced / max(facts.photons_goal, 1), facts.refined), []
    if facts.gathered is not None:
        paths.append(facts.gathered.fraction)
        if facts.mobiles:
            paths.append(facts.at_poses.fraction if facts.at_poses is not None else 0.0)
    done = facts.all_done or min([photons, *paths]) >= 1
    fraction = PHOTONS * photons + (1 - PHOTONS) * sum(paths) / len(paths) if paths else photons
    fraction = 1.0 if done else min(fraction, 0.99)  # never 100 % before the end
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
    """Return the frames per second of the last frames with a new picture."""
    if facts.frame_seconds <= 0:
        return ""
    rate = 1 / facts.frame_seconds
    return f"{rate:.{0 if rate >= 10 else 1}f} frames/s"


def draw(facts: Facts) -> None:
    """Write the status, with a progress bar below."""
    status = status_of(facts)
    ui.number("Light", status.text, ERROR)
    imgui.progress_bar(status.fraction, (-1, BAR_EM * imgui.get_font_size()), "")
    ui.tip("Photons, then paths, until the light has converged. A drag interrupts and keeps them.")

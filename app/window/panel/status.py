"""State of the light in words: converging or converged, its error; frames per second."""

from __future__ import annotations

import math
from typing import NamedTuple

from imgui_bundle import imgui

from app.session.session import Session
from app.window.panel import widgets as ui

PHOTON_SHARE = 0.1  # of the progress; paths take longer

ERROR = "Error of the light in the picture, mean over all surfaces: as its paths state it, then as measured."


class Status(NamedTuple):
    text: str
    fraction: float  # of the work until the light has converged, 0 .. 1


def status_of(session: Session) -> Status:
    """Return the state of the light on show."""
    light, gathered = session.light, session.gathered
    if session.in_motion:
        return Status("in motion", 0.0)
    if not session.is_current:
        return Status("computing", 0.0)
    photons, paths = min(light.snapshot.photons_at_rest / max(session.settings.photons, 1), session.refined), []
    if gathered is not None:
        paths.append(gathered.fraction)
        if session.poses:
            at_poses = light.snapshot.rest.at_poses
            paths.append(at_poses.fraction if at_poses is not None else 0.0)
    done = (light.all_done and not session.refining) or min([photons, *paths]) >= 1
    fraction = PHOTON_SHARE * photons + (1 - PHOTON_SHARE) * sum(paths) / len(paths) if paths else photons
    fraction = 1.0 if done else min(fraction, 0.99)  # never 100 % before the end
    text = "converged" if done else f"converging {100 * fraction:.0f} %"
    error = error_of(session)
    if error is not None:
        text += f", {100 * error:.1f} %" if done else f", error {100 * error:.1f} %"
    return Status(text, fraction)


def error_of(session: Session) -> float | None:
    """Return the error of the light on show: measured, else of the gathered light alone; None: unknown."""
    report, gathered = session.light.snapshot.rest.report, session.gathered
    if report is not None and not math.isnan(report.total):
        return report.total
    if gathered is not None and gathered.used and gathered.error < 1:
        return gathered.error
    return None


def frame_rate(seconds: float) -> str:
    """Return the frames per second of the last frames with a new picture."""
    if seconds <= 0:
        return ""
    rate = 1 / seconds
    return f"{rate:.{0 if rate >= 10 else 1}f} frames/s"


def draw(session: Session) -> None:
    """Write the status, with a progress bar below."""
    status = status_of(session)
    ui.number("Light", status.text, ERROR)
    imgui.progress_bar(status.fraction, (-1, 0.35 * imgui.get_font_size()), "")
    ui.tip("Photons, then paths, until the light has converged. A drag interrupts and keeps them.")

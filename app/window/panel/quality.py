"""Quality: the estimator, one slider from fast to accurate with its cost and error, the state of the light."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from imgui_bundle import imgui

from app.rest.results import MeasuredPoint
from app.session.session import Session
from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.estimators import ESTIMATORS

ERROR = "Error of the light in the picture, mean over all surfaces: as its paths state it, then as measured."


class Level(NamedTuple):
    """A position of the slider."""

    name: str
    photons: float  # factor on the photons that the scene chooses
    budget: float  # [ms] for light per frame in motion


LEVELS = (
    Level("draft", 1 / 16, 8.0),
    Level("fast", 1 / 4, 11.0),
    Level("balanced", 1.0, Settings.budget),
    Level("high", 2.0, 33.0),
    Level("highest", 4.0, 66.0),
)


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    session = window.session
    light, chosen = session.light, max(session.chosen.photons, 1)
    _estimator(s, actions)
    now, k = level_of(s, chosen)
    changed, new = ui.slider("Quality", k + 1, 1, len(LEVELS), now)
    if changed:
        level = LEVELS[min(max(new, 1), len(LEVELS)) - 1]
        s = replace(s, photons=photons_of(level, chosen), budget=level.budget)
    ui.tip(_about(chosen, session.points.all))
    cost = ui.ms(light.gi_seconds.value) if light.gi_seconds.value > 0 else ui.DASH
    of = f" of {s.budget:.0f} ms" if s.budget > 0 else ""
    ui.number("Costs per move", cost + of,
              "Time for light per frame while something moves: median of the last moves, and its limit.")  # fmt: skip
    if 0 < s.budget < 1e3 * light.gi_seconds.value:
        imgui.text_wrapped("Above the limit: a lower quality, or smaller objects, cost less.")
    error = error_of(session)
    imgui.begin_disabled(not session.is_current)  # the number of the light before
    ui.number("Error at rest", ui.DASH if error is None or session.in_motion else f"{100 * error:.1f} %",
              "Mean error of irradiance against an unbiased reference, relative to the mean irradiance. Places "
              "brighter than the view count less.")  # fmt: skip
    imgui.end_disabled()
    status = status_of(session)
    ui.number("Light", status.text, ERROR)
    imgui.progress_bar(status.fraction, (-1, 0.35 * imgui.get_font_size()), "")
    ui.tip("Photons, then paths, until the light has converged. A drag interrupts and keeps them.")
    return s


def level_of(s: Settings, chosen: int) -> tuple[str, int]:
    """Return the name and the index of the level of the settings; "custom" and the nearest one by photons otherwise.

    chosen: photons that the scene chooses.
    """
    nearest = min(range(len(LEVELS)), key=lambda k: abs(photons_of(LEVELS[k], chosen) - s.photons))
    for k, level in enumerate(LEVELS):
        if (photons_of(level, chosen), level.budget) == (s.photons, s.budget):
            return level.name, k
    return "custom", nearest


def photons_of(level: Level, chosen: int) -> int:
    """Return the photons of a level; the level of factor 1 has those that the scene chooses."""
    # a level has 4096 photons at least, if the scene chooses more
    return chosen if level.photons == 1 else max(ui.rounded(max(round(level.photons * chosen), 1)), min(4096, chosen))


def _about(chosen: int, points: tuple[MeasuredPoint, ...]) -> str:
    """Return the tooltip: photons, time and error of each level, as far as measured."""
    lines = ["From fast to accurate. Photons at rest, time for light per frame in motion, measured error:"]
    for level in LEVELS:
        photons = photons_of(level, chosen)
        error = next((f"{100 * p.error:.1f} %" for p in reversed(points) if p.photons == photons), ui.DASH)
        lines.append(f"{level.name}: {ui.thousands(photons)}, {level.budget:g} ms, {error}")
    return "\n".join(lines)


def _estimator(s: Settings, actions: set[str]) -> None:
    ui.label("Estimator")
    with_key = min(len(ESTIMATORS), 9)
    names = {
        key: (ui.title(key), kind.about + f"\nKey {k}" * (k <= with_key))
        for k, (key, kind) in enumerate(ESTIMATORS.items(), 1)
    }
    if (chosen := ui.one_of("Estimator", ui.title(s.estimator), names, s.estimator)) is not None:
        actions.add(f"estimator {list(ESTIMATORS).index(chosen)}")
    ui.tip(f"Method that computes the light on surfaces from photon paths. Keys 1 to {with_key}.")


class Status(NamedTuple):
    text: str
    fraction: float  # of the work until the light has converged, 0 .. 1


def status_of(session: Session) -> Status:
    """Return the state of the light on show."""
    photon_share = 0.1  # of the progress; paths take longer
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
    fraction = photon_share * photons + (1 - photon_share) * sum(paths) / len(paths) if paths else photons
    fraction = 1.0 if done else min(fraction, 0.99)  # never 100 % before the end
    text = "converged" if done else f"converging {100 * fraction:.0f} %"
    error = error_of(session)
    if error is not None:
        text += f", {100 * error:.1f} %" if done else f", error {100 * error:.1f} %"
    return Status(text, fraction)


def error_of(session: Session) -> float | None:
    """Return the error of the light on show: measured, else as gathered light states it; None: unknown."""
    rest = session.light.snapshot.rest
    if rest.report is not None and not math.isnan(rest.report.total):
        return rest.report.total
    return rest.error if rest.gathered.used and rest.error < 1 else None


def frame_rate(seconds: float) -> str:
    """Return the frames per second of the last frames with a new picture."""
    if seconds <= 0:
        return ""
    rate = 1 / seconds
    return f"{rate:.{0 if rate >= 10 else 1}f} frames/s"

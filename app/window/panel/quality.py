"""Quality: the estimator, one slider from fast to accurate with its cost and error, the state of the light."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from imgui_bundle import imgui

from app.rest.results import MeasuredPoint
from app.settings import Settings
from app.window.panel import status
from app.window.panel import widgets as ui
from app.window.parts import Window


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
    label = "Quality"
    changed, new = ui.int_slider(label, k + 1, 1, len(LEVELS), now)
    if changed:
        s = at_level(s, min(max(new, 1), len(LEVELS)) - 1, chosen)
    ui.tip(_about(chosen, session.points.all))
    cost = ui.ms(light.gi_seconds.value) if light.gi_seconds.value > 0 else ui.DASH
    of = f" of {s.budget:.0f} ms" if s.budget > 0 else ""
    ui.number("Costs per move", cost + of,
              "Time for light per frame while something moves: median of the last moves, and its limit.")  # fmt: skip
    if 0 < s.budget < 1e3 * light.gi_seconds.value:
        imgui.text_wrapped("Above the limit: a lower quality, or smaller objects, cost less.")
    error = status.error_of(session)
    imgui.begin_disabled(not session.is_current)  # the number of the light before
    ui.number("Error at rest", ui.DASH if error is None or session.in_motion else f"{100 * error:.1f} %",
              "Mean error of irradiance against an unbiased reference, relative to the mean irradiance. Places "
              "brighter than the view count less.")  # fmt: skip
    imgui.end_disabled()
    status.draw(session)
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


def at_level(s: Settings, k: int, chosen: int) -> Settings:
    """Return the settings with photons and time budget of a level."""
    return replace(s, photons=photons_of(LEVELS[k], chosen), budget=LEVELS[k].budget)


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
    from gi_core.estimators import ESTIMATORS  # already loaded here; at the top it would delay the window

    ui.label("Estimator")
    if imgui.begin_combo("##Estimator", ui.title(s.estimator)):
        for k, (key, kind) in enumerate(ESTIMATORS.items()):
            if imgui.selectable(ui.title(key), key == s.estimator)[0]:
                actions.add(f"estimator {k}")
            ui.tip(f"{kind.about}\nKey {k + 1}")
        imgui.end_combo()
    else:
        ui.tip(f"Method that computes the light on surfaces from photon paths. Keys 1 to {len(ESTIMATORS)}.")

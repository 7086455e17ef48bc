"""Error against the unbiased reference, measured at rest, and side-by-side comparison."""

from __future__ import annotations

import math
from dataclasses import replace

from imgui_bundle import imgui

from app.settings import REFERENCE, Settings
from app.window.panel import widgets as ui
from app.window.parts import Window

NO_COMPARISON = "None"


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    r = window.session.light.snapshot.rest.report
    changed, measure_errors = imgui.checkbox("Measure errors", s.measure_errors)
    if changed:
        s = replace(s, measure_errors=measure_errors)
    ui.tip("Measure errors while nothing moves. A drag interrupts the measurement.")
    imgui.begin_disabled(not window.session.is_current)  # numbers of the light before
    at = ui.DASH if r is None else f"{ui.thousands(r.receivers)} of {ui.thousands(r.of)}"
    about = "Receivers store light, one per vertex and side. A large scene is measured at a random sample of them."
    ui.number("Receivers", at, about)
    ui.number(
        "Total",
        _percent(r and r.total),
        "Mean error of irradiance against the unbiased reference, relative to the mean irradiance. Absolute values, in "
        "luminance, weighted by area. Places brighter than the view count less, by their light.",
    )
    ui.number(
        "   noise",
        _percent(r and r.noise, "up to "),
        "Error that more photons remove: an upper bound, from the difference to a subset of the photons.\n"
        "For photon_map it includes the effect of the changed search radius.",
    )
    ui.number(
        "   bias",
        _percent(r and r.bias, "at least "),
        "Error that more photons do not remove, such as blur over the radius: a lower bound.\n"
        "bias² = total² - noise² - reference noise².",
    )
    paths = "" if r is None else f" So far: {ui.thousands(round(r.paths))} paths per receiver."
    ui.number(
        "Reference noise",
        _percent(r and r.reference_noise, "±"),
        f"Noise of the reference, included in the total.{paths}",
    )
    imgui.end_disabled()
    return _compare(s)


def _compare(s: Settings) -> Settings:
    from gi_core.estimators import ESTIMATORS  # already loaded here

    names = {"": NO_COMPARISON, **{key: ui.title(key) for key in ESTIMATORS}, REFERENCE: ui.title(REFERENCE)}
    s = ui.choice(
        s, "Compare with", "compare", names,
        "Show another estimator of the same photons, or the reference, right of a line that you drag across the "
        "picture. It is computed while nothing moves. With an estimator, both sides show the light of photons alone.",
    )  # fmt: skip
    changed, reference = imgui.checkbox("Show reference", s.reference)
    if changed:
        s = replace(s, reference=reference)
    ui.tip("Show the reference in place of the estimate. Key 0.")
    return s


def _percent(value: float | None, bound: str = "") -> str:
    """Return a share in percent, a dash for an unknown one."""
    if value is None or math.isnan(value):
        return ui.DASH
    if value <= 0:
        return "not measurable"
    return f"{bound}{100 * value:.{1 if value >= 0.00995 else 2}f} %"

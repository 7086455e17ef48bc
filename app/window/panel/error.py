"""How far off the picture is, told from the unbiased reference at rest; and what to compare it with."""

from __future__ import annotations

import math
from dataclasses import replace

from imgui_bundle import imgui

from app.settings import REFERENCE, Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

OFF = "Nothing"


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    r = facts.report
    ui.label("Measure")
    changed, appraise = imgui.checkbox("##Measure errors", s.appraise)
    if changed:
        s = replace(s, appraise=appraise)
    ui.tip("Measure errors while everything rests, with both processors' spare time. A drag stops it at once.")
    if r is not None:
        where = "all" if r.receivers == r.of else f"{ui.thousands(r.receivers)} of"
        imgui.same_line()
        imgui.text_disabled(f"at {where} {ui.thousands(r.of)} points")
        ui.tip("Receivers that the error is measured at: all, or a random choice of them where there are many.")
    ui.number(
        "Total",
        _percent(r and r.total),
        "How far irradiance is off the unbiased reference: the mean magnitude of the error of luminance, by area, "
        "relative to the mean of the light. Measured at the poses as they are, as soon as everything rests.",
    )
    ui.number(
        "   noise",
        _percent(r and r.noise, "up to "),
        "What more photons would remove. Told from the difference to the same picture from about half of the photons, "
        "scaled as if they were independent: rather too much than too little. It says nothing before some 10 000 "
        "photons. With photon_map it holds the change of its search radius too.",
    )
    ui.number(
        "   bias",
        _percent(r and r.bias, "at least "),
        "What no number of photons removes: shadows and corners blurred over the radius. What is left of the total "
        "when noise and the reference's noise are taken out, as squares; as noise is rather overstated, there may be "
        "more of it. An estimate.",
    )
    paths = "" if r is None else f" {ui.thousands(round(r.paths))} paths a point so far."
    ui.number(
        "The reference itself",
        _percent(r and r.truth_noise, "±"),
        f"The reference's own noise, which is in the total: an error below it says nothing.{paths}",
    )
    return _compare(s, facts)


def _compare(s: Settings, facts: Facts) -> Settings:
    names = {"": OFF, **{key: ui.title(key) for key in facts.estimators}, REFERENCE: ui.title(REFERENCE)}
    s = ui.choice(
        s, "Wipe", "compare", names,
        "What to show right of a line that can be dragged across the picture: another estimator of the same photons, "
        "or the reference. Computed while everything rests.",
    )  # fmt: skip
    ui.label("Reference")
    changed, reference = imgui.checkbox("##Show reference", s.reference)
    if changed:
        s = replace(s, reference=reference)
    ui.tip("Show the reference instead of the estimate. Key 0.")
    return s


def _percent(value: float | None, about: str = "") -> str:
    """Write a share; a dash while it is not known."""
    if value is None or math.isnan(value):
        return "\N{EM DASH}"
    if value <= 0:
        return "none seen"
    return f"{about}{100 * value:.{1 if value >= 0.00995 else 2}f} %"

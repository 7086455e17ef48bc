"""How light is shown: exposure, tone map, what of it, and through which walls."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from app.settings import ERRORS, SHOWS, TONE_MAPS, Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

EXPOSURE_MARGIN = 10.0  # EV either way of what was metered at load
TONE_MAP_NAMES = {"aces": "ACES (filmic)", "reinhard": "Reinhard", "clip": "Clip"}
SHOW_NAMES = {"radiance": "With reflectance", "irradiance": "Irradiance only", ERRORS: "Error map"}


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    ui.label("Exposure")
    em = imgui.get_font_size()
    imgui.set_next_item_width(-4.6 * em)
    low, high = facts.metered - EXPOSURE_MARGIN, facts.metered + EXPOSURE_MARGIN
    changed, exposure = imgui.slider_float("##Exposure", s.exposure, low, high, "%+.1f EV")
    if changed:
        s = replace(s, exposure=exposure)
    ui.tip("Brightness in stops: +1 doubles. Metered once at load, then fixed, so that light that changes shows.")
    imgui.same_line()
    if imgui.button("Meter", (-1, 0)):
        actions.add("meter")
    ui.tip("Choose the exposure for what is in view now. Key A.")

    s = ui.choice(s, "Tone map", "tone_map", {k: TONE_MAP_NAMES.get(k, k) for k in TONE_MAPS},
                "How radiance becomes display colour: ACES keeps highlights, Reinhard keeps hue, Clip is exact below "
                "white.")  # fmt: skip
    s = ui.choice(s, "Show", "show", {k: SHOW_NAMES.get(k, k) for k in (*SHOWS, ERRORS)},
                "With each surface's reflectance, the irradiance alone, as if everything were white, "
        "or the error of irradiance at every point, as a map with a legend.")  # fmt: skip
    ui.label("Doll's house")
    changed, cull = imgui.checkbox("##Doll's house", s.cull)
    if changed:
        s = replace(s, cull=cull)
    ui.tip("Look through the backs of one-sided faces, into closed rooms. Off: those backs are drawn dark grey.")
    return s

"""Display of light: exposure, tone map, quantity, backface culling."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from app.settings import ERRORS, ILLUMINANCE, SHOWS, TONE_MAPS, Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

EXPOSURE_MARGIN = 10.0  # EV on either side of the exposure metered at load
TONE_MAP_NAMES = {"aces": "ACES (filmic)", "reinhard": "Reinhard", "clip": "Clip"}
SHOW_NAMES = {"radiance": "Radiance", "irradiance": "Irradiance", ILLUMINANCE: "Illuminance", ERRORS: "Error map"}


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    ui.label("Exposure")
    em = imgui.get_font_size()
    imgui.set_next_item_width(-4.6 * em)
    low, high = facts.metered - EXPOSURE_MARGIN, facts.metered + EXPOSURE_MARGIN
    changed, exposure = imgui.slider_float("##Exposure", s.exposure, low, high, "%+.1f EV")
    if changed:
        s = replace(s, exposure=exposure)
    ui.tip("Exposure in stops; +1 EV doubles brightness. Metered at load, then fixed.")
    imgui.same_line()
    if imgui.button("Auto", (-1, 0)):
        actions.add("meter")
    ui.tip("Meter the exposure from the current view. Key A.")

    s = ui.choice(s, "Tone map", "tone_map", {k: TONE_MAP_NAMES.get(k, k) for k in TONE_MAPS},
                "Map from radiance to display colour. ACES keeps highlights, Reinhard keeps hue, Clip is exact below "
                "white.")  # fmt: skip
    s = ui.choice(s, "Show", "show", {k: SHOW_NAMES.get(k, k) for k in (*SHOWS, ERRORS)},
                "Radiance: the picture. Irradiance: the light on surfaces, drawn as if all were white. "
                "Illuminance: false colours of it, with a scale in lx or W/m². Error map: "
                "the error of irradiance against the reference.")  # fmt: skip
    ui.label("Cull backfaces")
    changed, cull = imgui.checkbox("##Cull backfaces", s.cull)
    if changed:
        s = replace(s, cull=cull)
    ui.tip("Hide the backs of one-sided faces, to look into closed rooms. Off: backs are dark grey.")
    return s

"""Display of light: exposure, white balance, false colours, tone map, view."""

from __future__ import annotations

import argparse
import re
from dataclasses import replace

from imgui_bundle import imgui

from app import values
from app.draw.false_colour import Scale
from app.session.log import WARNING, Log
from app.settings import (
    CHANGE,
    ERROR_RANGES,
    ERRORS,
    FALSE_COLOURS,
    ILLUMINANCE,
    LUMINANCE,
    PICTURE_SCALES,
    TONE_MAPS,
    Settings,
)
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.scene.types import UNITS, Units

TONE_MAP_NAMES = {
    "agx": "AgX",
    "neutral": "Khronos PBR Neutral",
    "aces": "ACES (filmic)",
    "reinhard": "Reinhard",
    "clip": "Clip",
}
AUTOMATIC = "Automatic"
METER = ui.Button(
    "meter",
    "Meter exposure",
    "Set the exposure by the present view and light: the median radiance becomes mid-grey, or less where much of the "
    "view is bright. Surfaces that shine count too. Key A.",
)

KEEP = ui.Button(
    "keep light", "Keep as A", "Keep the light on show, to compare later light with it: Show, Change since A."
)


def show_names(units: Units) -> dict[str, str]:
    """Return the choices of the quantity shown, by value of `Settings.show`."""
    return {
        "radiance": "Picture",
        "irradiance": "Light alone",
        ILLUMINANCE: f"{units.on_surface} in {units.per_area}",
        LUMINANCE: f"{units.from_surface.capitalize()} in {units.per_solid_angle}",
        ERRORS: "Error map",
        CHANGE: "Change since A",
    }


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    start, units = window.session.start_exposure, UNITS[window.session.scene.units]
    low, high = start - 10.0, start + 10.0  # EV
    of_values = "false colours show values of light" if s.show in FALSE_COLOURS else ""
    with ui.idle(of_values):
        changed, exposure = ui.slider("Exposure", s.exposure, low, high, f"{s.exposure:+.1f} EV", read=values.exposure)
        if changed:
            s = replace(s, exposure=exposure)
        ui.tip("Exposure in stops; +1 EV doubles brightness. It stays until it is changed here, or metered by key A.")
    s = ui.choice(s, "Show", "show", show_names(units),
                "Picture: the light that the camera sees (radiance).\n"
                "Light alone: the light on surfaces (irradiance), drawn as if all were white.\n"
                f"{units.on_surface}: light per area on surfaces, in false colours.\n"
                f"{units.from_surface.capitalize()}: light that the camera sees, in false colours.\n"
                "Error map: error of irradiance against the reference.\n"
                "Change since A: light on surfaces now, less that which Keep as A has kept.")  # fmt: skip
    s = _scale(s, window.viewport.picture.scale, units, window.log)
    with ui.idle(of_values):
        s = ui.choice(s, "Tone map", "tone_map", {k: TONE_MAP_NAMES.get(k, k) for k in TONE_MAPS},
                      "Map from radiance to display colour. ACES keeps highlights, Reinhard keeps hue, Clip is exact "
                      "below white.")  # fmt: skip
    with ui.idle(of_values):
        s = ui.switch(s, "White balance", "white_balance",
                      "Draw the light of all lamps of the scene file together neutral, as a camera set to it does. A "
                      "lamp that is coloured here, or alone, keeps its colour beside that. Off: all light has its own "
                      "colour.")  # fmt: skip
    about = "Hide the backs of one-sided faces, to look into closed rooms. Off: backs are dark grey."
    s = ui.switch(s, "Back-face culling", "cull", about)
    sizes: dict = {k: f"{k}x the pixels" for k in PICTURE_SCALES}
    s = ui.choice(s, "Saved picture", "picture_scale", sizes, "Size of pictures saved by P, relative to the viewport.")
    ui.buttons(actions, METER, ui.Button("reset view", "Reset view", "Return the camera to its start. Key Home."))
    with ui.idle("" if window.session.light_to_keep else "errors are not known yet; only best light has them"):
        ui.buttons(actions, KEEP)
    return s


def _scale(s: Settings, fitted: Scale | None, units: Units, log: Log) -> Settings:
    """Draw the choice of the scale: of false colours, of the error map; disabled without either."""
    with ui.idle("" if s.show in (ERRORS, *FALSE_COLOURS) else "only false colours and the error map have a scale"):
        s = _ends(s, fitted, units)
    with ui.idle("" if s.show == ILLUMINANCE else "isolines lie over false colours of light on surfaces"):
        return _isolines(s, log)


def _ends(s: Settings, fitted: Scale | None, units: Units) -> Settings:
    """Draw the choice of the scale."""
    if s.show == ERRORS:
        names: dict = {None: AUTOMATIC, **{r: f"±{100 * r:.0f} %" for r in ERROR_RANGES}}
        s = ui.choice(s, "Scale", "error_range", names, "Ends of the colours of the error map.")
    else:
        field = "luminance_range" if s.show == LUMINANCE else "illuminance_range"
        fixed = s.false_colour_range or (fitted and fitted[:2])
        names = {None: AUTOMATIC}
        if fixed:
            unit = units.per_solid_angle if s.show == LUMINANCE else units.per_area
            names[fixed] = f"{fixed[0]:g} to {fixed[1]:g} {unit}"
        s = ui.choice(s, "Scale", field, names,
                      "Automatic: fitted to the view at rest. Fixed: the present ends stay; "
                      f"--{field.replace('_', '-')} sets others.")  # fmt: skip
    return s


_typed = [""]  # values of the isolines


def _isolines(s: Settings, log: Log) -> Settings:
    """Draw the switch of the isolines and a field for their values."""
    changed, on = imgui.checkbox("Isolines", s.isolines is not None)
    ui.tip("Lines of equal illuminance over its false colours.")
    if changed:
        s = replace(s, isolines=() if on else None)
    imgui.same_line(ui.LABEL_EM * imgui.get_font_size())
    imgui.set_next_item_width(-1)
    imgui.begin_disabled(s.isolines is None)
    if not imgui.is_any_item_active():
        _typed[0] = ", ".join(f"{value:g}" for value in s.isolines or ())
    _, _typed[0] = imgui.input_text_with_hint("##isolines", "round values", _typed[0])
    if imgui.is_item_deactivated_after_edit():
        try:
            s = replace(s, isolines=values.isolines(",".join(re.findall(r"[^,;\s]+", _typed[0]))))
        except argparse.ArgumentTypeError as problem:  # the field shows the last values again
            log(f"isolines: they {problem}", WARNING)
    ui.tip(f"Their values, up to {values.MOST_ISOLINES}, with commas; empty: round values.")
    imgui.end_disabled()
    return s

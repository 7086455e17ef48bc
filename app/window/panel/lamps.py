"""Lamps: level, colour, on and solo of each; light scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from imgui_bundle import imgui

from app.draw.colour_map import COOLEST, HOTTEST, factor, kelvin_of, of_luminance_one
from app.session.lights import LightId
from app.session.session import Session
from app.settings import LampLevel, Settings
from app.window import theme
from app.window.panel import lights
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.geometry.error import REC709, luminance
from gi_core.lights.lamps import BRIGHTEST
from gi_core.lights.power import full_watts
from gi_core.scene.pose import three
from gi_core.scene.types import UNITS

BRIGHTEST_BY_SLIDER = 4.0  # times the level of the scene file; typed, up to BRIGHTEST
PERCENT = "   %.0f %%"  # right of the knob at 100 %
RGB_FLAGS = imgui.ColorEditFlags_.float | imgui.ColorEditFlags_.hdr | imgui.ColorEditFlags_.no_small_preview
NAMELESS = "without a name"  # ImGui takes no empty label
OF_FILE = "as in the scene file"  # a choice beside the light scenes

_typed = [""]  # name of the light scene to keep


def draw(s: Settings, window: Window, actions: set[Any]) -> Settings:
    session, selected = window.session, window.viewport.lamps.selected
    lamps = session.model.emitters.lamps.names
    s = _light_scenes(s, session)
    setting_of = {lamp.name: lamp for lamp in s.lamps}
    solo = s.solo
    names = max((imgui.calc_text_size(name).x for name in lamps), default=0.0)
    for k, name in enumerate(lamps):
        imgui.push_id(name)
        lamp = setting_of.get(name, LampLevel(name))
        changed, lamp, solo = _row(lamp, solo, k, window, names, actions)
        if changed:
            setting_of[name] = lamp
        imgui.pop_id()
    s = replace(s.in_light_scene(tuple(setting_of.values())), solo=solo)
    flux = sum(_flux(setting_of.get(name, LampLevel(name)), solo, k, session) for k, name in enumerate(lamps))
    ui.number("Together", _shown(flux, session), "Flux of all lamps at their levels.")
    watts = full_watts(session.scene, s.watts)
    if watts:
        ui.number("Power", session.power.text(), "Watts of photometric files, or as stated, at these levels.")
    snapshot = session.light.snapshot
    if snapshot.effective_photons < snapshot.photons:
        share = f"{100 * snapshot.effective_photons / max(snapshot.photons, 1):.0f} %"
        about = "Lamps share the photons. Under 25 %, they are traced again, shared by the new levels."
        ui.number("Photons that count", share, about)
    imgui.begin_disabled(not s.lamps and not s.solo)
    if imgui.button("Reset lamps", (-1, 0)):
        s = replace(s, lamps=(), solo="")
    ui.tip("Return all lamps to the levels of the scene file.")
    imgui.end_disabled()
    if selected is not None and selected.name in lamps:
        imgui.separator()
        lights.head(selected, session, actions)
        name = selected.name
        lamp = _flux_field(setting_of.get(name, LampLevel(name)), lamps.index(name), session)
        unselected = tuple(other for other in s.lamps if other.name != name)
        s = s if lamp == setting_of.get(name, LampLevel(name)) else replace(s, lamps=(*unselected, lamp))
        (power,), edited, *_ = ui.fields("Watts", (watts.get(name, 0.0),), 0.5, "%.5g W", ("watts",))
        ui.tip("Electric power of the selected lamp at full level; 0: none.")
        if edited:
            s = replace(s, watts=tuple({**dict(s.watts), name: max(power, 0.0)}.items()))
    lights.draw(window, actions)
    return s


def _flux_field(lamp: LampLevel, k: int, session: Session) -> LampLevel:
    """Draw the flux of the selected lamp as a number; it sets the level."""
    unit = UNITS[session.scene.units].flux
    full = _flux(lamp._replace(level=1.0, on=True), "", k, session)
    (flux,), edited, *_ = ui.fields("Flux", (full * lamp.level,), max(2e-3 * full, 1e-6), f"%.5g {unit}", ("flux",))
    ui.tip("Flux of the selected lamp. Double-click to type it; the level follows.")
    return lamp._replace(level=min(max(float(f"{flux / full:.9g}"), 0.0), BRIGHTEST)) if edited and full > 0 else lamp


def _light_scenes(s: Settings, session: Session) -> Settings:
    """Draw the choice of light scenes, and a field that keeps the present levels as one."""
    ui.label("Light scene")
    names = session.model.emitters.lamps.names
    of_file = dict(session.scene.light_scenes)
    asked, choices = s.levels(names), of_file | dict(session.settings.light_scenes)
    choices.setdefault(OF_FILE, ())
    shown = (name for name, lamps in choices.items() if s.in_light_scene(lamps).levels(names) == asked)
    now = next(shown, None)
    names_shown = {name: (name or NAMELESS, "") for name in choices}
    chosen = ui.one_of("Light scene", "as set below" if now is None else now, names_shown, now)
    ui.tip("A light scene is a named state of all lamps: levels, colours, on or off. Keep adds one.")
    if chosen is not None:
        s = s.in_light_scene(choices[chosen])
    ui.label("Keep as")
    em = imgui.get_font_size()
    imgui.set_next_item_width(imgui.get_content_region_avail().x - 3.6 * em)
    _, _typed[0] = imgui.input_text_with_hint("##Keep as", "a light scene", _typed[0])
    ui.tip("Keep the present levels of all lamps as a light scene, a named state that the list recalls. File > Save "
           "stores it.")  # fmt: skip
    imgui.same_line()
    imgui.begin_disabled(not _typed[0].strip())
    if imgui.button("Keep", (-1, 0)):
        s, _typed[0] = s.with_light_scene(_typed[0].strip(), names), ""
    imgui.end_disabled()
    return s


def _row(
    lamp: LampLevel, solo: str, k: int, window: Window, names: float, actions: set[Any]
) -> tuple[bool, LampLevel, str]:
    """Draw a lamp's row; return whether it changed, the lamp, and the name of the lamp that is alone.

    names: width of the longest name [points].
    """
    solo_em = 2.5  # width of the button
    em, before, gap = imgui.get_font_size(), lamp, imgui.get_style().item_inner_spacing.x
    left, width = imgui.get_cursor_pos_x(), imgui.get_content_region_avail().x
    lit = lamp.on and solo in ("", lamp.name)
    session, selected = window.session, window.viewport.lamps.selected
    flux = _shown(_flux(lamp, solo, k, session), session)
    if solo in ("", lamp.name):
        lamp = lamp._replace(on=imgui.checkbox("##on", lamp.on)[1])
        ui.tip("On or off.")
    else:
        imgui.begin_disabled()
        imgui.checkbox("##on", False)
        imgui.end_disabled()
        ui.tip(f"Off because of Solo of {solo}. After All it is {'on' if lamp.on else 'off'}.")
    imgui.same_line(0, gap)
    name_at, most = imgui.get_cursor_pos_x(), min(names, 0.42 * width)  # at most 0.42 of a row for the name
    chosen = selected is not None and selected.name == lamp.name
    usual = imgui.get_style_color_vec4(imgui.Col_.text if lit else imgui.Col_.text_disabled)
    imgui.push_style_color(imgui.Col_.text, imgui.ImVec4(*theme.ACCENT, 1.0) if chosen else usual)
    imgui.align_text_to_frame_padding()
    if imgui.selectable(f"{ui.shortened(lamp.name, most)}###select", chosen, 0, (most, 0))[0]:
        actions.add(("select lamp", None if chosen else LightId(lamp.name)))
    imgui.pop_style_color()
    ui.tip(f"{lamp.name}: {flux}. Click to select the lamp.")
    right = left + width - solo_em * em
    colour_at = right - gap - imgui.get_frame_height()
    level_end = colour_at - gap
    if width > 25.0 * em:  # there is room for the flux
        level_end -= 5.0 * em
        imgui.same_line(colour_at - gap - imgui.calc_text_size(flux).x)
        imgui.text(flux)
    level_at = name_at + most + gap
    imgui.same_line(level_at)
    imgui.set_next_item_width(level_end - level_at)
    imgui.begin_disabled(not lit)
    changed, percent = imgui.slider_float("##level", 100 * lamp.level, 0.0, 100 * BRIGHTEST_BY_SLIDER, PERCENT)
    imgui.end_disabled()
    if changed:
        lamp = lamp._replace(level=min(max(round(percent / 100, 4), 0.0), BRIGHTEST))
    ui.tip(f"Level of the lamp, 100 % as in the scene file: {flux} now. Ctrl-click to type one, up to "
           f"{100 * BRIGHTEST:.0f} %.")  # fmt: skip
    imgui.same_line(colour_at)
    lamp = _colour(lamp, of_luminance_one(session.model.emitters.flux_of_lamps[k]))
    imgui.same_line(right)
    imgui.push_style_var(imgui.StyleVar_.frame_padding, (0, imgui.get_style().frame_padding.y))
    if imgui.button("Solo" if solo != lamp.name else "All", (solo_em * em, 0)):
        solo = "" if solo == lamp.name else lamp.name
    imgui.pop_style_var()
    ui.tip("This lamp alone; press again for all that are on. The exposure stays, to compare lamps; key A meters it.")
    return lamp != before, lamp, solo


def _colour(lamp: LampLevel, base: tuple[float, float, float]) -> LampLevel:
    """Draw the lamp's colour; a click opens temperature and RGB."""
    shown = [c * b for c, b in zip(lamp.colour, base, strict=True)]
    most = max(*shown, 1e-9)
    drawn = imgui.ImVec4(*((c / most) ** (1 / 2.2) for c in shown), 1.0)
    if imgui.color_button("##colour", drawn, imgui.ColorEditFlags_.no_tooltip):
        imgui.open_popup("colour")
    ui.tip("Colour of the lamp's light. Click for temperature and RGB.")
    if imgui.begin_popup("colour"):
        imgui.push_item_width(14 * imgui.get_font_size())
        now, flags = kelvin_of(shown), imgui.SliderFlags_.logarithmic
        changed, kelvin = imgui.slider_float("K", now, COOLEST, HOTTEST, "%.0f", flags)
        if changed:
            lamp = lamp._replace(colour=three(float(f"{c:.9g}") for c in factor(kelvin, base)))
        ui.tip("Colour temperature, from candle to blue sky. The luminance stays.")
        changed, rgb = imgui.color_edit3("RGB", shown, RGB_FLAGS)
        ui.tip("Red, green and blue of the light, linear; of luminance 1 in the scene file. A channel without light in "
               "the scene file stays dark.")  # fmt: skip
        if changed:
            lamp = lamp._replace(colour=recoloured(lamp.colour, shown, rgb, base))
        if imgui.button("As in the scene file"):
            lamp = lamp._replace(colour=(1.0, 1.0, 1.0))
        imgui.pop_item_width()
        imgui.end_popup()
    return lamp


def recoloured(
    factors: Sequence[float], before: Sequence[float], rgb: Sequence[float], base: Sequence[float]
) -> tuple[float, float, float]:
    """Return the factors of a lamp whose colour changes to `rgb`; base: its colour in the scene file.

    A channel that has not been edited keeps its factor, bit for bit.
    """
    channels = zip(factors, before, rgb, base, strict=True)
    # changes below 1e-6 are the field's rounding to float32
    r, g, b = (f if b <= 0 or abs(new - old) < 1e-6 else max(new, 0.0) / b for f, old, new, b in channels)
    return r, g, b


def _flux(lamp: LampLevel, solo: str, k: int, session: Session) -> float:
    """Return the luminance of the lamp's flux at its level."""
    if not lamp.on or solo not in ("", lamp.name):
        return 0.0
    full = session.model.emitters.flux_of_lamps[k]
    lit = [c * b for c, b in zip(lamp.colour, of_luminance_one(full), strict=True)]
    return float(luminance(full)) * lamp.level * float(REC709 @ lit)


def _shown(flux: float, session: Session) -> str:
    number = f"{flux:.4g}" if flux < 1e4 else ui.thousands(round(flux))
    return f"{number} {UNITS[session.scene.units].flux}"

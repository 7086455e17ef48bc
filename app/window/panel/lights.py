"""The selected lamp: place, aim, beam and size of its light; lamps added, copied and removed. Daylight too."""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from imgui_bundle import imgui

from app import values as readers
from app.session.cities import cities, name_of, utc_offset, zone_at
from app.session.lights import (
    BULB,
    DAYLIGHT,
    PANEL,
    SKY,
    SPOT,
    SUN,
    Directed,
    LightId,
    aim_of,
    aimed,
    beam,
    north_angle,
    north_at,
)
from app.session.session import Session
from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.files.edits import Values
from gi_core.files.formats.toml_file import COSINE
from gi_core.lights.daylight import sun_of
from gi_core.lights.lamps import OTHERS
from gi_core.scene.errors import utf8
from gi_core.scene.pose import three
from gi_core.scene.types import (
    OVERCAST_SKY,
    SUNLESS_SKIES,
    UNIFORM_SKY,
    Daylight,
    DirectionalLight,
    Light,
    PhotometricLight,
    PlacedLight,
    PointLight,
    SkyLight,
    SpotLight,
)

FILE = "from a file..."
KINDS = {
    BULB: "A point that shines equally in all directions.",
    SPOT: "A point that shines into a cone.",
    PANEL: "A rectangle of constant luminance, as a ceiling panel.",
    DAYLIGHT: "Sun and sky by place, date and hour. Rooms need an opening.",
    SUN: "Parallel light.",
    SKY: "A dome above everything, uniform at first. Rooms need an opening.",
    FILE: "A luminaire by its maker's IES or EULUMDAT file (.ies, .ldt).",
}
SKY_TYPES = {
    1: "overcast",
    3: "overcast, moderate",
    UNIFORM_SKY: "uniform",
    12: "clear",
    13: "clear, polluted",
    OVERCAST_SKY: "overcast, 1 + 2 sin",
}
DUPLICATE = ui.Button("duplicate lamp", "Duplicate lamp", "Put a copy of the lamp beside it.")
REPLACE = ui.Button(
    "replace lamp",
    "Make movable###lamp",
    "Put a panel of the same flux and size in place of the light of these surfaces: it can be moved and turned. The "
    "surfaces stay, dark.",
)
REMOVE = ui.Button("remove lamp", "Remove lamp", "Remove the lamp. Surfaces that shine stay, dark.")
AIM = {
    "Tilt": "Angle from straight down",
    "Heading": "Angle about the vertical",
    "Turn": "Angle about the lamp's own axis",  # of luminaires alone
}
CONE = {
    "Inner cone": "Angle from the axis up to which the light is full",
    "Outer cone": "Angle from the axis at which the light ends",
}

_headings: dict[LightId, float] = {}  # last heading: straight down has none


def draw(window: Window, actions: set[Any]) -> None:
    """Draw the selected lamp, and the buttons that add, copy and remove lamps."""
    session, selected = window.session, window.viewport.lamps.selected
    if selected is not None:
        light = session.lights.get(selected)
        imgui.push_id("light")
        if light is not None:
            _light(selected, light, session, actions)
        imgui.pop_id()
    if selected is not None and selected.name != OTHERS:
        ui.buttons(actions, DUPLICATE if selected in session.lights else REPLACE, REMOVE)
    imgui.set_next_item_width(-1)
    kinds = {kind: (kind.capitalize(), about) for kind, about in KINDS.items()}
    if session.daylight is not None:
        del kinds[DAYLIGHT]
    kind = ui.one_of("Add lamp", "Add a lamp...", kinds)
    if kind is not None:
        actions.add(("add lamp", kind))
    ui.tip("It hangs below the ceiling over the middle of the picture, or over the surface clicked last. Photometric "
           "files may be dropped on the picture too.")  # fmt: skip


def head(lamp: LightId, session: Session, actions: set[Any]) -> None:
    """Name the selected lamp and the kind of its light; of several lights, choose one."""
    kind = "the weaker ones together" if lamp.name == OTHERS else _kind(session.lights.get(lamp))
    ui.number(lamp.name, kind, "Selected lamp, and its kind. Click its row to select none.")
    several = [light for light in session.lights if light.name == lamp.name]
    if len(several) > 1:
        ui.label("Light")
        names = {light: (f"{light.number} of {len(several)}", "") for light in several}
        if (light := ui.one_of("which", names[lamp][0], names, lamp)) is not None:
            actions.add(("select lamp", light))
        ui.tip("Lights of one name are one lamp. Each has its own place.")


def _kind(light: Light | None) -> str:
    match light:
        case None:
            return "surfaces that shine"
        case PointLight():
            return BULB
        case SpotLight():
            return SPOT
        case PhotometricLight():
            return PANEL if light.intensity is COSINE else "photometric"
        case DirectionalLight():
            return SUN
        case SkyLight(sun=None):
            return SKY
    return "sky"


def _light(lamp: LightId, light: Light, session: Session, actions: set[Any]) -> None:
    speed = ui.SPEED * session.chosen.scene_size
    if isinstance(light, PlacedLight):
        values, edited, *_ = ui.fields("Position", light.position, speed, "%.3f")
        ui.tip("Position [m]: x, y, z. Drag, or double-click to type. In the picture, drag the lamp's mark.")
        _changed(lamp, (("position", three(values)),), edited, actions)
    if isinstance(light, Directed):
        tilt, heading, turn = aim_of(light, session.scene.up, _headings.get(lamp, 0.0))
        _headings[lamp] = heading
        angles = [tilt, heading, turn]
        for k, (name, about) in enumerate(AIM.items()):
            if name == "Turn" and not isinstance(light, PhotometricLight):
                continue
            (angles[k],), edited, *_ = ui.fields(name, angles[k : k + 1], 0.5, "%.1f°", ("angle",))
            ui.tip(f"{about} [degrees]. In the picture, drag the ring where the lamp's axis meets a surface.")
            if edited:
                _headings[lamp] = angles[1]
            tilt, heading, turn = angles
            _changed(lamp, aimed(light, tilt, heading, turn, session.scene.up), edited, actions)
    if isinstance(light, SpotLight):
        cone = [light.inner_degrees, light.outer_degrees]
        for k, (name, about) in enumerate(CONE.items()):
            (cone[k],), edited, *_ = ui.fields(name, cone[k : k + 1], 0.2, "%.1f°", ("angle",))
            ui.tip(f"{about} [degrees]. The flux stays.")
            _changed(lamp, beam(light, *cone), edited, actions)
    if isinstance(light, DirectionalLight):
        (degrees,), edited, *_ = ui.fields("Disc", (light.disc_degrees,), 0.02, "%.2f°", ("angle",))
        ui.tip("Angular diameter of the sun [degrees]: its shadows are as soft. The irradiance stays.")
        _changed(lamp, (("disc_degrees", min(max(degrees, 0.0), 90.0)),), edited, actions)
    if isinstance(light, SkyLight):
        types = range(1, OVERCAST_SKY + 1) if light.sun is not None else SUNLESS_SKIES
        if (cie := _sky_type(light.cie, types)) is not None:
            actions.add(("change light", lamp, (("cie", cie),)))
    if isinstance(light, PhotometricLight):
        values, edited, *_ = ui.fields("Size", light.size, speed, "%.3f m", ("C0", "C90"))
        ui.tip("Sides [m] of the rectangle that shines; 0 and 0: a point.")
        a, b = (max(v, 0.0) for v in values)
        sides = (a, b) if a == b == 0 else (max(a, ui.LEAST_SIDE), max(b, ui.LEAST_SIDE))
        _changed(lamp, (("size", sides),), edited, actions)
        ui.label("File")
        file = session.file_of(lamp)
        name = (utf8(Path(file).name) if file else "Choose...") + "###file"
        about = "Give this lamp the distribution of an IES or EULUMDAT file (.ies, .ldt)."
        ui.buttons(actions, ui.Button("lamp file", name, about))


def _sky_type(cie: int, types: Iterable[int]) -> int | None:
    """Draw a choice of the distribution of a sky; return the type that is clicked."""
    ui.label("Sky")
    names = {k: (f"{k}: {SKY_TYPES.get(k, 'CIE')}", "") for k in types}
    chosen = ui.one_of("cie", f"{cie}: {SKY_TYPES.get(cie, 'CIE')}", names, cie)
    ui.tip("Distribution by ISO 15469. The light on open ground stays.")
    return chosen


_sought = [""]  # text in the list of cities


def _city(day: Daylight) -> str | None:
    """Draw a list of cities with a field that seeks one; return the zone of one that is chosen."""
    if not cities():
        return None
    ui.label("City")
    now, chosen = zone_at(day.place), None
    if imgui.begin_combo("##City", name_of(now) if now else "Choose..."):
        if imgui.is_window_appearing():
            _sought[0] = ""
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        entered, _sought[0] = imgui.input_text_with_hint(
            "##city", "Type a name", _sought[0], imgui.InputTextFlags_.enter_returns_true
        )
        fit = [zone for zone in cities() if _sought[0].lower() in name_of(zone).lower()]
        if entered and fit:
            chosen = fit[0]
            imgui.close_current_popup()
        for zone in fit:
            chosen = zone if imgui.selectable(f"{name_of(zone)}##{zone}", zone == now)[0] else chosen
        imgui.end_combo()
    ui.tip("Sets place and clock, with summer time. Cities are those of the time zone database.")
    return chosen


def daylight(s: Settings, window: Window, actions: set[Any]) -> Settings:
    """Draw place, date and hour of the daylight, and where its sun stands."""
    day = window.session.daylight
    if day is None:
        return s
    if (zone := _city(day)) is not None:
        place, offset = cities()[zone], utc_offset(zone, day.date, day.hour)
        actions.add(("change light", None, (("place", place), ("utc_offset", offset))))
    (latitude, longitude), edited, *_ = ui.fields("Place", day.place, 0.1, "%.2f°", ("latitude", "longitude"))
    ui.tip("Latitude and longitude [degrees], north and east positive.")
    place = min(max(latitude, -90.0), 90.0), min(max(longitude, -180.0), 180.0)
    _changed(None, (("place", place),), edited, actions)
    date = datetime.date.fromisoformat(day.date)
    first, last = (date.replace(month=m, day=d).toordinal() for m, d in ((1, 1), (12, 31)))
    moved, number = ui.slider("Date", date.toordinal(), first, last, day.date, read=readers.day)
    ui.tip("Day of the year. Ctrl-click to type one, such as 2026-03-21.")
    on = datetime.date.fromordinal(number).isoformat()
    clock = (("utc_offset", utc_offset(zone, on, day.hour)),) if (zone := zone_at(day.place)) else ()
    _changed(None, (("date", on), *clock), moved, actions)
    minutes = round(60 * day.hour)
    moved, hour = ui.slider("Hour", day.hour, 0.0, 24 - 1 / 60, f"{minutes // 60}:{minutes % 60:02}")
    ui.tip("Time of the clock. Ctrl-click to type one: 9.5 is half past nine.")
    _changed(None, (("hour", round(60 * hour) / 60),), moved, actions)
    moved, offset = ui.slider("Clock", day.utc_offset, -12.0, 15.0, f"UTC{day.utc_offset:+g}")
    ui.tip("Hours that the clock is ahead of UTC, summer time included. A city sets them.")
    _changed(None, (("utc_offset", round(4 * offset) / 4),), moved, actions)
    up = window.session.scene.up
    (turn,), edited, *_ = ui.fields("North", [north_angle(day, up)], 0.5, "%.1f°", ["angle"])
    ui.tip("Direction of north, clockwise from above [degrees], from -z with y up, from y with z up.")
    _changed(None, (("north", north_at(turn, up)),), edited, actions)
    if (cie := _sky_type(day.sky, range(1, OVERCAST_SKY + 1))) is not None:
        actions.add(("change light", None, (("sky", cie),)))
    sun = sun_of(day)
    ui.number("Sun", f"{sun.altitude:.1f}°, {sun.azimuth:.1f}°", f"Altitude and azimuth: {sun}.")
    return s


def _changed(lamp: LightId | None, values: Values, edited: bool, actions: set[Any]) -> None:
    if edited:
        actions.add(("change light", lamp, values))

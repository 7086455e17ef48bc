"""Read-outs: light at the probes of the scene file, at pins, and on the measuring plane."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from imgui_bundle import imgui

from app.draw.readout import Pinned
from app.draw.units import Units, units_of
from app.rest.measuring_plane import PlaneLight
from app.session.session import Session
from app.settings import MeasuringPlane, Settings
from app.values import MOST_GRID_POINTS
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.geometry.error import luminance

PIN = ui.Button(
    "pin",
    "Pin a read-out",
    "Then click a surface in the picture. Key I pins at once what is under the cursor; Del removes it.",
)


class Edit(NamedTuple):
    """Request to change a field of the settings; one drag from `first` to `last` is one step of undo."""

    field: str
    value: Any
    first: bool = True
    last: bool = True


def draw(s: Settings, window: Window, actions: set[Any]) -> Settings:
    session, units = window.session, units_of(window.session.scene.units)
    snapshot, unit, surface = session.light.snapshot, units.per_area, units.on_surface
    imgui.begin_disabled(not session.is_current)  # numbers of the light before
    for name, E in snapshot.probes.items():
        red, green, blue = (f"{float(c):.4g}" for c in E)
        tip = f"{surface} at the probe: red {red}, green {green}, blue {blue}."
        ui.number(name, f"{float(luminance(E)):.4g} {unit}", tip)
    imgui.end_disabled()
    _pins(s, window.viewport.pins.shown, session.is_current, actions)
    ui.buttons(actions, PIN)
    _plane(s, session, actions)
    about = "Write probes, pins, and all points of the measuring plane into a table."
    ui.buttons(actions, ui.Button("export", "Export as CSV...", about, bool(snapshot.probes or s.pins or s.plane)))
    ui.wrapped("Point at a surface: the status line shows its light.")
    return s


def _pins(s: Settings, pinned: tuple[Pinned, ...], is_current: bool, actions: set[Any]) -> None:
    """Draw a row per pin: name, light, remove."""
    readings = {one.pin: one.reading for one in pinned}
    em = imgui.get_font_size()
    for k, pin in enumerate(s.pins):
        imgui.push_id(f"pin {k}")
        right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
        reading = readings.get(pin)
        is_finite = reading is not None and math.isfinite(reading.irradiance)
        value = f"{reading.irradiance:.4g} {reading.units.per_area}" if is_finite else ui.DASH
        width = imgui.calc_text_size(value).x
        imgui.set_next_item_width(imgui.get_content_region_avail().x - width - 3 * em)
        entered, name = imgui.input_text("##name", pin.name, imgui.InputTextFlags_.enter_returns_true)
        name = name.strip()
        if (entered or imgui.is_item_deactivated_after_edit()) and name and name != pin.name:
            actions.add(Edit("pins", (*s.pins[:k], pin._replace(name=name), *s.pins[k + 1 :])))
        ui.tip(reading.text() if reading is not None else "The surface of this pin is no longer there.")
        imgui.same_line(right - width - 2.2 * em)
        imgui.align_text_to_frame_padding()
        imgui.begin_disabled(not is_current)
        imgui.text(value)
        imgui.end_disabled()
        imgui.same_line(right - 1.6 * em)
        if imgui.button("x", (1.6 * em, 0)):
            actions.add(Edit("pins", s.pins[:k] + s.pins[k + 1 :]))
        ui.tip("Remove this read-out.")
        imgui.pop_id()


def _plane(s: Settings, session: Session, actions: set[Any]) -> None:
    metres_per_pixel = 0.01  # of a drag
    from app.rest.measuring_plane import default_plane, grid_of

    changed, on = imgui.checkbox("Measuring plane", s.plane is not None)
    ui.tip(
        "Mean, minimum and uniformity of illuminance on a horizontal plane: by default 0.75 m above the floor, "
        "without 0.5 m along the walls, with the grid of EN 12464-1. Path traced at rest, without bias."
    )
    if changed:
        actions.add(Edit("plane", default_plane(session.level) if on else None))
    if (plane := s.plane) is None:
        return
    (height,), *done = ui.fields("   height", (plane.height,), metres_per_pixel, "%.3f m", ("h",))
    _edited(plane._replace(height=height), done, actions)
    ui.tip("Height above the floor [m].")
    for k, axis in enumerate(session.level.axes.names):
        ends, *done = ui.fields(f"   {axis}", (plane.low[k], plane.high[k]), metres_per_pixel, "%.3f", ("from", "to"))
        ui.tip(f"Extent along {axis} [m], from and to.")
        low, high = list(plane.low), list(plane.high)
        low[k], high[k] = ends
        if high[k] - low[k] >= ui.LEAST_SIDE:
            _edited(plane._replace(low=(low[0], low[1]), high=(high[0], high[1])), done, actions)
    _points(plane, grid_of(plane, session.level).shape, actions)
    _numbers(session.light.snapshot.rest.plane, units_of(session.scene.units))


def _edited(plane: MeasuringPlane, done: list[bool], actions: set[Any]) -> None:
    edited, first, last = done
    if edited or first or last:
        actions.add(Edit("plane", plane, first, last))


def _points(plane: MeasuringPlane, shape: tuple[int, int], actions: set[Any]) -> None:
    """Draw the number of points along the axes."""
    ui.label("   points")
    changed, (a, b) = imgui.input_int2("##points", list(shape), imgui.InputTextFlags_.enter_returns_true)
    ui.tip(f"Points along the two axes, 1 to {MOST_GRID_POINTS} each.")
    if changed:
        a, b = (min(max(n, 1), MOST_GRID_POINTS) for n in (a, b))
        actions.add(Edit("plane", plane._replace(points=(a, b))))
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + ui.LABEL_EM * imgui.get_font_size())
    changed, norm = imgui.checkbox("EN 12464 grid", plane.points is None)
    ui.tip("The grid of EN 12464-1: cells of 0.2 · 5^log10(d) m for a side of d m.")
    if changed:
        actions.add(Edit("plane", plane._replace(points=None if norm else shape)))


def _numbers(light: PlaneLight | None, units: Units) -> None:
    from app.session.readouts import LEFT_OUT, shown

    unit = units.per_area
    if light is None:
        imgui.text_disabled("   measured at rest")
        return
    n = light.numbers
    imgui.begin_disabled(not light.is_current)
    for name, value, error, of, about in (
        ("mean", n.mean, n.mean_error, unit, "Arithmetic mean of all points."),
        ("minimum", n.least, n.least_error, unit, "Least of all points. Noise makes it too small, by about its error."),
        ("maximum", n.most, n.most_error, unit, "Largest of all points."),
        ("uniformity U0", n.U0, n.U0_error, "", "Minimum / mean (EN 12665)."),
        ("diversity Ud", n.Ud, n.Ud_error, "", "Minimum / maximum."),
    ):
        ui.number(f"   {name}", shown(value, error, of), f"{about} ± is one standard error.")
    imgui.end_disabled()
    state = (
        "measured at rest" if not light.is_current else "" if light.fraction >= 1 else f"{100 * light.fraction:.0f} %"
    )
    inside = f"{n.left_out} {LEFT_OUT}" if n.left_out else ""
    ui.number("   points", ", ".join(part for part in (str(n.points), inside, state) if part),
              "Points that count, those that do not, and how far measuring is.")  # fmt: skip

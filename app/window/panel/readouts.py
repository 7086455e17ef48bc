"""Read-outs: light at the probes of the scene file, at pins, and on calculation surfaces."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from imgui_bundle import imgui

from app.draw.readout import Pinned
from app.rest.calculation_surface import FAIL, PASS, WORKING_PLANE, SurfaceLight, surfaces_of
from app.rest.hold import is_on
from app.rest.surface_grid import in_room, on_part
from app.session.readouts import LEFT_OUT, LONG_NAMES, free_name, judged, per_100_lux, shown, unit_of
from app.session.session import Session
from app.settings import Settings
from app.values import maintenance
from app.window import theme
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.geometry.error import luminance
from gi_core.lights.power import Power
from gi_core.scene.types import MOST_GRID_POINTS, QUANTITIES, TARGETS, UGR, UNITS, CalculationSurface, Units

PIN = ui.Button(
    "pin",
    "Pin a read-out",
    "Then click a surface in the picture. Key I pins the point under the cursor at once; Del removes it.",
)


ABOUT = {
    "mean": "Arithmetic mean of all points.",
    "minimum": "Least of all points. Noise makes it too small, by about its error.",
    "maximum": "Largest of all points.",
    "U0": "Minimum / mean (EN 12665).",
    "Ud": "Minimum / maximum.",
}


def draw(s: Settings, window: Window, actions: set[Any]) -> Settings:
    session, units = window.session, UNITS[window.session.scene.units]
    snapshot, unit, surface = session.light.snapshot, units.per_area, units.on_surface
    imgui.begin_disabled(not session.is_current)  # numbers of the light before
    for name, E in snapshot.probes.items():
        red, green, blue = (f"{float(c):.4g}" for c in E)
        tip = f"{surface} at the probe: red {red}, green {green}, blue {blue}."
        ui.number(name, f"{float(luminance(E)):.4g} {unit}", tip)
    imgui.end_disabled()
    _pins(s, window.viewport.pins.shown, session.is_current, actions)
    ui.buttons(actions, PIN)
    _surfaces(s, window, actions)
    about = "Write probes, pins, and all points of the surfaces into a table."
    has_numbers = bool(snapshot.probes or s.pins or snapshot.rest.surfaces)
    ui.buttons(actions, ui.Button("export", "Export as CSV...", about, has_numbers))
    ui.wrapped(
        "Point at a surface: the status line shows its light. Key J, or a click on a pin's dot: where it comes from."
    )
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
            actions.add(("edit", "pins", (*s.pins[:k], pin._replace(name=name), *s.pins[k + 1 :])))
        ui.tip(reading.text() if reading is not None else "The surface of this pin is no longer there.")
        imgui.same_line(right - width - 2.2 * em)
        imgui.align_text_to_frame_padding()
        imgui.begin_disabled(not is_current)
        imgui.text(value)
        imgui.end_disabled()
        imgui.same_line(right - 1.6 * em)
        if imgui.button("x", (1.6 * em, 0)):
            actions.add(("edit", "pins", s.pins[:k] + s.pins[k + 1 :]))
        ui.tip("Remove this read-out.")
        imgui.pop_id()


def _surfaces(s: Settings, window: Window, actions: set[Any]) -> None:
    """Draw the calculation surfaces: each with its place, its grid, its targets and its numbers."""
    session, viewport = window.session, window.viewport
    surfaces, lights = surfaces_of(s, session.scene), {x.surface: x for x in session.light.snapshot.rest.surfaces}
    grids, power_of = dict(session.grids), session.power if surfaces else None
    if surfaces:
        factor = s.maintenance_factor or session.scene.maintenance_factor
        moved, factor = ui.slider("Maintenance", factor, 0.3, 1.0, f"{factor:.2f}", read=maintenance)
        ui.tip("Maintenance factor of EN 12464-1: share of the light of lamps, not of sun and sky, that counts here.")
        if moved:
            actions.add(("edit", "maintenance_factor", round(factor, 2)))
    if any(surface.targets for surface in surfaces):
        _hold(s, session, actions)
    for k, surface in enumerate(surfaces):
        imgui.push_id(f"surface {k}")

        def edit(to: CalculationSurface | None, k: int = k) -> None:
            edited = () if to is None else (to,)
            actions.add(("edit", "surfaces", (*surfaces[:k], *edited, *surfaces[k + 1 :])))

        imgui.set_next_item_open(surface.name not in viewport.view.folded)
        unfolded = imgui.tree_node_ex(f"{surface.name}###surface")
        if imgui.is_item_toggled_open():
            actions.add(("fold surface", surface.name))
        ui.tip("Folded, the picture shows its outline and its mean, without points.")
        if unfolded:
            if surface in grids:
                _place(surface, session, edit)
                _grid(surface, grids[surface].shape, edit)
                _targets(surface, edit)
                unknown = SurfaceLight(surface, grids[surface], np.zeros(0), np.zeros(0), 0.0, False)
                kept = {} if session.kept is None else {x.surface: x for x in session.kept.surfaces}
                _numbers(lights.get(surface, unknown), UNITS[session.scene.units], power_of, kept.get(surface))
            else:
                ui.wrapped(f"{surface.on} is no longer there.")
            if imgui.button("Remove surface"):
                edit(None)
            imgui.tree_pop()
        imgui.pop_id()
    imgui.begin_disabled(not session.ready)
    names = [surface.name for surface in surfaces]
    if imgui.button("Add a surface"):
        actions.add(("edit", "surfaces", (*surfaces, WORKING_PLANE._replace(name=free_name(names, "surface")))))
    ui.tip(
        "Mean, minimum and uniformity of illuminance on a grid of points: by default 0.75 m above the floor, "
        "without 0.5 m along the walls, with the grid of EN 12464-1. Path traced at rest, without bias."
    )
    imgui.same_line()
    with ui.idle("" if (selected := viewport.surface) else "nothing is selected"):
        if imgui.button("On the selection"):
            name, at = free_name(names, selected), viewport.clicked
            new = CalculationSurface(name, selected)
            new = new if at is None else on_part(name, session.model, session.level, at.face)
            actions.add(("edit", "surfaces", (*surfaces, new)))
        ui.tip("A surface on top of the selected object, which moves with it, or on the level part that was clicked.")
    imgui.end_disabled()


def _hold(s: Settings, session: Session, actions: set[Any]) -> None:
    """Draw the switch of targets that lamps hold, with power and shortfall."""
    on, rest = is_on(s, session.scene), session.light.snapshot.rest
    held = rest.held
    right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
    changed, on = imgui.checkbox("Hold targets", on)
    ui.tip("Dims lamps to the fewest watts that hold the targets, in each frame: at most to the levels in Lamps.")
    if changed:
        actions.add(("edit", "hold", on))
    if not on:
        return
    state = f"{100 * rest.finding:.0f} % found" if held is None else "short" if held.missing else held.power
    imgui.same_line(right - imgui.calc_text_size(state).x)
    if held is not None and held.missing:
        imgui.text_colored((*theme.ERROR, 1.0), state)
    else:
        imgui.text(state)
    ui.tip("Levels are found by paths at the points." if held is None else "\n".join(held.sentences))
    for line in () if held is None else held.missing:
        ui.wrapped(line, theme.ERROR)


def _place(surface: CalculationSurface, session: Session, edit: Callable) -> None:
    """Draw name and place of a surface; the room completes the place."""
    ui.label("name")
    _, name = imgui.input_text("##name", surface.name)
    name = name.strip()
    taken = [x.name for x in surfaces_of(session.settings, session.scene)]
    if imgui.is_item_deactivated_after_edit() and name and name not in taken:
        edit(surface._replace(name=name))
    photometric = session.scene.units == "photometric"
    names = {quantity: (quantity, "") for quantity in QUANTITIES if photometric or quantity != UGR}
    ui.label("measures")
    if (quantity := ui.one_of("quantity", surface.quantity, names, surface.quantity)) is not None:
        edit(surface._replace(quantity=quantity, views=1, targets=()))
    ui.tip(
        "Cylindrical illuminance: mean over all vertical planes. "
        "Daylight factor: share of the light that the CIE's overcast sky brings to open ground [%]. "
        "UGR: glare of luminaires, for eyes that look along the first side; turn it to look elsewhere."
    )
    s = surface if surface.on else in_room(surface, session.level)
    metres, degrees = (0.01, "%.3f m"), (0.5, "%.1f°")  # speed of a drag per pixel, and digits
    rows = [
        ("height", metres, "Height [m]; on an object, above its top."),
        ("margin", metres, "Width left out along all sides [m]."),
    ]
    if not surface.on:
        a, b = session.level.axes.names
        rows += [
            ("position", metres, f"Its middle along {a} and {b} [m]."),
            ("size", metres, f"Its size along {a} and {b} [m], before it is turned."),
            ("tilt", degrees, "0: it faces up; 90: upright; 180: it faces down."),
            ("turn", degrees, f"About the vertical, from {a} to {b}."),
        ]
    for field, (speed, digits), about in rows:
        value = getattr(s, field) or 0.0
        values = value if isinstance(value, tuple) else (value,)
        numbers, edited, *_ = ui.fields(f"   {field}", values, speed, digits, "ab"[: len(values)])
        ui.tip(about)
        low, high = {"tilt": (0.0, 180.0), "margin": (0.0, 1e6), "size": (ui.LEAST_SIDE, 1e6)}.get(field, (-1e6, 1e6))
        numbers = tuple(min(max(number, low), high) for number in numbers)
        if edited:
            change: dict[str, Any] = {field: numbers if isinstance(value, tuple) else numbers[0]}
            edit(surface._replace(**change))


def _grid(surface: CalculationSurface, shape: tuple[int, int], edit: Callable) -> None:
    """Draw the number of points along the sides."""
    ui.label("   points")
    changed, (a, b) = imgui.input_int2("##points", list(shape), imgui.InputTextFlags_.enter_returns_true)
    ui.tip(f"Points along the two sides, 1 to {MOST_GRID_POINTS} each.")
    if changed:
        a, b = (min(max(n, 1), MOST_GRID_POINTS) for n in (a, b))
        edit(surface._replace(points=(a, b)))
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + ui.LABEL_EM * imgui.get_font_size())
    changed, norm = imgui.checkbox("EN 12464 grid", surface.points is None)
    ui.tip("The grid of EN 12464-1: cells of 0.2 · 5^log10(d) m for a side of d m.")
    if changed:
        edit(surface._replace(points=None if norm else shape))
    if surface.quantity == UGR:
        moved, views = ui.slider("   views", surface.views, 1, 36, str(surface.views))
        ui.tip("Directions that eyes look in at each point, evenly round the vertical; the worst counts.")
        if moved:
            edit(surface._replace(views=views))


def _targets(surface: CalculationSurface, edit: Callable) -> None:
    """Draw the targets of mean and U0, or of UGR; a scene file may have others."""
    targets, rows = dict(surface.targets), (("mean", "mean >=", 1.0, "%g"), ("U0", "U0 >=", 0.005, "%.2f"))
    for name, label, speed, digits in (("maximum", "UGR <=", 0.1, "%g"),) if surface.quantity == UGR else rows:
        (value,), edited, *_ = ui.fields(f"   {label}", (targets.get(name, 0.0),), speed, digits, "t")
        ui.tip("Target; 0: none. A target holds, or not, where that is certain by two standard errors.")
        if edited:
            asked = targets | {name: max(value, 0.0)}
            edit(surface._replace(targets=tuple((t, asked[t]) for t in TARGETS if asked.get(t))))


def _numbers(light: SurfaceLight, units: Units, power_of: Power | None, before: SurfaceLight | None) -> None:
    n, of_A = light.numbers, {} if before is None else {row[0]: row for row in before.rows()}
    imgui.begin_disabled(not light.is_current)
    for name, value, error, has_unit in light.rows():
        unit = unit_of(light.surface, units) if has_unit else ""
        ui.number(f"   {LONG_NAMES[name]}", shown(value, error, unit), f"{ABOUT[name]} ± is one standard error.")
        if name in of_A:
            ui.number("      in light A", shown(*of_A[name][1:3], unit), "When Keep as A kept it.")
        if target := judged(light, name, units).strip():
            colour = {PASS: theme.GOOD, FAIL: theme.ERROR}.get(light.verdicts[name], theme.DIM_TEXT)
            ui.wrapped(f"      {target}", colour)
    if power_of is not None and (text := per_100_lux(power_of, light, units)):
        ui.number("   power", text, "Power of all lamps per area of the floor, and per 100 lx of the mean.")
    imgui.end_disabled()
    share = "" if light.fraction >= 1 else f"{100 * light.fraction:.0f} %"
    state = share if light.is_current else "measured at rest"
    inside = f"{n.left_out} {LEFT_OUT}" if n.left_out else ""
    ui.number("   points", ", ".join(part for part in (str(n.points or ""), inside, state) if part),
              "Points that count, those that do not, and how far measuring is.")  # fmt: skip

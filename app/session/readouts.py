"""Read-outs as tables: light at probes, at pins and on calculation surfaces, as text and as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from app.rest.calculation_surface import AT_MOST, SurfaceLight
from app.rest.surface_grid import Level, points_of
from gi_core.gather.origins import GROUPS, Origins, Share
from gi_core.lights.power import Power
from gi_core.scene.types import CYLINDRICAL, DAYLIGHT_FACTOR, ILLUMINANCE, UGR, CalculationSurface, Units

LEFT_OUT = "inside objects or outside the room"
LONG_NAMES = {
    "mean": "mean", "minimum": "minimum", "maximum": "maximum", "U0": "uniformity U0", "Ud": "diversity Ud"
}  # fmt: skip
MEANINGS = {"U0": "minimum / mean (EN 12665)", "Ud": "minimum / maximum"}
COLUMNS = ("kind", "name", "x [m]", "y [m]", "z [m]")


class Row(NamedTuple):
    """Light at one point of a surface; nan where unknown."""

    kind: str  # "probe" or "pin"
    name: str
    position: tuple[float, float, float]  # [m]
    irradiance: float  # luminance of RGB [W/m2], or [lx]
    error: float = math.nan  # standard error
    radiance: float = math.nan  # [W/m2/sr], or [cd/m2]
    object: str = ""
    material: str = ""


def csv_text(rows: Sequence[Row], lights: Sequence[SurfaceLight], units: Units) -> str:
    """Return all read-outs as CSV with one header: points, then numbers and points of each surface."""
    out = io.StringIO()
    write = csv.writer(out, lineterminator="\n").writerow
    per_area, per_solid_angle = (u.replace("²", "2") for u in (units.per_area, units.per_solid_angle))
    surface, seen = units.on_surface.lower(), units.from_surface
    write((*COLUMNS, f"{surface} [{per_area}]", f"standard error [{per_area}]",
           f"{seen} [{per_solid_angle}]", "object", "material", "target"))  # fmt: skip
    for r in rows:
        numbers = *map(_place, r.position), *map(_number, (r.irradiance, r.error, r.radiance))
        write((r.kind, _cell(r.name), *numbers, _cell(r.object), _cell(r.material), ""))
    for light in lights:
        name, none, verdicts = _cell(light.surface.name), ("",) * 3, light.verdicts
        for number, value, error, _ in light.rows():
            judged = f"{dict(light.surface.targets)[number]:g}: {verdicts[number]}" if number in verdicts else ""
            of, unit = light.surface.quantity, unit_of(light.surface, units)
            kind = "surface" if of == ILLUMINANCE else f"{of} [{unit}]" if unit else of
            write((kind, number, *none, _number(value), _number(error), "", name, "", judged))
        for k, (position, E, error) in enumerate(zip(light.grid.positions, light.values, light.errors, strict=True)):
            a, b = divmod(k, light.grid.shape[1])
            place = f"{a + 1} {b + 1}", *map(_place, position)
            write(("surface point", *place, _number(E), _number(error), "", name, "", ""))
    return out.getvalue()


def text_lines(
    rows: Sequence[Row], lights: Sequence[SurfaceLight], level: Level, units: Units, power: Power | None = None
) -> list[str]:
    """Return all read-outs as lines of text."""
    lines = []
    for light in lights:
        unit = unit_of(light.surface, units)
        lines += [f"{light.surface.name:18} {described(light, level)}"]
        for name, value, error, has_unit in light.rows():
            text = f"{LONG_NAMES[name]:18} {shown(value, error, unit if has_unit else '')}"
            about = MEANINGS.get(name, "")
            lines.append(f"{text}   {about}".rstrip() + judged(light, name, units))
        if power is not None and (text := per_100_lux(power, light, units)):
            lines.append(f"{'power':18} {text}")
        lines += ["", *_map(light, level, units)]
    if power is not None and power.of_lamp:
        lines += [f"{'power':18} {power.text()}", ""]
    for r in rows:
        lines.append(f'{r.kind} "{r.name}"'.ljust(30) + f" {shown(r.irradiance, r.error, units.per_area)}")
    return lines


def share_lines(row: Row, origins: Origins, units: Units) -> list[str]:
    """Return the light at a point by its origins, as lines of text."""
    lines = ["", f'{row.kind} "{row.name}"'.ljust(30) + f" {shown(*origins.total, units.per_area)}"]
    for group in GROUPS if origins.total[0] > 0 else ():
        lines += [f"   by {group}", *(f"      {s.name:30} {percent(s)}" for s in origins.shares(group, 12))]
    return lines


def percent(share: Share) -> str:
    """Return a share with its standard error."""
    return f"{100 * share.share:.1f} ± {100 * share.error:.1f} %"


def per_100_lux(power: Power, light: SurfaceLight, units: Units) -> str:
    """Return the power per area and 100 lx of a surface, with its standard error; "" where it has no meaning.

    Lamps of unknown watts bring light without power.
    """
    mean, error = light.numbers.mean
    lux = light.surface.quantity == ILLUMINANCE and units.per_area == "lx"
    if not power.of_lamp or power.unknown or not lux or not mean > 0:
        return ""
    value = power.per_area / (mean / 100)
    return f"{shown(value, value * error / mean, 'W/m²')} per 100 lx"


def unit_of(surface: CalculationSurface, units: Units) -> str:
    """Return the unit of the values of a surface."""
    lit = units.per_area
    return {ILLUMINANCE: lit, CYLINDRICAL: lit, DAYLIGHT_FACTOR: "%", UGR: ""}[surface.quantity]


def described(light: SurfaceLight, level: Level) -> str:
    """Return size, place, points and views of a surface."""
    s, (a, b), left_out = light.surface, light.grid.shape, light.numbers.left_out
    width, depth = light.grid.size.tolist()
    height = float(light.grid.corners.mean(axis=0) @ level.axes.up) - level.low[2]
    place = f"on {s.on}" if s.on else f"{height:.4g} m above the floor"
    text = f"{width:.4g} x {depth:.4g} m, {place}, {a} x {b} points" + f", the worst of {s.views} views" * (s.views > 1)
    text += f", {left_out} of them {LEFT_OUT}" if left_out else ""
    note = "" if s.points else points_of((width, depth))[1]
    return f"{text}; {note}" if note else text


def judged(light: SurfaceLight, number: str, units: Units) -> str:
    """Return the target of a number of a surface and whether it holds, "" without one."""
    targets = dict(light.surface.targets)
    if number not in targets:
        return ""
    unit = "" if number in ("U0", "Ud") else f" {unit_of(light.surface, units)}".rstrip()
    bound = "at most" if number in AT_MOST else "at least"
    return f"   {bound} {targets[number]:g}{unit}: {light.verdicts[number]}"


def _map(light: SurfaceLight, level: Level, units: Units) -> list[str]:
    """Return the points of a surface as a table, one line per place along its second side."""
    (a, b), axes, sides = light.grid.shape, level.axes, light.grid.sides
    names, middle = ("side 1", "side 2"), light.grid.corners.mean(axis=0)
    if np.allclose(sides[:2], axes[:2], atol=1e-9):
        names, middle = axes.names, np.zeros(3)
    along = [(light.grid.positions - middle) @ side for side in sides[:2]]
    columns, rows = along[0].reshape(a, b)[:, 0], along[1].reshape(a, b)[0]
    head = f"{names[1]} \\ {names[0]} [m]"
    cells = ["-" if math.isnan(v) else _rounded(v, e) for v, e in zip(light.values, light.errors, strict=True)]
    places = [f"{c:.2f}" for c in columns]
    width = max(9, 2 + max(map(len, [*cells, *places])))
    unit, of = unit_of(light.surface, units), light.surface.quantity
    quantity = units.on_surface if of == ILLUMINANCE else of[0].upper() + of[1:]
    out = [f"{quantity} [{unit}]" if unit else quantity, head.rjust(11) + "".join(c.rjust(width) for c in places)]
    for k, place in enumerate(rows):
        out.append(f"{place:11.2f}" + "".join(cell.rjust(width) for cell in cells[k::b]))
    return [*out, ""]


def shown(value: float, error: float, unit: str = "") -> str:
    """Return a value with its standard error, to two digits of that."""
    if math.isnan(value):
        return "unknown"
    text = _rounded(value, error)
    if error > 0:
        text += f" ± {error:.{_digits(error)}f}"
    return f"{text} {unit}".rstrip()


def _rounded(value: float, error: float) -> str:
    """Return a value, rounded to two digits of its standard error, or to four digits where it has none."""
    if error > 0:
        return f"{value:.{_digits(error)}f}"
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def _digits(error: float) -> int:
    return min(max(1 - math.floor(math.log10(error)), 0), 9)


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.7g}"


def _place(coordinate: float) -> str:
    return f"{coordinate:.12g}"  # micrometres at survey coordinates


def _cell(text: str) -> str:
    """Return text that no spreadsheet takes for a formula."""
    return "'" + text if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def free_name(taken: Iterable[str], kind: str = "pin") -> str:
    """Return the first free name of a kind: "pin 1"."""
    used, k = set(taken), 1
    while f"{kind} {k}" in used:
        k += 1
    return f"{kind} {k}"

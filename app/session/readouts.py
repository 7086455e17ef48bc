"""Read-outs as tables: light at probes, at pins and on the measuring plane, as text and as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from app.draw.units import Units
    from app.rest.measuring_plane import Level, PlaneLight

LEFT_OUT = "inside objects or outside the room"
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


def csv_text(rows: Sequence[Row], light: PlaneLight | None, units: Units) -> str:
    """Return all read-outs as CSV with one header: points of surfaces, numbers of the plane, points of the plane."""
    out = io.StringIO()
    write = csv.writer(out, lineterminator="\n").writerow
    per_area, per_solid_angle = (u.replace("²", "2") for u in (units.per_area, units.per_solid_angle))
    surface, seen = units.on_surface.lower(), units.from_surface
    write((*COLUMNS, f"{surface} [{per_area}]", f"standard error [{per_area}]",
           f"{seen} [{per_solid_angle}]", "object", "material"))  # fmt: skip
    for r in rows:
        numbers = *map(_place, r.position), *map(_number, (r.irradiance, r.error, r.radiance))
        write((r.kind, _cell(r.name), *numbers, _cell(r.object), _cell(r.material)))
    if light is None:
        return out.getvalue()
    n, none = light.numbers, ("",) * 3
    for name, value, error in (
        ("mean", n.mean, n.mean_error), ("minimum", n.least, n.least_error), ("maximum", n.most, n.most_error),
        ("uniformity U0 = minimum / mean", n.U0, n.U0_error), ("diversity Ud = minimum / maximum", n.Ud, n.Ud_error),
    ):  # fmt: skip
        write(("measuring plane", name, *none, _number(value), _number(error), *none))
    for k, (position, value, error) in enumerate(zip(light.grid.positions, light.values, light.errors, strict=True)):
        a, b = divmod(k, light.grid.shape[1])
        write(("plane point", f"{a + 1} {b + 1}", *map(_place, position), _number(value), _number(error), *none))
    return out.getvalue()


def text_lines(rows: Sequence[Row], light: PlaneLight | None, level: Level, units: Units) -> list[str]:
    """Return all read-outs as lines of text."""
    from app.rest.measuring_plane import points_of

    lines = []
    if light is not None:
        n, (a, b), unit = light.numbers, light.grid.shape, units.per_area
        width, depth = np.abs(np.subtract(light.plane.high, light.plane.low)).tolist()
        lines += [
            f"measuring plane    {width:.4g} x {depth:.4g} m, {light.plane.height:.4g} m above the floor, "
            f"{a} x {b} points" + (f", {n.left_out} of them {LEFT_OUT}" if n.left_out else ""),
            *(
                [f"                   {note}"]
                if (note := "" if light.plane.points else points_of(light.plane)[1])
                else []
            ),
            f"mean               {shown(n.mean, n.mean_error, unit)}",
            f"minimum            {shown(n.least, n.least_error, unit)}",
            f"maximum            {shown(n.most, n.most_error, unit)}",
            f"uniformity U0      {shown(n.U0, n.U0_error)}   minimum / mean (EN 12665)",
            f"diversity Ud       {shown(n.Ud, n.Ud_error)}   minimum / maximum",
            "",
            *_map(light, level, units),
        ]
    for r in rows:
        lines.append(f'{r.kind} "{r.name}"'.ljust(30) + f" {shown(r.irradiance, r.error, units.per_area)}")
    return lines


def _map(light: PlaneLight, level: Level, units: Units) -> list[str]:
    """Return the points of a plane as a table, one line per place along the second axis."""
    (a, b), axes = light.grid.shape, level.axes
    along = [light.grid.positions @ axis for axis in (axes.across, axes.along)]
    columns, rows = along[0].reshape(a, b)[:, 0], along[1].reshape(a, b)[0]
    head = f"{axes.names[1]} \\ {axes.names[0]} [m]"
    cells = ["-" if math.isnan(v) else _rounded(v, e) for v, e in zip(light.values, light.errors, strict=True)]
    places = [f"{c:.2f}" for c in columns]
    width = max(9, 2 + max(map(len, [*cells, *places])))
    out = [f"{units.on_surface} [{units.per_area}]", head.rjust(11) + "".join(c.rjust(width) for c in places)]
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
    """Return a value to two digits of its standard error, without one to four digits."""
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

"""A report of a scene: luminaires, surfaces with targets, pictures, power and settings, as one page of HTML or as JSON.

The page needs no other file and prints on A4. Equal inputs give equal bytes: nothing in it depends on time or machine.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from app.cli.saved_scene import command_line
from app.draw.colour_map import sequential_colours
from app.rest.calculation_surface import FAIL, PASS, SurfaceLight
from app.rest.surface_grid import Level
from app.session.readouts import LONG_NAMES, described, judged, per_100_lux, shown, unit_of
from app.settings import Settings
from gi_core.geometry.error import luminance
from gi_core.lights.daylight import sun_of
from gi_core.lights.photometric import flux_of
from gi_core.lights.power import Power, full_watts
from gi_core.model import Model
from gi_core.scene.types import UNITS, PhotometricLight, PlacedLight, SkyLight

STYLE = """
body { font: 10.5pt/1.4 system-ui, sans-serif; color: #1b1d21; max-width: 190mm; margin: 10mm auto; }
h1 { font-size: 20pt; margin: 0; } h2 { font-size: 13pt; margin: 8mm 0 2mm; border-bottom: 0.3mm solid #888; }
h3 { font-size: 11pt; margin: 5mm 0 1mm; } p { margin: 1mm 0; } .dim { color: #666; }
table { border-collapse: collapse; margin: 2mm 0; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 0.6mm 3mm 0.6mm 0; border-bottom: 0.1mm solid #ccc; vertical-align: top; }
th { font-weight: 600; } .pass { color: #176b2c; } .fail { color: #b3261e; } .uncertain { color: #8a5a00; }
img { max-width: 100%; max-height: 95mm; } figure { margin: 2mm 0; } svg text { font: 9px system-ui, sans-serif; }
section, figure, tr, .lamp { break-inside: avoid; } .lamps { display: flex; flex-wrap: wrap; gap: 5mm; }
h2, h3, .lamps { break-after: avoid; }
@page { size: A4; margin: 12mm; } @media print { body { margin: 0; } }
"""
LIMITS = (
    "Numbers are path traced and have one standard error; equal inputs give equal bits. A target passes or fails where "
    "that is certain by two standard errors. The calculation knows no spectra, no dirt or ageing beyond the "
    "maintenance factor, and no flicker. Light of points and spots counts as background of UGR. It certifies nothing. "
    "Norms, whose texts were not at hand: EN 12464-1 (grid), EN 12665 (uniformity), CIE 117 (UGR), ISO 15469 (skies)."
)


class Content(NamedTuple):
    """Contents of a report."""

    model: Model
    settings: Settings
    levels: np.ndarray  # (G, 3) of the lamps
    level: Level
    lights: Sequence[SurfaceLight]
    power: Power
    pictures: Sequence[tuple[str, bytes]]  # caption, PNG file
    version: str
    error: float  # relative noise that was asked for


def page(c: Content) -> str:
    """Return the report as HTML."""
    scene = c.model.scene
    parts = [
        f"<h1>{escape(scene.name)}</h1><p class='dim'>Lighting report by gi-viewer {escape(c.version)}</p>",
        _targets(c),
        *(f"<figure><img src='data:image/png;base64,{base64.b64encode(data).decode()}' alt=''>"
          f"<figcaption class='dim'>{escape(caption)}</figcaption></figure>" for caption, data in c.pictures),
        "<h2>Calculation surfaces</h2>",
        *(_surface(c, light) for light in c.lights),
        *([] if c.lights else ["<p>None.</p>"]),
        f"<h2>Luminaires and lamps</h2>{_lamps(c)}{_polar_curves(c)}",
        f"<h2>Power</h2><p>{escape(c.power.text()) if c.power.of_lamp else 'No lamp has watts.'}</p>",
        f"<h2>Materials</h2>{_materials(c)}",
        f"<h2>Settings</h2>{_table(['', ''], _settings(c))}<p class='dim'>{LIMITS}</p>",
    ]  # fmt: skip
    head = f"<meta charset='utf-8'><title>{escape(scene.name)}: lighting report</title><style>{STYLE}</style>"
    return f"<!doctype html>\n<html lang='en'><head>{head}</head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"


def numbers(c: Content) -> str:
    """Return the report as JSON: numbers are [value, standard error]."""
    scene = c.model.scene
    surfaces = [
        {
            "name": light.surface.name, "quantity": light.surface.quantity, "unit": unit_of(light.surface, _units(c)),
            **{name: [_finite(value), _finite(error)] for name, value, error, _ in light.rows()},
            "targets": {name: [target, light.verdicts[name]] for name, target in light.surface.targets},
            "points": [[*map(float, at), _finite(E), _finite(error)] for at, E, error in
                       zip(light.grid.positions, light.values, light.errors, strict=True)],
        }
        for light in c.lights
    ]  # fmt: skip
    power = {"watts": c.power.of_lamp, "floor_m2": c.power.area, "unknown": list(c.power.unknown)}
    lamps = [dict(zip(("name", "flux", "level", "watts"), row, strict=True)) for row in _lamp_rows(c)]
    document = {"scene": scene.name, "surfaces": surfaces, "lamps": lamps, "power": power, "settings": _settings(c)}
    return json.dumps(document, indent=1) + "\n"


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _units(c: Content):
    return UNITS[c.model.scene.units]


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a table of texts, or of marked-up cells, which begin with <."""

    def cells(row, tag: str) -> str:
        texts = (text if (text := str(cell)).startswith("<") else escape(text) for cell in row)
        return f"<tr>{''.join(f'<{tag}>{text}</{tag}>' for text in texts)}</tr>"

    top = f"<thead>{cells(head, 'th')}</thead>" if any(head) else ""
    return f"<table>{top}<tbody>{''.join(cells(row, 'td') for row in rows)}</tbody></table>"


def _mark(verdict: str) -> str:
    kind = {PASS: "pass", FAIL: "fail"}.get(verdict, "uncertain")
    return f"<b class='{kind}'>{verdict}</b>"


# Surfaces ---------------------------------------------------------------------------------------------


def _targets(c: Content) -> str:
    """Return all targets, with the measured numbers."""
    rows = []
    for light in c.lights:
        of = {name: (value, error, has_unit) for name, value, error, has_unit in light.rows()}
        for name, verdict in light.verdicts.items():
            value, error, has_unit = of[name]
            asked = judged(light, name, _units(c)).strip().rpartition(":")[0]
            measured = shown(value, error, unit_of(light.surface, _units(c)) if has_unit else "")
            rows.append((light.surface.name, LONG_NAMES[name], asked, measured, _mark(verdict)))
    return "<h2>Targets</h2>" + _table(("surface", "number", "target", "measured", ""), rows) if rows else ""


def _surface(c: Content, light: SurfaceLight) -> str:
    """Return numbers and plan of a surface."""
    unit = unit_of(light.surface, _units(c))
    rows = []
    for name, value, error, has_unit in light.rows():
        asked = judged(light, name, _units(c)).strip().rpartition(": ")[0]
        mark = _mark(light.verdicts[name]) if name in light.verdicts else ""
        rows.append((LONG_NAMES[name], shown(value, error, unit if has_unit else ""), asked, mark))
    if text := per_100_lux(c.power, light, _units(c)):
        rows.append(("power", text, "", ""))
    of = light.surface.quantity
    about = f"{of[0].upper() + of[1:]}, {described(light, c.level)}."
    if light.fraction < 1:
        about += f" Measured to {100 * light.fraction:.0f} % only."
    head = f"<h3>{escape(light.surface.name)}</h3><p class='dim'>{escape(about)}</p>"
    return f"<section>{head}{_table([''], rows)}{_plan(light, unit)}</section>"


def _plan(light: SurfaceLight, unit: str) -> str:
    """Return the points of a surface as coloured cells with their values, as SVG; the first side goes right."""
    (a, b), (width, depth) = light.grid.shape, light.grid.size.tolist()
    scale = min(640 / width, 420 / depth, 80 * a / width)
    w, h = scale * width / a, scale * depth / b
    most = float(np.nanmax(light.values, initial=0.0))
    cells = []
    for k, value in enumerate(light.values.tolist()):
        x, y = w * (k // b), h * (b - 1 - k % b)
        rgb = sequential_colours(np.array([value / max(most, 1e-300)]))[0] if math.isfinite(value) else np.full(3, 0.93)
        fill = ",".join(f"{255 * float(v):.0f}" for v in rgb)
        cells.append(f"<rect x='{x:.1f}' y='{y:.1f}' width='{w:.1f}' height='{h:.1f}' fill='rgb({fill})'/>")
        if math.isfinite(value) and w > 24 and h > 10:
            text = f"{value:.0f}" if value >= 100 else f"{value:.3g}"
            at = f"x='{x + w / 2:.1f}' y='{y + h / 2 + 3:.1f}' text-anchor='middle'"
            cells.append(f"<text {at} fill='{'#fff' if luminance(np.asarray(rgb)) < 0.4 else '#000'}'>{text}</text>")
    values = f"; values in {escape(unit)}" if unit else ""
    return (
        f"<svg viewBox='0 0 {scale * width:.0f} {scale * depth:.0f}' width='{scale * width:.0f}'>{''.join(cells)}</svg>"
        f"<p class='dim'>{width:.4g} m across, {depth:.4g} m up the page{values}.</p>"
    )


# Lamps ------------------------------------------------------------------------------------------------


def _lamp_rows(c: Content) -> list[tuple[str, float, float, float | None]]:
    """Return name, flux at level 1, level and watts at that level of each lamp."""
    e = c.model.emitters
    flux, out = luminance(e.flux_of_lamps), []
    now = luminance(e.flux_of_lamps * c.levels)
    for g, name in enumerate(e.lamps.names):
        level = float(now[g] / flux[g]) if flux[g] > 0 else 0.0
        out.append((name, float(flux[g]), level, c.power.of_lamp.get(name)))
    return out


def _lamps(c: Content) -> str:
    unit, rows = _units(c).flux, []
    lights = c.model.scene.lights
    skies = {light.name: f"sky, type {light.cie} of ISO 15469" for light in lights if isinstance(light, SkyLight)}
    placed = (light for light in lights if isinstance(light, PlacedLight))
    places = {light.name: " ".join(f"{x:.4g}" for x in light.position) for light in placed}
    for name, flux, level, watts in _lamp_rows(c):
        efficacy = f"{flux * level / watts:.3g} {unit}/W" if watts else ""
        now = "" if watts is None else f"{watts:.4g} W"
        sent = skies.get(name, f"{flux:.4g} {unit}")
        rows.append((name, places.get(name, ""), sent, f"{100 * level:.4g} %", now, efficacy))
    return _table(("lamp", "at [m]", "flux at 100 %", "level", "power now", ""), rows)


def _polar_curves(c: Content) -> str:
    """Return the intensity of each kind of luminaire, in the planes C0 and C90."""
    kinds: dict[int, list[PhotometricLight]] = {}
    for light in c.model.scene.lights:
        if isinstance(light, PhotometricLight):
            kinds.setdefault(id(light.intensity), []).append(light)
    drawn = [f"<figure class='lamp'>{_polar(of[0])}<figcaption>{escape(_names(of))}</figcaption></figure>"
             for of in kinds.values()]  # fmt: skip
    key = "<p class='dim'>Intensity in C0 and C180 (line), C90 and C270 (dashed); straight down is down.</p>"
    return f"<div class='lamps'>{''.join(drawn)}</div>{key}" if drawn else ""


def _names(lights: Sequence[PhotometricLight]) -> str:
    names = list(dict.fromkeys(light.name for light in lights))
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _polar(light: PhotometricLight) -> str:
    """Return a polar diagram as SVG: C0 to C180 in full line, C90 to C270 dashed, gamma 0 downwards."""
    radius, most = 80.0, float(light.intensity.max())
    scale = luminance(np.array(light.flux)) / flux_of(light.gammas_degrees, light.planes_degrees, light.intensity)
    lines = [f"<circle cx='100' cy='100' r='{radius * k / 4:.0f}' fill='none' stroke='#ccc'/>" for k in range(1, 5)]
    lines += [f"<line x1='100' y1='100' x2='{100 + radius * math.sin(t):.1f}' y2='{100 + radius * math.cos(t):.1f}' "
              "stroke='#ddd'/>" for t in np.radians(np.arange(0, 360, 30))]  # fmt: skip
    for plane, dash in ((0.0, ""), (90.0, " stroke-dasharray='4 3'")):
        points: list[list[float]] = []
        for side, sign in ((plane + 180.0, -1), (plane, 1)):
            values = np.array([np.interp(side, light.planes_degrees, column) for column in light.intensity.T])
            g, r = np.radians(light.gammas_degrees), radius * values / most
            arm = np.stack([100 + sign * r * np.sin(g), 100 + r * np.cos(g)], axis=1).tolist()
            points += arm[::-1] if sign < 0 else arm
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        lines.append(f"<polyline points='{path}' fill='none' stroke='#b3541e' stroke-width='1.5'{dash}/>")
    top = f"<text x='102' y='{100 + radius + 12:.0f}'>{most * scale:.4g} cd</text>"
    return f"<svg viewBox='0 0 200 200' width='200'>{''.join(lines)}{top}</svg>"


# The rest ---------------------------------------------------------------------------------------------


def _materials(c: Content) -> str:
    """Return the reflectance of each material, of textures the mean by area."""
    scene, s = c.model.scene, c.model.surfaces
    meshes, own = (scene.static, *(m.mesh for m in scene.mobiles)), np.array([m.reflectance for m in scene.materials])
    of = np.concatenate([mesh.face_material for mesh in meshes])
    of_faces = (own[mesh.face_material] if mean is None else mean for mesh, mean in zip(meshes, s.means, strict=True))
    rho, rows = luminance(np.concatenate([*of_faces])), []
    for k in np.unique(of):
        m, faces = scene.materials[k], of == k
        kinds = {"pane": m.pane, "lamp": max(m.emission) > 0, "model": m.brdf, "gloss": m.gloss}
        kind = next((kind for kind, fits in kinds.items() if fits), "")
        rows.append((m.name, f"{np.average(rho[faces], weights=s.areas[faces]):.2f}", kind))
    return _table(("material", "reflectance", ""), rows)


def _settings(c: Content) -> list[tuple[str, str]]:
    """Return the inputs of a second run: files with their hashes, command with poses and levels, seed, errors."""
    scene, s = c.model.scene, c.settings
    watts = full_watts(scene, s.watts)
    named = replace(s, scene=Path(s.scene).name, mobiles=tuple(Path(file).name for file in s.mobiles))
    edits = f", and {len(s.edits)} edits that a saved scene keeps" if s.edits else ""
    rows = [("scene", named.scene), ("program", f"gi-viewer {c.version}"), ("seed", str(s.seed)),
            ("command", command_line(named) + edits),
            ("relative noise asked for", f"{100 * c.error:g} %"),
            ("maintenance factor", f"{s.maintenance_factor or scene.maintenance_factor:g}"),
            ("watts at 100 %", ", ".join(f"{name} {w:g} W" for name, w in watts.items()) or "none")]  # fmt: skip
    if (day := scene.daylight) is not None:
        when = f"{day.place[0]:g}, {day.place[1]:g}, {day.date} {day.hour:g} h, UTC{day.utc_offset:+g}"
        rows.append(("daylight", f"{when}; sun {sun_of(day)}; sky type {day.sky}, turbidity {day.turbidity:g}"))
    for name in dict.fromkeys(name for files in scene.files for name in files):
        if Path(name).is_file():
            rows.append((f"SHA-256 of {Path(name).name}", hashlib.sha256(Path(name).read_bytes()).hexdigest()))
    rows += [("note", note) for note in scene.notes]
    return rows

"""Lights of an open scene, as its edits leave them, those still being prepared too.

Directions of lights are angles in the panel. New lights fit the room.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from app.settings import Settings
from gi_core.base.vectors import frame_of, unit
from gi_core.files import edits
from gi_core.files.edits import Edit, Values
from gi_core.geometry.error import luminance
from gi_core.lights.daylight import LUMENS_PER_WATT
from gi_core.lights.emission import Emitters
from gi_core.lights.photometric import axes
from gi_core.lights.spot import solid_angle
from gi_core.scene.pose import axis_angle, least_turn, rotation, three
from gi_core.scene.types import Daylight, DirectionalLight, Light, PhotometricLight, PointLight, Pose, Scene, SpotLight


class LightId(NamedTuple):
    """A light: several may share a name, and are one lamp then."""

    name: str
    number: int = 1  # among the lights of its name, from 1


def words_for(lamp: str) -> str:
    """Return the name of a lamp, as a sentence has it."""
    return lamp if "lamp" in lamp.lower() else f"lamp {lamp}"


def numbered(lights: Iterable[Light]) -> dict[LightId, Light]:
    """Return lights by name and number."""
    count: dict[str, int] = {}
    by_id = {}
    for light in lights:
        count[light.name] = count.get(light.name, 0) + 1
        by_id[LightId(light.name, count[light.name])] = light
    return by_id


def lights_after(scene: Scene, pending: Iterable[Edit]) -> dict[LightId, Light]:
    """Return the lights of a scene, changed by edits that are still being prepared."""
    by_id = numbered(scene.lights)
    for edit in pending:
        if isinstance(edit, edits.Light) and not edit.of:
            light = by_id.get(LightId(edit.name, edit.number))
            if light is not None:
                values = {key: value for key, value in edit.light if key in light._fields}
                by_id[LightId(edit.name, edit.number)] = light._replace(**values)
    return by_id


# Direction ------------------------------------------------------------------------------------------


Directed = SpotLight | PhotometricLight | DirectionalLight  # lights that have a direction


def aim_of(light: Directed, up, near: float = 0.0) -> tuple[float, float, float]:
    """Return tilt, heading and turn [degrees] of a light.

    Tilt is the angle from straight down, heading that about the vertical from east (`frame_of`), `near` where the tilt
    is 0. Turn is that of C0 about the axis, 0 for a light without.
    """
    d, (east, north, up) = unit(light.direction), frame_of(up)
    down = -float(d @ up)
    tilt = math.degrees(math.atan2(float(np.linalg.norm(np.cross(d, up))), down))
    level = math.hypot(d @ east, d @ north)
    heading = math.degrees(math.atan2(d @ north, d @ east)) if level > 1e-6 else near
    if not isinstance(light, PhotometricLight):
        return tilt, heading, 0.0
    _, c0 = axes(light)
    ahead = least_turn(-up, d) @ east  # as straight down turns into the direction
    return tilt, heading, math.degrees(math.atan2(float(np.cross(ahead, c0) @ d), float(ahead @ c0)))


def aimed(light: Directed, tilt: float, heading: float, turn: float, up) -> Values:
    """Return values of a light with other angles, as of aim_of()."""
    east, north, up = frame_of(up)
    t, h = math.radians(min(max(tilt, 0.0), 180.0)), math.radians(heading)
    d = math.sin(t) * (math.cos(h) * east + math.sin(h) * north) - math.cos(t) * up
    if not isinstance(light, PhotometricLight):
        return (("direction", rounded(d)),)
    ahead = least_turn(-up, d) @ east  # as straight down turns into the direction
    c0 = rotation(Pose(quaternion=axis_angle(d, turn))) @ ahead
    return (("direction", rounded(d)), ("c0", rounded(c0)))


def towards(light: Directed, direction: np.ndarray) -> Values:
    """Return values of a light that shines along a direction (3,); a luminaire turns as little as it can."""
    new = unit(direction)
    if not isinstance(light, PhotometricLight):
        return (("direction", rounded(new)),)
    c0 = least_turn(unit(light.direction), new) @ unit(light.c0)
    return (("direction", rounded(new)), ("c0", rounded(c0)))


def turned(light: Light, R: np.ndarray) -> Values:
    """Return values of a light turned by a rotation (3, 3) about its place."""
    if not isinstance(light, Directed):
        return ()
    keys = ("direction", "c0") if isinstance(light, PhotometricLight) else ("direction",)
    return tuple((key, rounded(R @ unit(getattr(light, key)))) for key in keys)


def beam(light: SpotLight, inner: float, outer: float) -> Values:
    """Return values of a spot with another cone and the same flux."""
    outer = min(max(outer, 0.1), 90.0)  # degrees from the axis of a spot
    inner = min(max(inner, 0.0), outer)

    def solid(a: float, b: float) -> float:
        return solid_angle(math.cos(math.radians(a)), math.cos(math.radians(b)))

    factor = solid(light.inner_degrees, light.outer_degrees) / solid(inner, outer)
    return (
        ("inner_degrees", inner),
        ("outer_degrees", outer),
        ("intensity", three(c * factor for c in light.intensity)),
    )


def rounded(v: np.ndarray) -> tuple[float, float, float]:
    return three(round(float(x), 9) + 0.0 for x in v)


def north_angle(daylight: Daylight, up) -> float:
    """Return the direction of north [degrees], clockwise from above from the second axis of `frame_of`; -180 to 180."""
    east, north, _ = frame_of(up)
    at = north if daylight.north is None else np.array(daylight.north)
    return round(math.degrees(math.atan2(at @ east, at @ north)), 6) + 0.0


def north_at(degrees: float, up) -> tuple[float, float, float]:
    """Return the direction of north (3,) at an angle of north_angle()."""
    east, north, _ = frame_of(up)
    a = math.radians(degrees)
    return rounded(math.cos(a) * north + math.sin(a) * east)


BULB, SPOT, PANEL, SUN, SKY = "bulb", "spot", "panel", "sun", "overcast sky"
DAYLIGHT = "sun and sky"
NEW_DAYLIGHT = Daylight((51.5083, -0.1253), "2026-03-21", 12.0, 0.0, sky=12)  # London, clear
LUMENS = {BULB: 800.0, SPOT: 500.0, PANEL: 3600.0}  # of common LED lamps
CONE = 15.0, 30.0  # degrees from the axis of a new spot
DROP = {BULB: 0.15, SPOT: 0.02, PANEL: 0.01}  # of that height, below the ceiling
OPEN_HEIGHT = 0.4  # of the scene's size: height of a new lamp without a ceiling


class Room(NamedTuple):
    """Place and scale of a new light."""

    point: np.ndarray  # (3,) [m] on a surface, above which it hangs
    height: float  # [m] of the ceiling above that point; inf without one
    up: np.ndarray  # (3,) unit
    size: float  # of the scene [m]
    photometric: bool
    flux: float  # mean of the other lamps, luminance


def new_light(kind: str, room: Room) -> Values:
    """Return the values of a new light: BULB, SPOT, PANEL, SUN or SKY."""
    sunlight, skylight = 50_000.0, 10_000.0  # [lx] on a facing plane, and under an overcast sky
    east, north, up = frame_of(room.up)
    down = rounded(-up)
    if kind == SUN:
        a, b = 0.5, 0.6  # towards east and north per length downwards
        E = sunlight if room.photometric else sunlight / LUMENS_PER_WATT
        return (("type", "directional"), ("direction", rounded(a * east + b * north - up)), ("irradiance", (E,) * 3))
    if kind == SKY:
        L = skylight / math.pi if room.photometric else skylight / math.pi / LUMENS_PER_WATT
        return (("type", "sky"), ("radiance", (_digits(L),) * 3))
    at = ("position", hung(room, DROP[kind]))
    flux = LUMENS[kind] if room.photometric else _digits(room.flux)
    if kind == BULB:
        return (("type", "point"), at, ("flux", (flux,) * 3))
    if kind == SPOT:
        inner, outer = CONE
        solid = solid_angle(math.cos(math.radians(inner)), math.cos(math.radians(outer)))
        cone = ("inner_degrees", inner), ("outer_degrees", outer)
        return (("type", "spot"), at, ("direction", down), ("intensity", (_digits(flux / solid),) * 3), *cone)
    # 0.22 of the height of the room
    side = _digits(0.22 * (room.height if math.isfinite(room.height) else OPEN_HEIGHT * room.size))
    return (("type", "panel"), at, ("direction", down), ("c0", rounded(east)), ("flux", (flux,) * 3),
            ("size", (side, side)))  # fmt: skip


def hung(room: Room, drop: float) -> tuple[float, float, float]:
    """Return a place below the ceiling by a share of the room's height, or above the ground in the open."""
    height = room.height * (1 - drop) if math.isfinite(room.height) else OPEN_HEIGHT * room.size
    return three(round(float(x), 6) for x in room.point + height * room.up)


def photometric(values: Mapping[str, Any], room: Room) -> Values:
    """Return the values of a light by a photometric file, with those given; the file gives lumens if units do."""
    east, _, up = frame_of(room.up)
    whole: dict[str, Any] = {"type": "photometric", "position": hung(room, DROP[PANEL]), "direction": rounded(-up)}
    whole |= {"c0": rounded(east)} | ({} if room.photometric else {"flux": (_digits(room.flux),) * 3})
    return tuple((whole | dict(values)).items())


def in_place_of(light: Light, photometric_units: bool) -> dict[str, Any]:
    """Return the values that a photometric file put in place of a light takes over; the file gives the size."""
    kept = {key: getattr(light, key) for key in ("position", "direction", "c0") if key in light._fields}
    if not photometric_units and isinstance(light, PointLight | PhotometricLight):
        kept["flux"] = light.flux
    return kept


def panel_of_faces(scene: Scene, name: str, size: float) -> Values | None:
    """Return the values of a panel in place of the emissive faces of a material; None where these face all ways.

    It has their middle, flux, mean normal, and the extent of their corners across it. size: of the scene [m].
    """
    mesh = scene.static
    glows = np.array([m.name == name and max(m.emission) > 0 for m in scene.materials], bool)[mesh.face_material]
    corners = mesh.vertices[mesh.faces[glows]]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(cross, axis=1)
    normal = 0.5 * cross.sum(axis=0)
    if not np.linalg.norm(normal) > 0.5 * area.sum() > 0:
        return None
    emission = np.array([m.emission for m in scene.materials])[mesh.face_material[glows]]
    flux = math.pi * (area[:, None] * emission).sum(axis=0)
    n, points, edges = unit(normal), corners.reshape(-1, 3), np.roll(corners, -1, axis=1) - corners
    across, along, low, high = _rectangle(points, edges.reshape(-1, 3), n)
    # a gap of 1e-3 of the scene's size between faces and the panel that replaces them
    middle = (low + high) / 2 @ np.stack([across, along, n]) + n * ((high - low)[2] / 2 + 1e-3 * size)
    return (("type", "panel"), ("position", rounded(middle)), ("direction", rounded(n)), ("c0", rounded(across)),
            ("flux", three(flux)), ("size", (_digits(high[0] - low[0]), _digits(high[1] - low[1]))))  # fmt: skip


def _rectangle(points: np.ndarray, edges: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return two unit vectors (3,) across a normal, and the extent of points along these and the normal, (3,) and (3,).

    One side lies along an edge, so that the area is the least of all such rectangles.
    """
    flat = edges - (edges @ n)[:, None] * n
    flat = flat[np.linalg.norm(flat, axis=1) > 1e-9]
    best, rectangle = math.inf, (unit(flat[0]),) * 4
    for edge in flat[:200]:  # 200 edges are tried as sides of a rectangle
        a = unit(edge)
        b = np.cross(a, n)
        at = points @ np.stack([a, b, n]).T
        low, high = at.min(axis=0), at.max(axis=0)
        if (area := float(np.prod((high - low)[:2]))) < best * (1 - 1e-9):
            best, rectangle = area, (a, b, low, high)
    return rectangle


def _digits(value: float) -> float:
    return float(f"{value:.6g}")


EXPOSURE_STAYS = "the exposure stays as it was: key A meters it"


def flux_of(emitters: Emitters, settings: Settings) -> float:
    """Return the luminance of the flux of all lamps at the levels of settings."""
    names, levels = emitters.lamps.names, settings.levels(emitters.lamps.names)
    lit = [flux * levels[name] for name, flux in zip(names, emitters.flux_of_lamps, strict=True)]
    return float(luminance(sum(lit)))


def changes_exposure(was: float, now: float) -> bool:
    """Return whether light of another flux needs another exposure: two stops more or less."""
    return max(was, now) > 4.0 * min(was, now) > 0

"""New lights: common lamps below the ceiling, photometric files, panels in place of emissive faces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from app.draw.camera import frame_of
from app.session.lights import rounded, unit
from gi_core.scene.pose import three
from gi_core.scene.types import Light, PhotometricLight, PointLight, Scene

if TYPE_CHECKING:
    from gi_core.files.edits import Values

BULB, SPOT, PANEL, SUN, SKY = "bulb", "spot", "panel", "sun", "overcast sky"
NEW = (BULB, SPOT, PANEL, SUN, SKY)
LUMENS = {BULB: 800.0, SPOT: 500.0, PANEL: 3600.0}  # of common LED lamps
CONE = 15.0, 30.0  # degrees from the axis of a new spot
SUNLIGHT, SKYLIGHT = 50_000.0, 10_000.0  # [lx] on a facing plane, and under an overcast sky
SUN_DIRECTION = 0.5, 0.6  # towards east and north per length downwards
SIDE = 0.22  # of a new panel, of the height of the room
DROP = {BULB: 0.15, SPOT: 0.02, PANEL: 0.01}  # of that height, below the ceiling
OPEN_HEIGHT = 0.4  # of the scene's size: height of a new lamp without a ceiling
OFF_FACES = 1e-3  # of the scene's size: gap between faces and the panel that replaces them
LUMENS_PER_WATT = 179.0  # of white light of equal energy
MOST_EDGES = 200  # tried as sides of a rectangle


class Room(NamedTuple):
    """Place and scale of a new light."""

    point: np.ndarray  # (3,) [m] on a surface, above which it hangs
    height: float  # [m] of the ceiling above that point; inf without one
    up: np.ndarray  # (3,) unit
    size: float  # of the scene [m]
    photometric: bool
    flux: float  # mean of the other lamps, luminance


def new_light(kind: str, room: Room) -> Values:
    """Return the values of a new light of a kind of NEW."""
    east, north, up = frame_of(room.up)
    down = rounded(-up)
    if kind == SUN:
        a, b = SUN_DIRECTION
        E = SUNLIGHT if room.photometric else SUNLIGHT / LUMENS_PER_WATT
        return (("type", "directional"), ("direction", rounded(a * east + b * north - up)), ("irradiance", (E,) * 3))
    if kind == SKY:
        L = SKYLIGHT / math.pi if room.photometric else SKYLIGHT / math.pi / LUMENS_PER_WATT
        return (("type", "sky"), ("radiance", (_digits(L),) * 3))
    at = ("position", hung(room, DROP[kind]))
    flux = LUMENS[kind] if room.photometric else _digits(room.flux)
    if kind == BULB:
        return (("type", "point"), at, ("flux", (flux,) * 3))
    if kind == SPOT:
        from gi_core.lights.emission import spot_solid_angle

        inner, outer = CONE
        solid = spot_solid_angle(math.cos(math.radians(inner)), math.cos(math.radians(outer)))
        cone = ("inner_degrees", inner), ("outer_degrees", outer)
        return (("type", "spot"), at, ("direction", down), ("intensity", (_digits(flux / solid),) * 3), *cone)
    side = _digits(SIDE * (room.height if math.isfinite(room.height) else OPEN_HEIGHT * room.size))
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
    middle = (low + high) / 2 @ np.stack([across, along, n]) + n * ((high - low)[2] / 2 + OFF_FACES * size)
    return (("type", "panel"), ("position", rounded(middle)), ("direction", rounded(n)), ("c0", rounded(across)),
            ("flux", three(flux)), ("size", (_digits(high[0] - low[0]), _digits(high[1] - low[1]))))  # fmt: skip


def _rectangle(points: np.ndarray, edges: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return two unit vectors (3,) across a normal, and the extent of points along these and the normal, (3,) and (3,).

    One side lies along an edge, so that the area is the least of all such rectangles.
    """
    flat = edges - (edges @ n)[:, None] * n
    flat = flat[np.linalg.norm(flat, axis=1) > 1e-9]
    best, found = math.inf, (unit(flat[0]),) * 4
    for edge in flat[:MOST_EDGES]:
        a = unit(edge)
        b = np.cross(a, n)
        at = points @ np.stack([a, b, n]).T
        low, high = at.min(axis=0), at.max(axis=0)
        if (area := float(np.prod((high - low)[:2]))) < best * (1 - 1e-9):
            best, found = area, (a, b, low, high)
    return found


def _digits(value: float) -> float:
    return float(f"{value:.6g}")

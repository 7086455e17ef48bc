"""Lights of an open scene, as its edits leave them, those that are still being prepared too; and their directions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.draw.camera import frame_of
from gi_core.scene.pose import axis_angle, rotation, three
from gi_core.scene.types import DirectionalLight, Light, PhotometricLight, Pose, Scene, SpotLight

if TYPE_CHECKING:
    from gi_core.files.edits import Edit, Values


NARROWEST, STEEPEST = 0.1, 90.0  # degrees from the axis of a spot


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
    found = {}
    for light in lights:
        count[light.name] = count.get(light.name, 0) + 1
        found[LightId(light.name, count[light.name])] = light
    return found


def lights_after(scene: Scene, pending: Iterable[Edit]) -> dict[LightId, Light]:
    """Return the lights of a scene, changed by edits that are still being prepared."""
    from gi_core.files import edits

    found = numbered(scene.lights)
    for edit in pending:
        if isinstance(edit, edits.Light) and not edit.of:
            light = found.get(LightId(edit.name, edit.number))
            if light is not None:
                values = {key: value for key, value in edit.light if key in light._fields}
                found[LightId(edit.name, edit.number)] = light._replace(**values)
    return found


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
    from gi_core.lights.photometric import axes

    _, c0 = axes(light)
    ahead = _turned_ahead(d, up, east)
    return tilt, heading, math.degrees(math.atan2(float(np.cross(ahead, c0) @ d), float(ahead @ c0)))


def aimed(light: Directed, tilt: float, heading: float, turn: float, up) -> Values:
    """Return values of a light with other angles, as of aim_of()."""
    east, north, up = frame_of(up)
    t, h = math.radians(min(max(tilt, 0.0), 180.0)), math.radians(heading)
    d = math.sin(t) * (math.cos(h) * east + math.sin(h) * north) - math.cos(t) * up
    if not isinstance(light, PhotometricLight):
        return (("direction", rounded(d)),)
    ahead = _turned_ahead(d, up, east)
    c0 = _about(d, turn) @ ahead
    return (("direction", rounded(d)), ("c0", rounded(c0)))


def towards(light: Directed, direction: np.ndarray) -> Values:
    """Return values of a light that shines along a direction (3,); a luminaire turns as little as it can."""
    new = unit(direction)
    if not isinstance(light, PhotometricLight):
        return (("direction", rounded(new)),)
    c0 = _between(unit(light.direction), new) @ unit(light.c0)
    return (("direction", rounded(new)), ("c0", rounded(c0)))


def turned(light: Light, axis, degrees: float) -> Values:
    """Return values of a light turned about an axis (3,) through it."""
    if not isinstance(light, Directed):
        return ()
    R = _about(axis, degrees)
    keys = ("direction", "c0") if isinstance(light, PhotometricLight) else ("direction",)
    return tuple((key, rounded(R @ unit(getattr(light, key)))) for key in keys)


def beam(light: SpotLight, inner: float, outer: float) -> Values:
    """Return values of a spot with another cone and the same flux."""
    from gi_core.lights.emission import spot_solid_angle

    outer = min(max(outer, NARROWEST), STEEPEST)
    inner = min(max(inner, 0.0), outer)

    def solid(a: float, b: float) -> float:
        return spot_solid_angle(math.cos(math.radians(a)), math.cos(math.radians(b)))

    factor = solid(light.inner_degrees, light.outer_degrees) / solid(inner, outer)
    return (
        ("inner_degrees", inner),
        ("outer_degrees", outer),
        ("intensity", three(c * factor for c in light.intensity)),
    )


def _turned_ahead(d: np.ndarray, up: np.ndarray, east: np.ndarray) -> np.ndarray:
    """Return the unit vector (3,) that east becomes when straight down turns into a direction the shortest way."""
    return _between(-up, d) @ east


def unit(v) -> np.ndarray:
    v = np.asarray(v, np.float64)
    return v / np.linalg.norm(v)


def rounded(v: np.ndarray) -> tuple[float, float, float]:
    return three(round(float(x), 9) + 0.0 for x in v)


def _about(axis, degrees: float) -> np.ndarray:
    """Return the rotation (3, 3) by an angle about an axis (3,)."""
    return rotation(Pose(quaternion=axis_angle(axis, degrees)))


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) that turns one unit vector (3,) into another the shortest way."""
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.eye(3) if a @ b > 0 else _about(frame_of(a)[0], 180.0)
    return _about(axis / sine, math.degrees(math.atan2(sine, float(a @ b))))

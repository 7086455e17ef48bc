"""Kinds of lights, one file each. A new one is a file with these names, its import and place in KINDS, its number, and
a branch of emitted() and of arrived(). Besides: its record in `gi_core.scene.types`, the rules of its fields in
`gi_core.scene.validate`, its word for scene files in LIGHTS of `gi_core.files.formats.toml_file`.

    RECORD                                     the record of `gi_core.scene.types`
    parameters(light, around, table) -> list   at most WIDTH numbers: place (3), axis (3), others; table: of a luminaire
    flux(light, around) -> (3,)                [W] that its photons carry
    value(light) -> (3,) or None               factor of arrive(); None: no delta light
    emit(p, tables, u, v, s, t)                kernel: origin and direction of a photon from numbers in [0, 1)
    arrive(p, tables, position, normal, far)   kernel: irradiance over the value at a point, unit direction (x, y, z)
                                               to the light, distance [m]; `far` of a distant one

Emissive faces have no record: `area.py` builds and samples them, and halves of luminaires' rectangles.
"""

from __future__ import annotations

from typing import NamedTuple, get_args

import numpy as np

from gi_core.base.jit import kernel
from gi_core.lights import area, photometric, point, sky, spot, sun
from gi_core.scene.types import DistantLight, Light

KINDS = area, point, spot, sun, sky, photometric
AREA, POINT, SPOT, SUN, SKY, PHOTOMETRIC = range(len(KINDS))
KIND_OF: dict[type, int] = {kind.RECORD: number for number, kind in enumerate(KINDS) if kind is not area}
IS_DISTANT = np.array([kind is not area and kind.RECORD in get_args(DistantLight) for kind in KINDS])
WIDTH = 12  # parameters of a light


class Surroundings(NamedTuple):
    """The sphere that light from afar must cover, and the way up."""

    centre: np.ndarray  # (3,) float64 [m]
    radius: float  # [m]
    up: np.ndarray  # (3,) float64 unit


def parameters(light: Light, around: Surroundings, table: int) -> np.ndarray:
    """Return the parameters (WIDTH,) float64 of a light."""
    values = np.concatenate(KINDS[KIND_OF[type(light)]].parameters(light, around, table))
    return np.concatenate([values, np.zeros(WIDTH - len(values))])


@kernel
def emitted(kind, p, tables, u, v, s, t):
    """Return origin [m] and unit direction of a photon."""
    if kind == AREA:
        return area.emit(p, tables, u, v, s, t)
    if kind == POINT:
        return point.emit(p, tables, u, v, s, t)
    if kind == SPOT:
        return spot.emit(p, tables, u, v, s, t)
    if kind == SUN:
        return sun.emit(p, tables, u, v, s, t)
    if kind == SKY:
        return sky.emit(p, tables, u, v, s, t)
    return photometric.emit(p, tables, u, v, s, t)


@kernel
def arrived(kind, p, tables, position, normal, far):
    """Return E / value of a delta light at a point, the unit direction to it (x, y, z) and its distance [m]."""
    if kind == POINT:
        return point.arrive(p, tables, position, normal, far)
    if kind == SPOT:
        return spot.arrive(p, tables, position, normal, far)
    if kind == SUN:
        return sun.arrive(p, tables, position, normal, far)
    return photometric.arrive(p, tables, position, normal, far)

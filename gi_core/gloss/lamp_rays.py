"""Rays from glossy points to lamps, which share a lamp's light with rays drawn from the lobe: for pictures.

Both kinds are weighted by the balance heuristic (Veach 1997). A lobe wider than a lamp seldom draws a ray to it; a
narrower one seldom has the lamp's point in it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vec import difference, dot, row
from gi_core.base.vectors import dot as dots
from gi_core.base.vectors import length
from gi_core.bsdf.table import Tables
from gi_core.gloss.lobe_rays import local_density, local_value, local_view
from gi_core.lights.light_sampling import AreaLights
from gi_core.lights.next_event import point_on_lamp


class LampRays(NamedTuple):
    """A ray to a lamp from each of L numbers at each of n points."""

    lamp: np.ndarray  # (n, L) int64, row of the area lights; -1: no ray
    direction: np.ndarray  # (n, L, 3) float64 unit
    radiance: np.ndarray  # (n, L, 3) float64 [W/m2/sr], towards the eye if the lamp is seen; the mean over L counts


def lamp_rays(
    lights: AreaLights, lobe: np.ndarray, tables: Tables, to_eye: np.ndarray, normals: np.ndarray, tangents: np.ndarray,
    points: np.ndarray, flat: np.ndarray, numbers: np.ndarray, rivals: float,
) -> LampRays:  # fmt: skip
    """Return rays from points (n, 3) to lamps, above the faces of normals `flat` (n, 3) alone.

    lobe (n, 5), to_eye, normals, tangents (n, 3): as for draw_lobe(); numbers (n, L, 2) in [0, 1); rivals: rays drawn
    from the lobe per ray to a lamp. Luminaires get no ray.
    """
    shape = numbers.shape[:2]
    out = LampRays(np.full(shape, -1), np.empty((*shape, 3)), np.zeros((*shape, 3)))
    views = (np.ascontiguousarray(a, np.float64) for a in (lobe, to_eye, normals, tangents, points, flat, numbers))
    _aim(lights, tables, *views, rivals, *out)
    return out


@kernel
def _aim(lights, tables, lobe, to_eye, normals, tangents, points, flat, numbers, rivals, lamp, direction, radiance):
    for k in range(len(points)):
        axes, i = local_view(lobe, to_eye, normals, tangents, k)
        for j in range(numbers.shape[1]):
            e, density, p = point_on_lamp(lights, numbers[k, j, 0], numbers[k, j, 1])
            way = difference(p, row(points, k))
            d = math.sqrt(dot(way, way))
            if lights.table[e] >= 0 or d == 0.0:
                continue
            way = way[0] / d, way[1] / d, way[2] / d
            at_lamp, z = -dot(way, row(lights.normal, e)), dot(way, axes[2])
            if not (at_lamp > 0.0 and z > 0.0 and dot(way, row(flat, k)) > 0.0):
                continue
            o = dot(way, axes[0]), dot(way, axes[1]), z
            red, green, blue = local_value(tables, lobe, k, i, o)
            share = z / (density * d * d / at_lamp + rivals * local_density(tables, lobe, k, i, o))
            lamp[k, j] = e
            direction[k, j, 0], direction[k, j, 1], direction[k, j, 2] = way
            radiance[k, j, 0] = red * share * lights.radiance[e, 0]
            radiance[k, j, 1] = green * share * lights.radiance[e, 1]
            radiance[k, j, 2] = blue * share * lights.radiance[e, 2]


def share_of_lamps(lights: AreaLights, lamp: np.ndarray, way: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Return the share (n,) of a lamp's light that rays to lamps bring, where rays from the lobe hit lamp (n,).

    way (n, 3) [m]: of the rays, from start to hit; density (n,) [1/sr]: of rays from the lobe, times their number per
    ray to a lamp; inf: there are none to lamps.
    """
    distance = length(way)
    at_lamp = np.maximum(-dots(way, lights.normal[lamp]) / distance, 1e-9)
    p_lamp = lights.density[lamp] * distance * distance / at_lamp
    return p_lamp / (p_lamp + density)

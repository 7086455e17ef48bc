"""Highlights: lights without a surface seen in gloss, as no reflected ray meets them.

L = sum over lights of f(i, o) cos i E, with E on a plane that faces the light; a shadow ray says whether it arrives.
Mirrors have none, since a light without a size has no image. Luminaires with a size count as points: a lobe is wider.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vec import dot, row
from gi_core.base.vectors import dot as dots
from gi_core.bsdf import surface
from gi_core.gloss.lobe_rays import LobeViews
from gi_core.lights.area import triangle_area
from gi_core.lights.kinds import PHOTOMETRIC, arrived
from gi_core.lights.light_sampling import DeltaLights, Lights
from gi_core.rays.accelerator import FAR, GAP, Accelerator, Transforms
from gi_core.rays.all_objects import occluded_in_world


def without_surface(lights: Lights) -> DeltaLights:
    """Return the delta lights, and each half of a luminaire's rectangle as a point in its middle."""
    area, delta = lights.area, lights.delta
    rows = np.flatnonzero(area.table >= 0)
    if not len(rows):
        return delta
    corners = area.corners[rows]
    flux = math.pi * np.array([triangle_area(c) for c in corners])[:, None] * area.radiance[rows]
    middle, table = corners.reshape(-1, 3, 3).mean(axis=1), area.table[rows, None] + len(delta.tables)
    of_panels = middle, area.normal[rows], area.c0[rows], np.zeros((len(rows), 2)), table
    return DeltaLights(
        np.append(delta.kind, np.full(len(rows), PHOTOMETRIC)),
        np.concatenate([delta.parameters, np.concatenate(of_panels, axis=1)]),
        np.concatenate([delta.value, flux]),
        np.append(delta.lamp, area.lamp[rows]),
        np.append(delta.tables, area.tables),
    )


class Arriving(NamedTuple):
    """Light of L lights without a surface at n points."""

    direction: np.ndarray  # (n, L, 3) float64 unit, towards the light
    strength: np.ndarray  # (n, L) float64, irradiance of a plane that faces the light per unit of its value, 0: hidden
    distance: np.ndarray  # (n, L) float64 [m]


def arriving(
    accelerator: Accelerator, at: Transforms, points: np.ndarray, normals: np.ndarray, lift: np.ndarray,
    lights: DeltaLights, size: float,
) -> Arriving:  # fmt: skip
    """Return what arrives at points (n, 3), by a shadow ray each to each light.

    normals (n, 3): flat or smooth; rays start at `lift` (n,) [m] from the surface, on the light's side; size [m]: of
    the scene.
    """
    out = unoccluded(points, lights, size)
    rows, e = np.nonzero(out.strength)
    way, normal, off = out.direction[rows, e], normals[rows], lift[rows]
    side = np.where(dots(way, normal) < 0, -off, off)[:, None]
    limits = np.maximum((1 - GAP) * out.distance[rows, e] - 2 * off, 0.0)
    blocked = occluded_in_world(accelerator, at, points[rows] + side * normal, way, limits)
    out.strength[rows[blocked], e[blocked]] = 0.0
    return out


def unoccluded(points: np.ndarray, lights: DeltaLights, size: float) -> Arriving:
    """Return what would arrive without anything in between; arguments as for arriving()."""
    n, count = len(points), len(lights.kind)
    out = Arriving(np.empty((n, count, 3)), np.empty((n, count)), np.empty((n, count)))
    _aim(np.ascontiguousarray(points, np.float64), lights, FAR * size, *out)
    return out


@kernel
def _aim(points, lights, far, direction, strength, distance):
    for k in range(len(points)):
        p = row(points, k)
        for e in range(len(lights.kind)):
            # Once for the direction, once for a plane that faces it.
            kind, parameters = lights.kind[e], lights.parameters[e]
            way = arrived(kind, parameters, lights.tables, p, (0.0, 0.0, 0.0), far)[1:4]
            strength[k, e], x, y, z, distance[k, e] = arrived(kind, parameters, lights.tables, p, way, far)
            direction[k, e, 0], direction[k, e, 1], direction[k, e, 2] = x, y, z


def highlights(views: LobeViews, light: Arriving, values: np.ndarray) -> np.ndarray:
    """Return the radiance (n, 3) float64 [W/m2/sr] towards the eye; values (L, 3): of the lights."""
    out = np.zeros((len(views.of), 3))
    _add(views, light, np.ascontiguousarray(values, np.float64), out)
    return out


@kernel
def _add(views, light, values, out):
    for k in range(len(out)):
        i, n, t = row(views.to_eye, k), row(views.normals, k), row(views.tangents, k)
        for e in range(len(values)):
            o = row(light.direction[k], e)
            E = light.strength[k, e] * dot(o, n)
            if not E > 0.0:
                continue
            red, green, blue = surface.value(views.lobes, views.of[k], i, o, n, t)
            out[k, 0] += E * red * values[e, 0]
            out[k, 1] += E * green * values[e, 1]
            out[k, 2] += E * blue * values[e, 2]

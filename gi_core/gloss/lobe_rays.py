"""Rays of gloss alone, for pictures and the reference: drawn from a lobe as paths draw them, and to lamps.

Both kinds share the light of a lamp by the balance heuristic (Veach 1997). A lobe wider than a lamp seldom draws a ray
to it; a narrower one seldom has the lamp's point in it.

Highlights show lights without a surface, which no ray meets: L = sum over lights of f(i, o) cos i E. E is that on a
plane that faces the light, if a shadow ray reaches it. Mirrors have none, since a light without a size has no
image. Luminaires with a size count as points: a lobe is wider.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vec import difference, dot, row
from gi_core.base.vectors import dot as dots
from gi_core.base.vectors import length
from gi_core.bsdf import ggx, surface
from gi_core.bsdf.surface import Bsdfs, Glossy, Tabulated
from gi_core.bsdf.table import Tables
from gi_core.lights.area import AreaLights, point_on_lamp, triangle_area
from gi_core.lights.kinds import PHOTOMETRIC, arrived
from gi_core.lights.lamps import DeltaLights, Lights
from gi_core.rays.accelerator import FAR, GAP, Accelerator, Transforms
from gi_core.rays.all_objects import occluded_in_world


def gloss_alone(lobe: np.ndarray, tables: Tables) -> Bsdfs:
    """Return the reflection of lobes (K, 5) over black: F0, F90, alpha; alpha -1 - k: table k."""
    black = np.zeros((len(lobe), 3))
    glossy = Glossy(black, black, np.arange(len(lobe), dtype=np.int32), np.array(lobe, np.float64), ggx.albedos())
    return Tabulated(*glossy, tables, black) if len(tables.head) else glossy


class LobeViews(NamedTuple):
    """Views of n glossy points."""

    lobes: Bsdfs  # see gloss_alone()
    of: np.ndarray  # (n,) int64, lobe of each view
    to_eye: np.ndarray  # (n, 3) float64 unit
    normals: np.ndarray  # (n, 3) float64 unit
    tangents: np.ndarray  # (n, 3) float64 unit, of tables

    @classmethod
    def of_lobes(cls, lobes: Bsdfs, of: np.ndarray | int, *vectors: np.ndarray) -> LobeViews:
        """Return views of lobes, of: that of each view, or of all; vectors: to_eye, normals and tangents (n, 3)."""
        n = len(vectors[0])
        to_eye, normals, tangents = (np.ascontiguousarray(v, np.float64) for v in vectors)
        return cls(lobes, np.array(np.broadcast_to(of, n), np.int64), to_eye, normals, tangents)

    def repeated(self, count: int) -> LobeViews:
        """Return each view `count` times."""
        return LobeViews(self.lobes, *(np.repeat(a, count, axis=0) for a in self[1:]))


def draw_lobe(views: LobeViews, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw a direction of incident light per view by numbers (n, 3) in [0, 1): directions, factors and densities.

    Directions (n, 3) float64 are unit; their radiance times factors (n, 3) float64 is the mean radiance of gloss;
    densities (n,) float64 [1/sr] are inf for a mirror. Factors are 0 below the surface.
    """
    n = len(numbers)
    out = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    _draw(views, np.ascontiguousarray(numbers, np.float64), *out)
    return out


@kernel
def _draw(views, numbers, directions, factors, densities):
    for k in range(len(numbers)):
        u, v, w = row(numbers, k)
        i, n, t = row(views.to_eye, k), row(views.normals, k), row(views.tangents, k)
        d, factor, p = surface.sampled(views.lobes, views.of[k], i, n, t, u, v, w)
        directions[k, 0], directions[k, 1], directions[k, 2] = d
        factors[k, 0], factors[k, 1], factors[k, 2] = factor
        densities[k] = math.inf if p < 0.0 else p


class LampRays(NamedTuple):
    """A ray to a lamp from each of L numbers at each of n points."""

    lamp: np.ndarray  # (n, L) int64, row of the area lights; -1: no ray
    direction: np.ndarray  # (n, L, 3) float64 unit
    radiance: np.ndarray  # (n, L, 3) float64 [W/m2/sr], towards the eye if the lamp is seen; the mean over L counts


def lamp_rays(
    lights: AreaLights, views: LobeViews, points: np.ndarray, flat: np.ndarray, numbers: np.ndarray, rivals: float
) -> LampRays:
    """Return rays from points (n, 3) float64 [m] to lamps, above the faces of normals `flat` (n, 3) alone.

    numbers (n, L, 2) in [0, 1); rivals: rays drawn from the lobe per ray to a lamp. Luminaires get no ray.
    """
    shape = numbers.shape[:2]
    out = LampRays(np.full(shape, -1), np.empty((*shape, 3)), np.zeros((*shape, 3)))
    _aim(lights, views, *(np.ascontiguousarray(a, np.float64) for a in (points, flat, numbers)), rivals, out)
    return out


@kernel
def _aim(lights, views, points, flat, numbers, rivals, out):
    for k in range(len(points)):
        i, n, t = row(views.to_eye, k), row(views.normals, k), row(views.tangents, k)
        for j in range(numbers.shape[1]):
            e, density, p = point_on_lamp(lights, numbers[k, j, 0], numbers[k, j, 1])
            way = difference(p, row(points, k))
            d = math.sqrt(dot(way, way))
            if lights.table[e] >= 0 or d == 0.0:
                continue
            way = way[0] / d, way[1] / d, way[2] / d
            at_lamp, z = -dot(way, row(lights.normal, e)), dot(way, n)
            if not (at_lamp > 0.0 and z > 0.0 and dot(way, row(flat, k)) > 0.0):
                continue
            red, green, blue = surface.value(views.lobes, views.of[k], i, way, n, t)
            rival = rivals * surface.pdf(views.lobes, views.of[k], i, way, n, t)
            share = z / (density * d * d / at_lamp + rival)
            out.lamp[k, j] = e
            out.direction[k, j, 0], out.direction[k, j, 1], out.direction[k, j, 2] = way
            out.radiance[k, j, 0] = red * share * lights.radiance[e, 0]
            out.radiance[k, j, 1] = green * share * lights.radiance[e, 1]
            out.radiance[k, j, 2] = blue * share * lights.radiance[e, 2]


def share_of_lamps(lights: AreaLights, lamp: np.ndarray, way: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Return the share (n,) of a lamp's light that rays to lamps bring, where rays from the lobe hit lamp (n,).

    way (n, 3) [m]: of the rays, from start to hit; density (n,) [1/sr]: of rays from the lobe, times their number per
    ray to a lamp; inf: there are none to lamps.
    """
    distance = length(way)
    at_lamp = np.maximum(-dots(way, lights.normal[lamp]) / distance, 1e-9)
    p_lamp = lights.density[lamp] * distance * distance / at_lamp
    return p_lamp / (p_lamp + density)


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
    """Return the light that arrives at points (n, 3), by a shadow ray from each point to each light.

    normals (n, 3): flat or smooth; rays start at `lift` (n,) [m] from the surface, on the light's side; size [m]: of
    the scene.
    """
    out = unoccluded(points, lights, size)
    rows, e = np.nonzero(out.strength)
    way, normal, off = out.direction[rows, e], normals[rows], lift[rows]
    side = np.where(dots(way, normal) < 0, -off, off)[:, None]
    limits = np.maximum((1 - GAP) * out.distance[rows, e] - 2 * off, 0.0)
    shares = np.ones((len(rows), 3))  # panes colour no highlight
    occluded_in_world(accelerator, at, points[rows] + side * normal, way, limits, shares)
    out.strength[rows, e] *= shares.mean(axis=1)
    return out


def unoccluded(points: np.ndarray, lights: DeltaLights, size: float) -> Arriving:
    """Return the light that would arrive without anything in between; arguments as for arriving()."""
    n, count = len(points), len(lights.kind)
    out = Arriving(np.empty((n, count, 3)), np.empty((n, count)), np.empty((n, count)))
    _aim_at_lights(np.ascontiguousarray(points, np.float64), lights, FAR * size, *out)
    return out


@kernel
def _aim_at_lights(points, lights, far, direction, strength, distance):
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

"""Area lights: emissive faces, and halves of luminaires' rectangles. Points on them have a known density per area.

Faces are chosen by flux, or by importance for a mobile (`aimed`): radiance, area, distance, and the largest cosine at
the lamp to any point of the mobile's bounding sphere. All receivers of a mobile share the choice, so their errors are
correlated and invisible on a smooth surface. The choice changes only when the mobile leaves a grid cell as wide as its
radius: choices that follow every step make the light flicker.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import inlined, kernel
from gi_core.base.nearest_points import hilbert_order
from gi_core.base.vec import cross, difference, dot, largest, row, weighted
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights.photometric import density, panels, tables_of
from gi_core.rays.accelerator import GAP
from gi_core.scene.types import Scene

BY_FLUX = 0.02  # share of the probability in proportion to flux alone, so that every lamp keeps some


class AreaLights(NamedTuple):
    """Emissive faces of the static part, and halves of the rectangles of luminaires. Mobiles emit nothing.

    A luminaire's radiance is that of a diffuse face of its flux; `table` gives its share by direction.
    """

    corners: np.ndarray  # (A, 9) float64 [m]
    normal: np.ndarray  # (A, 3) float64 unit
    radiance: np.ndarray  # (A, 3) float64 Le [W/m2/sr]
    cdf: np.ndarray  # (A,) float64, cumulative probability of each face, ends at 1
    density: np.ndarray  # (A,) float64 [1/m2], probability density of a point on the face
    of_face: np.ndarray  # (F,) int32, index of a global face among the area lights, -1: none
    lamp: np.ndarray  # (A,) int64
    table: np.ndarray  # (A,) int64, start in `tables`, -1: a diffuse face
    c0: np.ndarray  # (A, 3) float64 unit, of luminaires; their axis is the normal
    tables: np.ndarray  # (n,) float64, see `photometric.py`


@kernel
def emit(p, _tables, u, v, s, t):
    """p: corners (9) and unit normal (3) of an emissive face."""
    b, c = random_numbers.triangle(u, v)
    a = 1.0 - b - c
    x, y, z = random_numbers.cosine_hemisphere(s, t)
    way = random_numbers.from_frame(x, y, z, p[9], p[10], p[11])
    return (a * p[0] + b * p[3] + c * p[6], a * p[1] + b * p[4] + c * p[7], a * p[2] + b * p[5] + c * p[8]), way


def area_lights(
    surfaces: Surfaces, lamp: np.ndarray | None = None, scene: Scene | None = None, of_light: np.ndarray | None = None
) -> AreaLights:
    """Collect emissive faces in Hilbert-curve order, chosen in proportion to flux; lamp: of each static face.

    scene: whose luminaires with a size follow; of_light: lamp of each of its lights. Samples are stratified over the
    cumulative probability. In this order each stratum is a compact patch of a lamp.
    """
    static, more = surfaces.face_range(0), panels(scene)
    tables, starts = tables_of(scene.lights if scene is not None else ())
    emitted = np.zeros_like(surfaces.emission)
    emitted[static] = surfaces.emission[static]
    power = surfaces.areas * emitted.max(axis=1, initial=0)
    faces = np.flatnonzero(power > 0)
    corners = surfaces.vertices[0][surfaces.faces[0][faces]]
    order = hilbert_order(corners.mean(axis=1))
    faces, corners = faces[order], corners[order].reshape(-1, 9)
    of_face = np.full(len(power), -1, np.int32)
    of_face[faces] = np.arange(len(faces))
    lamp = np.zeros(len(faces), np.int64) if lamp is None else lamp[faces]
    added = more.area * more.radiance.max(axis=1, initial=0)
    total = power.sum() + added.sum()
    share = np.concatenate([power[faces], added]) / total if len(faces) + len(added) else np.zeros(0)
    cdf = np.cumsum(share)
    cdf[-1:] = 1.0
    density = share / np.concatenate([surfaces.areas[faces], more.area])
    lamps = np.zeros(len(more.light), np.int64) if of_light is None else of_light[more.light]
    return AreaLights(
        np.concatenate([corners, more.corners.reshape(-1, 9)]),
        np.concatenate([surfaces.normals[faces], more.normal]),
        np.concatenate([emitted[faces], more.radiance]),
        cdf,
        density,
        of_face,
        np.concatenate([lamp, lamps]),
        np.concatenate([np.full(len(faces), -1, np.int64), np.array(starts, np.int64)[more.light]]),
        np.concatenate([np.zeros((len(faces), 3)), more.c0]),
        tables,
    )


def area_at_levels(area: AreaLights, levels: np.ndarray) -> AreaLights:
    """Return area lights at levels (G, 3) of the lamps; faces are chosen in proportion to flux again."""
    radiance = area.radiance * levels[area.lamp]
    largest = radiance.max(axis=1, initial=0)
    size = np.divide(np.diff(area.cdf, prepend=0.0), area.density, out=np.zeros(len(largest)), where=area.density > 0)
    lit = np.flatnonzero((largest > 0) & (size > 0))  # shares below 1e-16 are lost in the cdf
    size = size[lit]
    power = size * largest[lit]
    share = power / power.sum() if len(lit) else power
    cdf = np.cumsum(share)
    cdf[-1:] = 1.0
    place = np.full(len(area.cdf) + 1, -1, np.int32)  # of_face is -1 where a face emits nothing
    place[lit] = np.arange(len(lit))
    return AreaLights(
        area.corners[lit], area.normal[lit], radiance[lit], cdf, share / size, place[area.of_face],
        area.lamp[lit], area.table[lit], area.c0[lit], area.tables,
    )  # fmt: skip


@inlined
def point_on_lamp(lights, u, v):
    """Return the emissive face that u in [0, 1) picks, the density [1/m2], and a point on the face [m]."""
    e = random_numbers.picked(lights.cdf, u)
    before = lights.cdf[e - 1] if e > 0 else 0.0
    share = lights.cdf[e] - before
    # The rest of the number, scaled to [0, 1), is uniform again.
    b, c = random_numbers.triangle(min(max((u - before) / share, 0.0), 1.0), v)
    p = lights.corners[e]
    return e, share / triangle_area(p), weighted((1.0 - b - c, b, c), p[0:3], p[3:6], p[6:9])


@kernel
def gap_before(corners, start):
    """Return how far [m] before a triangle of corners (9,) a shadow ray from `start` ends."""
    reach = max(largest(corners[0:3]), max(largest(corners[3:6]), largest(corners[6:9])))
    return GAP * max(reach, largest(start))


def aimed(lights: AreaLights, centre: np.ndarray, radius: float) -> AreaLights:
    """Return area lights with probabilities by importance for a sphere: centre (3,) [m] in the world, radius [m]."""
    share, area = np.empty_like(lights.cdf), np.empty_like(lights.cdf)
    place = np.asarray(centre, np.float64)
    _aim(lights, place, radius, share, area)
    cdf = np.cumsum(share)
    cdf[-1:] = 1.0
    return lights._replace(cdf=cdf, density=share / area)


@kernel
def _aim(lights, centre, radius, share, area):
    """Write the probability and the area [m2] of each face."""
    flux = brought = 0.0
    for e in range(len(area)):
        p, n, radiance = lights.corners[e], row(lights.normal, e), row(lights.radiance, e)
        area[e] = triangle_area(p)
        power = area[e] * max(radiance)
        middle = (p[0] + p[3] + p[6]) / 3.0, (p[1] + p[4] + p[7]) / 3.0, (p[2] + p[5] + p[8]) / 3.0
        way = difference(centre, middle)
        d2 = dot(way, way)
        if lights.table[e] >= 0:
            cosine = math.pi * _best_density(lights, e, way, radius)
        else:
            cosine = largest_cosine(dot(way, n), d2, radius)
        share[e] = power * cosine / (d2 + radius * radius + area[e])
        flux += power
        brought += share[e]
    for e in range(len(area)):
        power = area[e] * max(row(lights.radiance, e))
        if brought > 0.0:
            share[e] = (1.0 - BY_FLUX) * share[e] / brought + BY_FLUX * power / flux
        else:
            share[e] = power / flux


@kernel
def _best_density(lights, e, way, radius):
    """Return the largest density [1/sr] of a luminaire towards the centre of a sphere, at `way`, and points around."""
    best = 0.0
    for i in range(-1, 2):
        for j in range(-1, 2):
            for k in range(-1, 2):
                away = radius / math.sqrt(max(i * i + j * j + k * k, 1))
                x, y, z = way[0] + away * i, way[1] + away * j, way[2] + away * k
                d = math.sqrt(x * x + y * y + z * z)
                if d > 0.0:
                    at = lights.table[e], lights.normal[e], lights.c0[e]
                    best = max(best, density(lights.tables, at[0], at[1], at[2], x / d, y / d, z / d))
    return best


@kernel
def triangle_area(p):
    """Return the area of a triangle from its corners (9,)."""
    across = cross(difference(p[3:6], p[0:3]), difference(p[6:9], p[0:3]))
    return 0.5 * math.sqrt(dot(across, across))


@kernel
def largest_cosine(height, d2, radius):
    """Return the largest cosine at a lamp to any point of a sphere; 0 if the sphere lies behind the lamp.

    height [m]: of the centre over the lamp's plane; d2 [m2]: squared distance of the centre.
    """
    if d2 <= radius * radius:
        return 1.0
    d = math.sqrt(d2)
    cosine, sine_out = height / d, radius / d
    cosine_out = math.sqrt(1.0 - sine_out * sine_out)
    if cosine >= cosine_out:
        return 1.0
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    return max(0.0, cosine * cosine_out + sine * sine_out)

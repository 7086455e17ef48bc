"""Shadow rays chosen among candidates: resampled importance sampling (Talbot, Cline and Egbert 2005).

Points on lamps lie along the lamps in strata of CANDIDATES points, the same for many receivers. A receiver computes the
unoccluded light of each candidate and sends one shadow ray per stratum, to a candidate chosen in proportion to it. A
ray that arrives brings the mean of its stratum. Its expectation is the light of the candidates, so it is unbiased, and
distance and angle add little noise: their means are over all candidates.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base import owen_sobol, random_numbers
from gi_core.base.jit import allocating, kernel
from gi_core.base.vec import difference, dot, row
from gi_core.geometry.error import REC709
from gi_core.lights.light_sampling import AreaLights
from gi_core.lights.next_event import LIGHT_U, LIGHT_V, aim_ray, point_on_lamp
from gi_core.lights.photometric import density

CANDIDATES = 8  # per shadow ray
PICK = 3  # dimension, after those of next_event.py
RED, GREEN, BLUE = REC709


class Candidates(NamedTuple):
    """Points on area lights in n strata, n CANDIDATES in all, in the order of their strata."""

    point: np.ndarray  # (3, n CANDIDATES) float64 [m]
    normal: np.ndarray  # (3, n CANDIDATES) float64 unit, of the lamp
    density: np.ndarray  # (n CANDIDATES,) float64 [1/m2], probability density of the point
    power: np.ndarray  # (n CANDIDATES,) float64 [W/m2/sr], luminance of the radiance
    face: np.ndarray  # (n CANDIDATES,) int64, emissive face
    pick: np.ndarray  # (n,) float64 in [0, 1), chooses one point of a stratum


def candidates(seed: int, strata: int, lights: AreaLights) -> Candidates:
    """Draw candidates in strata of equal probability; none without area lights."""
    n = strata * CANDIDATES if len(lights.cdf) else 0
    out = Candidates(*np.empty((2, 3, n)), *np.empty((2, n)), np.empty(n, np.int64), np.empty(n // CANDIDATES))
    _draw(seed, lights, *out)
    return out


@kernel
def _draw(seed, lights, point, normal, density, power, face, pick):
    n, key = len(face), random_numbers.hashed(seed, 0, 0, LIGHT_V)
    for i in range(n):
        # A Hammersley set: its first number ascends, so a stratum is a run of points.
        u = (i + random_numbers.independent(seed, i, 0, LIGHT_U)) / n
        v = owen_sobol.unit(np.uint64(i), key)
        e, density[i], p = point_on_lamp(lights, min(u, 1.0 - 2.0**-53), v)
        face[i], power[i] = e, dot((RED, GREEN, BLUE), row(lights.radiance, e))
        point[0, i], point[1, i], point[2, i] = p
        normal[0, i], normal[1, i], normal[2, i] = row(lights.normal, e)
    for j in range(len(pick)):
        pick[j] = random_numbers.independent(seed, j, 0, PICK)


@allocating
def join_candidates(of, paths, ends, lights, gap, out):
    """Write shadow rays from n path starts to area lights, one per stratum of candidates; return their number.

    Starts are on diffuse surfaces. Values [W/m2] of a start sum to `paths` times its irradiance; they are weighted
    against bounces as in `next_event.join_area`. Rays end `gap` [m] before the lamp.
    """
    count, light = 0, np.empty(CANDIDATES)
    scale = paths / max(len(of.face), 1)
    for k in range(len(ends.row)):
        position, normal = row(ends.position, k), row(ends.normal, k)
        for j in range(len(of.pick)):
            first = np.uint64(j * CANDIDATES)
            _unoccluded(of, first, position, normal, light)
            for c in range(CANDIDATES):
                if lights.table[of.face[first + np.uint64(c)]] >= 0:
                    light[c] = _from_luminaire(of, first + np.uint64(c), position, normal, lights)
            total = 0.0
            for c in range(CANDIDATES):
                total += light[c]
            if total <= 0.0:
                continue
            left, chosen = of.pick[j] * total, first
            for c in range(CANDIDATES):
                if light[c] > 0.0:
                    chosen = first + np.uint64(c)  # the last candidate stays if rounding exhausts the sum
                    left -= light[c]
                    if left < 0.0:
                        break
            value, radiance = scale * total / of.power[chosen], lights.radiance[of.face[chosen]]
            out.value[count, 0], out.value[count, 1] = value * radiance[0], value * radiance[1]
            out.value[count, 2], out.lamp[count] = value * radiance[2], lights.lamp[of.face[chosen]]
            way = difference((of.point[0, chosen], of.point[1, chosen], of.point[2, chosen]), position)
            d = math.sqrt(dot(way, way))
            aim_ray(ends.row[k], position, (way[0] / d, way[1] / d, way[2] / d), max(d - gap, 0.0), out, count)
            count += 1
    return count


@kernel
def _unoccluded(of, first, position, normal, out):
    """Write the luminance of candidates `first` and following over their density. LLVM vectorises this loop."""
    for c in range(np.uint64(CANDIDATES)):
        i = first + c
        x, y, z = of.point[0, i] - position[0], of.point[1, i] - position[1], of.point[2, i] - position[2]
        d2 = x * x + y * y + z * z
        here = max(x * normal[0] + y * normal[1] + z * normal[2], 0.0)
        there = max(-(x * of.normal[0, i] + y * of.normal[1, i] + z * of.normal[2, i]), 0.0)
        # Le cos cos' / d^2 / (p_light + cos cos' / d^2 / pi), times d^4 above and below
        out[c] = of.power[i] * here * there / max(of.density[i] * d2 * d2 + here * there / math.pi, 1e-300)


@kernel
def _from_luminaire(of, i, position, normal, lights):
    """Return the luminance of candidate i, on a luminaire, over its density: no bounce hits one."""
    e, way = of.face[i], difference((of.point[0, i], of.point[1, i], of.point[2, i]), position)
    d2, here, axis = dot(way, way), dot(way, normal), lights.normal[e]
    if not (here > 0.0 and dot(way, axis) < 0.0):
        return 0.0
    d = math.sqrt(d2)
    share = density(lights.tables, lights.table[e], axis, lights.c0[e], -way[0] / d, -way[1] / d, -way[2] / d)
    return of.power[i] * math.pi * share * here / (d * d2 * of.density[i])

"""Paths whose random numbers many receivers share: directions, and points on lamps, are drawn once for all of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core import sampling, strata
from gi_core.bsdf import lambertian
from gi_core.jit import allocating, kernel
from gi_core.light_sampling import LIGHT_U, LIGHT_V, SMALL_PICK, AreaLights, aim, arrives, point_on_lamp, small_light_at
from gi_core.path_gather import SCATTER_U, SCATTER_V

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # of a turn, from one direction to the next


class SharedPaths(NamedTuple):
    """The choices of P paths of one bounce."""

    bounce: np.ndarray  # (kinds, P, 3) float64 unit, cosine-distributed about the third axis
    pick: np.ndarray  # (P,) float64 in [0, 1), for lights without size


class LampPoints(NamedTuple):
    """Points on lamps, one a path; none where there are no lamps."""

    lamp: np.ndarray  # (P,) int64, emissive face
    point: np.ndarray  # (P, 3) float64 on it [m]
    density: np.ndarray  # (P,) float64 [1/m2], of that choice


def shared_paths(seed: int, m: int, kinds: int) -> SharedPaths:
    """Draw 2^m paths, their directions in so many kinds: each shares the hemisphere out, so do all together."""
    out = SharedPaths(np.empty((kinds, 1 << m, 3)), np.empty(1 << m))
    _draw(seed, m, out)
    return out


def lamp_points(seed: int, m: int, lights: AreaLights) -> LampPoints:
    """Choose the points of 2^m paths: they share the lamps out."""
    n = 1 << m if len(lights.cdf) else 0
    out = LampPoints(np.empty(n, np.int64), np.empty((n, 3)), np.empty(n))
    _choose(seed, m, lights, out)
    return out


@kernel
def _draw(seed, m, out):
    kinds, n = out.bounce.shape[:2]
    # Fibonacci's spiral, turned and shifted by chance: of such few directions the most even (Marques et al. 2013).
    # Each kind is such a spiral, and they are turned against each other so that all together are even too. Every
    # fourth direction of one spiral is not: four golden steps are nearly half a turn.
    shift, turn = sampling.independent(seed, 0, 0, SCATTER_U), sampling.independent(seed, 0, 0, SCATTER_V)
    for j in range(n):
        for c in range(kinds):
            u, v = (kinds * j + c + shift) / (kinds * n), ((j + c / kinds) * GOLDEN + turn) % 1.0
            out.bounce[c, j, 0], out.bounce[c, j, 1], out.bounce[c, j, 2] = lambertian.sample(u, v)
        out.pick[j] = strata.uniform(seed, j, 0, SMALL_PICK, m)


@kernel
def _choose(seed, m, lights, out):
    for j in range(len(out.lamp)):
        u, v = strata.uniform(seed, j, 0, LIGHT_U, m), strata.uniform(seed, j, 0, LIGHT_V, m)
        e, p_light, x, y, z = point_on_lamp(lights, u, v)
        out.lamp[j], out.density[j] = e, p_light
        out.point[j, 0], out.point[j, 1], out.point[j, 2] = x, y, z


@kernel
def bounces(paths, kinds, normals, out):
    """Turn bounces, of a kind each, to n normals: writes (n P, 3)."""
    k = 0
    for row in range(len(normals)):
        ax, ay, az, bx, by, bz = sampling.basis(normals[row, 0], normals[row, 1], normals[row, 2])
        for d in paths.bounce[kinds[row]]:
            out[k, 0] = d[0] * ax + d[1] * bx + d[2] * normals[row, 0]
            out[k, 1] = d[0] * ay + d[1] * by + d[2] * normals[row, 1]
            out[k, 2] = d[0] * az + d[1] * bz + d[2] * normals[row, 2]
            k += 1


@kernel
def from_lamps(points, lights, positions, normals, gap, out):
    """Join each of n receivers to P points on lamps; return how many of them could be lit, written to `out`.

    Values [W/m2] sum to P times what the receiver gets; rays end `gap` [m] before the lamp.
    """
    count = 0
    for row in range(len(positions)):
        position, normal = positions[row], normals[row]
        for j in range(len(points.lamp)):
            e, p = points.lamp[j], points.point[j]
            x, y, z = p[0] - position[0], p[1] - position[1], p[2] - position[2]
            geometry, x, y, z, d = arrives(x, y, z, normal, lights.normal[e], points.density[j])
            if geometry <= 0.0:
                continue
            for c in range(3):
                out.value[count, c] = lights.radiance[e, c] * geometry
            aim(row, position, x, y, z, max(d - gap, 0.0), out, count)
            count += 1
    return count


@allocating
def from_small_lights(paths, lights, positions, normals, far, gap, first, out):
    """Join each of n receivers to lights without size; as from_lamps(), written from `first` on; returns where it ends.

    To each of them where they are no more than paths: what is not in the way is then exact. Else each path chooses
    one, in proportion to what it brings if free.
    """
    lamps, count, P = len(lights.kind), first, len(paths.pick)
    reached = np.empty((lamps, 5))
    weight = np.empty(lamps)
    for row in range(len(positions)):
        position, normal = positions[row], normals[row]
        total = 0.0
        for e in range(lamps):
            found = small_light_at(
                lights.kind[e], lights.parameters[e], position[0], position[1], position[2],
                normal[0], normal[1], normal[2], far,
            )  # fmt: skip
            reached[e, 0], reached[e, 1], reached[e, 2], reached[e, 3], reached[e, 4] = found
            weight[e] = found[0] * max(lights.value[e, 0], max(lights.value[e, 1], lights.value[e, 2]))
            total += weight[e]
        if total <= 0.0:
            continue
        if lamps <= P:
            for e in range(lamps):
                if weight[e] > 0.0:
                    _reach(row, position, reached[e], P * reached[e, 0], lights.value[e], gap, out, count)
                    count += 1
            continue
        for j in range(P):
            left, chosen = paths.pick[j] * total, -1
            for e in range(lamps):
                if weight[e] > 0.0:
                    chosen = e  # rounding at the end leaves the last one
                    left -= weight[e]
                    if left < 0.0:
                        break
            strength = reached[chosen, 0] * (total / weight[chosen])
            _reach(row, position, reached[chosen], strength, lights.value[chosen], gap, out, count)
            count += 1
    return count


@kernel
def _reach(row, position, reached, strength, value, gap, out, count):
    for c in range(3):
        out.value[count, c] = strength * value[c]
    aim(row, position, reached[1], reached[2], reached[3], max(reached[4] - gap, 0.0), out, count)

"""Following gathering paths: join each vertex to the lights, bounce, see what is met.

The estimate at a vertex is what the joined lights bring plus what its bounce meets; emissive faces are
found both ways, with shares that add up to 1 (balance heuristic, Veach 1997).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core import sampling
from gi_core.accelerator import FAR, ORIGIN_LIFT, Transforms, nearest_in_world, occluded_in_world
from gi_core.bsdf import lambertian
from gi_core.jit import kernel
from gi_core.light_sampling import AreaLights, Sky, SmallLights, area_events, bounce_density, small_events
from gi_core.model import Model
from gi_core.threads import run_ranges

GRAIN = 4096  # paths a thread
SHADOW_GAP = 4 * ORIGIN_LIFT  # of the world's size: a shadow ray stops short of the light it is aimed at
ROULETTE_FROM = 2  # bounces that always survive: the first two carry most of the light
MOST_SURVIVAL = 0.99  # survival above it would keep paths in a white room for ever; still unbiased

SURVIVAL, SCATTER_U, SCATTER_V = 4, 5, 6  # dimensions beside those of light_sampling


class Lights(NamedTuple):
    """All lights of a scene, by the way they are found."""

    area: AreaLights
    small: SmallLights
    sky: Sky


class PathEnds(NamedTuple):
    """Where unfinished paths are."""

    path: np.ndarray  # (n,) int64, number of the path
    row: np.ndarray  # (n,) int64, where its sum is
    position: np.ndarray  # (n, 3) float64, lifted off the surface [m]
    normal: np.ndarray  # (n, 3) float64, of the side it is on
    throughput: np.ndarray  # (n, 3) float64, share of irradiance here that counts


def gather(model: Model, at: Transforms, lights: Lights, seed: int, v: PathEnds, light_sampling: bool):
    """Follow paths to their ends; return what each brings, (n, 3) float64 [W/m2].

    `v`: where they start, rows 0 .. n - 1; `light_sampling` False finds emissive faces by hitting them only.
    """
    total = np.zeros((len(v.path), 3))
    far = np.float32(FAR * model.world.size)
    bounce = 0
    while len(v.path):
        if len(lights.small.kind):
            _join(model, at, seed, v, bounce, lights.small, small_events, (float(far),), total)
        if light_sampling and len(lights.area.cdf):
            _join(model, at, seed, v, bounce, lights.area, area_events, (), total)
        v = _bounce(model, at, lights, seed, v, bounce, light_sampling, far, total)
        bounce += 1
    return total


def _join(model: Model, at: Transforms, seed: int, v: PathEnds, bounce: int, lights, events, extra, total) -> None:
    """Join path vertices to sampled lights, where nothing is in between."""
    n = len(v.path)
    direction, limit, value = np.empty((n, 3), np.float32), np.empty(n, np.float32), np.empty((n, 3))
    gap = SHADOW_GAP * model.world.size

    def work(_, a, b):
        s = slice(a, b)
        events(
            seed, v.path[s], bounce, v.position[s], v.normal[s], lights, *extra, gap, direction[s], limit[s], value[s]
        )

    run_ranges(work, n, model.threads, GRAIN)
    rows = np.flatnonzero(limit >= 0)
    blocked = occluded_in_world(model.accelerator, at, v.position[rows], direction[rows], limit[rows])
    rows = rows[~blocked]
    total[v.row[rows]] += v.throughput[rows] * value[rows]


def _bounce(model, at, lights: Lights, seed, v: PathEnds, bounce, light_sampling, far, total) -> PathEnds:
    """Bounce every path once; add the emission and the sky that it meets; return those that live."""
    n = len(v.path)
    direction = np.empty((n, 3), np.float32)
    alive = np.empty(n, bool)
    out = v._replace(
        position=np.empty((n, 3)), normal=np.empty((n, 3)), throughput=np.empty((n, 3))
    )  # path and row are read only
    world = model.world
    density = lights.area.density if light_sampling else np.zeros_like(lights.area.density)

    def bounce_off(_, a, b):
        _scatter(seed, v.path[a:b], bounce, v.normal[a:b], direction[a:b])

    def arrive(_, a, b):
        s = slice(a, b)
        _arrive(
            seed, v.path[s], bounce, v.position[s], v.normal[s], v.throughput[s], direction[s], distance[s], face[s],
            world.normals, world.reflectance, world.two_sided, at.rotation, world.face_object,
            lights.area.emitted, density, lights.sky, ORIGIN_LIFT * world.size,
            out.position[s], out.normal[s], out.throughput[s], brought[s], alive[s],
        )  # fmt: skip

    run_ranges(bounce_off, n, model.threads, GRAIN)
    limits = np.full(n, far, np.float32)
    distance, face = nearest_in_world(model.accelerator, at, v.position, direction, limits)
    brought = np.empty((n, 3))
    run_ranges(arrive, n, model.threads, GRAIN)
    total[v.row] += brought
    return PathEnds(*(a[alive] for a in out))


@kernel
def _scatter(seed, path, bounce, normal, direction):
    """Choose cosine-distributed directions."""
    for k in range(len(path)):
        u = sampling.independent(seed, path[k], bounce, SCATTER_U)
        v = sampling.independent(seed, path[k], bounce, SCATTER_V)
        x, y, z = lambertian.sample(u, v)
        x, y, z = sampling.from_frame(x, y, z, normal[k, 0], normal[k, 1], normal[k, 2])
        direction[k, 0], direction[k, 1], direction[k, 2] = x, y, z


@kernel
def _arrive(
    seed, path, bounce, position, normal, throughput, direction, distance, face,
    normals, reflectance, two_sided, rotation, face_object, emitted, density, sky, lift,
    new_position, new_normal, new_throughput, brought, alive,
):  # fmt: skip
    """See what the bounced paths meet.

    With pdf cos / pi the mean of pi L is the irradiance, and pi L off a diffuse surface is rho times
    the irradiance there: so throughput is multiplied by rho alone.
    """
    for k in range(len(path)):
        d, T = direction[k], throughput[k]
        alive[k] = False
        brought[k, 0], brought[k, 1], brought[k, 2] = 0.0, 0.0, 0.0
        f = face[k]
        if f < 0:
            if d[0] * sky.up[0] + d[1] * sky.up[1] + d[2] * sky.up[2] > 0.0:
                for c in range(3):
                    brought[k, c] = T[c] * math.pi * sky.radiance[c]
            continue
        m, R = normals[f], rotation[face_object[f]]
        nx = R[0, 0] * m[0] + R[0, 1] * m[1] + R[0, 2] * m[2]
        ny = R[1, 0] * m[0] + R[1, 1] * m[1] + R[1, 2] * m[2]
        nz = R[2, 0] * m[0] + R[2, 1] * m[1] + R[2, 2] * m[2]
        facing = -(d[0] * nx + d[1] * ny + d[2] * nz)
        if facing > 0.0:
            # Emission leaves the front; the share of this way of finding it is p_bounce / (p_light + p_bounce).
            cosine = d[0] * normal[k, 0] + d[1] * normal[k, 1] + d[2] * normal[k, 2]
            p_bounce = bounce_density(max(cosine, 0.0), facing, max(distance[k] * distance[k], 1e-30))
            share = p_bounce / (p_bounce + density[f]) if p_bounce > 0.0 else 0.0
            for c in range(3):
                brought[k, c] = T[c] * math.pi * emitted[f, c] * share
        elif not two_sided[f]:
            continue  # the back of a one-sided face is black
        rho = reflectance[f]
        largest = max(rho[0], max(rho[1], rho[2]))
        survival = 1.0 if bounce < ROULETTE_FROM and largest > 0.0 else min(largest, MOST_SURVIVAL)
        if not (sampling.independent(seed, path[k], bounce, SURVIVAL) < survival):
            continue
        alive[k] = True
        s = 1.0 if facing > 0.0 else -1.0
        new_normal[k, 0], new_normal[k, 1], new_normal[k, 2] = s * nx, s * ny, s * nz
        t = float(distance[k])
        for c in range(3):
            new_position[k, c] = position[k, c] + t * d[c] + lift * new_normal[k, c]
            new_throughput[k, c] = T[c] * (rho[c] / survival)

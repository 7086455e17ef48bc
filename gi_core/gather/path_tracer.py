"""Path tracing kernels: next-event estimation and a cosine-sampled bounce per vertex.

Emissive faces are found both ways, with weights of the balance heuristic (Veach 1997). Paths may end in known light
(`KnownLight`) at hits that are far from the vertex before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers, strata
from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges
from gi_core.base.vec import barycentric, dot, rotate, row
from gi_core.bsdf import lambertian, surface
from gi_core.lights.light_sampling import Lights
from gi_core.lights.next_event import (
    Shadows,
    add_lit,
    join_area,
    join_delta,
    picks,
    points_on_lamps,
    room_for_shadows,
    share_of_bounce,
)
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, ORIGIN_LIFT, Transforms
from gi_core.rays.all_objects import nearest_in_world, occluded_in_world
from gi_core.scene.pose import to_world_at

BLOCK = 1 << 14  # paths per batch: their arrays fit into a core's cache, and Embree needs 10,000 rays or more
GRAIN = 1 << 10  # paths per thread: steps of 10 ms hold some 5,000 paths per core
SHADOW_GAP = 4 * ORIGIN_LIFT  # of the world's size: gap between the end of a shadow ray and its light
ROULETTE_FROM = 2  # first bounce with Russian roulette: the first two carry most of the light
MOST_SURVIVAL = 0.9999  # bounds paths in a white room without bias; variance is finite up to its square root

# Dimensions after those of next_event.py; scattering needs a pair.
SURVIVAL, PART, SCATTER_U, SCATTER_V = 4, 5, 6, 7


class PathEnds(NamedTuple):
    """Current vertices of n unfinished paths."""

    path: np.ndarray  # (n,) int64, path number
    row: np.ndarray  # (n,) int64, row of its sum
    position: np.ndarray  # (n, 3) float64 [m], lifted off the surface
    normal: np.ndarray  # (n, 3) float64, of the side of the vertex
    throughput: np.ndarray  # (n, 3) float64, factor of irradiance at this vertex; of pi L on a glossy face
    face: np.ndarray  # (n,) int32, glossy face of the vertex; -1: start, or a diffuse face
    arrival: np.ndarray  # (n, 3) float64 unit, to the vertex before, of glossy vertices
    tangent: np.ndarray  # (n, 3) float64 unit, there
    density: np.ndarray  # (n,) float64 [1/sr], of the direction sampled at a glossy vertex; < 0: a mirror's


class KnownLight(NamedTuple):
    """Irradiance of objects, in which paths end where a hit is farther than `least` [m] of its face.

    Nearer hits lie in shadows that receivers do not resolve, such as that of a foot on the floor; paths go on there
    (Jensen 2001, secondary final gathering).
    """

    points: np.ndarray  # (R, 3) float64 of the receivers [m], static ones first
    corner_front: np.ndarray  # (F, 3) int32, receivers at the corners of a face, on its front
    corner_back: np.ndarray  # (F, 3) int32, on its back
    irradiance: np.ndarray  # (R, 3) float64 of these receivers [W/m2]
    least: np.ndarray  # (F,) float64 of these faces [m], inf: none end there; empty: paths end nowhere


NOTHING_KNOWN = KnownLight(np.zeros((0, 3)), *np.zeros((2, 0, 3), np.int32), np.zeros((0, 3)), np.zeros(0))


def known_light(
    model: Model, at: Transforms, irradiance: np.ndarray, disc_area: float, least: np.ndarray | float = 0.0
) -> KnownLight:
    """Return the light in which paths end: irradiance (R, 3) [W/m2] of the objects in `at`, beyond `least` (F,) [m].

    Paths go on from faces with a black corner, which is inside another object, and from faces larger than a disc
    [m2], whose corners say little about their light.
    """
    s, objects = model.surfaces, len(at.position)
    faces, receivers = slice(0, int(s.first_face[objects])), slice(0, int(s.first_receiver[objects]))
    points, front, back = model.object_receivers.positions[receivers], s.corner_front[faces], s.corner_back[faces]
    of = np.searchsorted(s.first_receiver[1:], np.arange(len(points)), side="right")
    black = ~(irradiance[receivers] > 0).any(axis=1)
    unknown = black[front].any(axis=1) | (s.two_sided[faces] & black[back].any(axis=1))
    unknown |= s.areas[faces] > disc_area
    there = to_world_at(at.rotation[of], at.position[of], points)
    return KnownLight(there, front, back, irradiance[receivers], np.where(unknown, np.inf, least))


def starts(path, row, position, normal) -> PathEnds:
    """Return the starts of n paths that estimate irradiance, with views of the arrays given."""
    n = len(path)
    one = np.ones((n, 3)), np.full(n, -1, np.int32), *np.zeros((2, n, 3)), np.zeros(n)
    return PathEnds(path, row, position, normal, *one)


def gather(model: Model, at: Transforms, lights: Lights, seed: int, path, position, normal, light_sampling=True, m=0,
           known: KnownLight = NOTHING_KNOWN):  # fmt: skip
    """Trace paths to their ends; return the estimate of each, (n, 3 G) float64 [W/m2] for `lights` of G lamps.

    path (n,) int64: path numbers, in sets of 2^m (see strata) that begin at one point. position [m] and normal (n, 3)
    float64 of the starts, lifted off the surface. `light_sampling` False finds emissive faces by hits only. An estimate
    depends on its own path alone; the mean of a set has no noise of delta lights at its start. known: of one lamp.
    """
    total = np.zeros((len(path), lights.channels))
    if not light_sampling:
        none = np.zeros(0)
        lights = lights._replace(area=lights.area._replace(cdf=none, density=np.zeros_like(lights.area.density)))

    def work(_, a, b):
        for first in range(a, b, BLOCK):
            s = slice(first, min(first + BLOCK, b))
            ends = starts(path[s].copy(), np.arange(s.stop - first), position[s].copy(), normal[s].copy())
            follow(model, at, lights, seed, m, ends, known, total[s])

    run_ranges(work, len(path), model.threads, GRAIN)
    return total


def follow(
    model: Model, at: Transforms, lights: Lights, seed, m, ends: PathEnds, known: KnownLight, total, vertex=0
) -> None:
    """Trace a batch of paths from vertex `vertex` on; overwrites `ends`."""
    world, n = model.world, len(ends.path)
    far = float(np.float32(FAR * world.size))
    rays = room_for_shadows(n)
    while n:
        join_lights(model, at, lights, seed, m, vertex, ends, rays, total)
        origin, direction = rays.origin[:n], rays.direction[:n]
        scatter(world.bsdfs, seed, m, vertex, ends, origin, direction)
        limits = np.full(n, far, np.float32)
        distance, face = nearest_in_world(model.accelerator, at, origin, direction, limits)
        hits = direction, distance, face
        n = arrive(world, at, lights.area, lights.sky, known, seed, m, vertex, ends, *hits, total)
        ends = PathEnds(*(a[:n] for a in ends))
        vertex += 1


def join_lights(model: Model, at: Transforms, lights: Lights, seed, m, vertex, ends, rays, total) -> None:
    """Add next-event estimates of path vertices to `total` (rows, 3 G): one area light and one delta light each.

    `rays` is a buffer with a row per end, overwritten.
    """
    size, bsdfs = model.world.size, model.world.bsdfs
    far, gap = float(np.float32(FAR * size)), SHADOW_GAP * size
    path = ends.path[:, None]
    if len(lights.delta.kind):
        pick = picks(seed, m, vertex, path, lights.delta)
        together = 1 << m if vertex == 0 else 1  # a set of paths begins at one point
        count = join_delta(bsdfs, pick, 1, ends, lights.delta, far, gap, 0, rays, together)
        add_unblocked(model, at, rays, count, total)
    points = points_on_lamps(seed, m, vertex, path, lights.area)
    add_unblocked(model, at, rays, join_area(bsdfs, points, ends, lights.area, gap, rays), total)


def add_unblocked(model: Model, at: Transforms, rays: Shadows, n: int, total) -> None:
    """Add the values of those of the first n rays that are not blocked to their rows of `total` (rows, 3 G)."""
    if n:
        blocked = occluded_in_world(model.accelerator, at, rays.origin[:n], rays.direction[:n], rays.limit[:n])
        add_lit(rays.row, rays.value, rays.lamp, blocked, total)


def last_kernels_first(model: Model) -> None:
    """Call the kernels of paths from the last one on, for no path: another process begins with the first one."""
    world, at, lights = model.world, model.static, model.lights
    none, points, rays = np.zeros(0, np.int64), np.zeros((0, 3)), room_for_shadows(0)
    ends = starts(none, none, points, points)
    hits = rays.direction, rays.limit, np.zeros(0, np.int32)
    arrive(world, at, lights.area, lights.sky, NOTHING_KNOWN, 0, 0, 0, ends, *hits, points)
    scatter(world.bsdfs, 0, 0, 0, ends, rays.origin, rays.direction)
    add_lit(rays.row, rays.value, rays.lamp, np.zeros(0, bool), points)
    occluded_in_world(model.accelerator, at, rays.origin, rays.direction, rays.limit)


@kernel
def scatter(bsdfs, seed, m, vertex, ends, origin, direction):
    """Write origin [m] and direction (n, 3) of the next ray of each path; update throughput and density."""
    for k in range(len(ends.path)):
        u = strata.uniform(seed, ends.path[k], vertex, SCATTER_U, m)
        v = strata.uniform(seed, ends.path[k], vertex, SCATTER_V, m)
        f = ends.face[k]
        if f < 0:
            x, y, z = lambertian.sample(u, v)
            x, y, z = random_numbers.from_frame(x, y, z, ends.normal[k, 0], ends.normal[k, 1], ends.normal[k, 2])
        else:
            part = strata.uniform(seed, ends.path[k], vertex, PART, m)
            i, n, t = row(ends.arrival, k), row(ends.normal, k), row(ends.tangent, k)
            (x, y, z), weight, p = surface.sampled(bsdfs, f, i, n, t, u, v, part)
            ends.density[k] = p
            ends.throughput[k, 0] *= weight[0]
            ends.throughput[k, 1] *= weight[1]
            ends.throughput[k, 2] *= weight[2]
        direction[k, 0], direction[k, 1], direction[k, 2] = x, y, z
        for c in range(3):
            origin[k, c] = ends.position[k, c]


@kernel
def arrive(world, at, lights, sky, known, seed, m, vertex, ends, direction, distance, face, total):
    """Add emission and sky at the hits; move surviving paths to the front, return their number.

    With pdf cos / pi the mean of pi L is the irradiance, and pi L off a diffuse surface is rho times
    the irradiance there. Throughput is therefore multiplied by rho alone; by f cos / pdf when a glossy vertex scatters.
    """
    n = 0
    for k in range(len(face)):
        path, at_row = ends.path[k], ends.row[k]
        d, f, of = direction[k], face[k], ends.face[k]
        if of >= 0 and ends.density[k] == 0.0:
            continue  # below the surface
        if f < 0:
            if dot(d, sky.up) > 0.0:
                for c in range(3):
                    total[at_row, 3 * sky.lamp + c] += ends.throughput[k, c] * math.pi * sky.radiance[c]
            continue
        normal = rotate(at.rotation[world.face_object[f]], world.normals[f])
        facing = -dot(d, normal)
        if facing > 0.0:  # emission leaves the front
            e = lights.of_face[f]
            if e >= 0:
                p_bounce = ends.density[k] if of >= 0 else lambertian.pdf(max(dot(d, ends.normal[k]), 0.0))
                share = share_of_bounce(p_bounce, facing, distance[k], lights.density[e])
                first = 3 * lights.lamp[e]
                for c in range(3):
                    total[at_row, first + c] += ends.throughput[k, c] * math.pi * lights.radiance[e, c] * share
        elif not world.two_sided[f]:
            continue  # the back of a one-sided face is black
        rho, glossy = world.bsdfs.albedo[f], surface.is_glossy(world.bsdfs, f)
        if not glossy and f < len(known.least) and distance[k] > known.least[f]:
            i = known.corner_front[f] if facing > 0.0 else known.corner_back[f]
            x, t = ends.position[k], float(distance[k])
            there = x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2]
            u, v, w = barycentric(known.points[i[0]], known.points[i[1]], known.points[i[2]], there)
            for c in range(3):
                E = u * known.irradiance[i[0], c] + v * known.irradiance[i[1], c] + w * known.irradiance[i[2], c]
                total[at_row, c] += ends.throughput[k, c] * lambertian.weight(rho[c]) * E
            continue
        largest = max(rho[0], max(rho[1], rho[2]))
        survival = 1.0 if vertex < ROULETTE_FROM and largest > 0.0 else min(largest, MOST_SURVIVAL)
        if survival < 1.0 and not (strata.uniform(seed, path, vertex, SURVIVAL, m) < survival):
            continue
        s = 1.0 if facing > 0.0 else -1.0
        t = float(distance[k])
        ends.path[n], ends.row[n] = path, at_row  # n <= k: overwritten rows have been read
        ends.normal[n, 0], ends.normal[n, 1], ends.normal[n, 2] = s * normal[0], s * normal[1], s * normal[2]
        ends.face[n] = f if glossy else -1
        if glossy:
            along = surface.tangent_of(world.bsdfs, at.rotation[world.face_object[f]], f)
            ends.tangent[n, 0], ends.tangent[n, 1], ends.tangent[n, 2] = along
        for c in range(3):
            ends.position[n, c] = ends.position[k, c] + t * d[c] + ORIGIN_LIFT * world.size * ends.normal[n, c]
            ends.arrival[n, c] = -d[c]
            weight = 1.0 if glossy else lambertian.weight(rho[c])
            ends.throughput[n, c] = ends.throughput[k, c] * (weight / survival)
        n += 1
    return n

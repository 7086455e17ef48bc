"""Next-event estimation: points on lights, and their unoccluded contributions.

The reference, static gathered light and mobiles share this sampler. Points on emissive faces are weighted by the
balance heuristic (Veach 1997) against cosine-sampled bounces, which hit the same faces.

Fixed points on all lights of a scene are the same for all receivers; each brings its light without shadow.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import allocating, inlined, kernel
from gi_core.base.results import digest
from gi_core.base.vec import difference, dot, largest, row
from gi_core.bsdf import lambertian, surface
from gi_core.lights import sun
from gi_core.lights.area import AreaLights, gap_before, point_on_lamp
from gi_core.lights.kinds import SUN, arrived
from gi_core.lights.lamps import DeltaLights, Lights
from gi_core.lights.photometric import density
from gi_core.lights.sky import directions, low_directions
from gi_core.rays.accelerator import GAP

LIGHT_U, LIGHT_V, SMALL_PICK = range(3)  # dimensions of random_numbers.stratified() at each path vertex


class LampPoints(NamedTuple):
    """Points on area lights, P per start of n."""

    face: np.ndarray  # (n, P) int64, emissive face; (n, 0) without area lights
    point: np.ndarray  # (n, P, 3) float64 [m], on the face
    density: np.ndarray  # (n, P) float64 [1/m2], probability density of the point


class Shadows(NamedTuple):
    """Buffers of n shadow rays from path vertices to lights, with their unoccluded contributions."""

    row: np.ndarray  # (n,) int64, start of the path
    origin: np.ndarray  # (n, 3) float32 [m]
    direction: np.ndarray  # (n, 3) float32 unit
    limit: np.ndarray  # (n,) float32 [m], a little short of the light
    value: np.ndarray  # (n, 3) float64 irradiance where the path starts [W/m2]
    lamp: np.ndarray  # (n,) int64
    stratum: np.ndarray  # (n,) int64, of the candidates that a ray stands for; -1: for its own direction alone


def room_for_shadows(n: int) -> Shadows:
    """Return empty buffers for n rays."""
    return Shadows(
        np.empty(n, np.int64),
        np.empty((n, 3), np.float32),
        np.empty((n, 3), np.float32),
        np.empty(n, np.float32),
        np.empty((n, 3)),
        np.empty(n, np.int64),
        np.empty(n, np.int64),
    )


def points_on_lamps(seed: int, m: int, vertex: int, path: np.ndarray, lights: AreaLights) -> LampPoints:
    """Draw points at vertex `vertex` of paths (n, P) int64, stratified in sets of 2^m (see strata)."""
    n, points = path.shape[0], path.shape[1] if len(lights.cdf) else 0
    out = LampPoints(np.empty((n, points), np.int64), np.empty((n, points, 3)), np.empty((n, points)))
    _draw_points(seed, m, vertex, path, lights, *out)
    return out


@kernel
def _draw_points(seed, m, vertex, path, lights, face, point, density):
    for k in range(face.shape[0]):
        for j in range(face.shape[1]):
            u = random_numbers.stratified(seed, path[k, j], vertex, LIGHT_U, m)
            v = random_numbers.stratified(seed, path[k, j], vertex, LIGHT_V, m)
            face[k, j], density[k, j], p = point_on_lamp(lights, u, v)
            point[k, j, 0], point[k, j, 1], point[k, j, 2] = p


def picks(seed: int, m: int, vertex: int, path: np.ndarray, lights: DeltaLights) -> np.ndarray:
    """Return numbers in [0, 1) (s, P, 3) float64 that pick a delta light for each of paths (s, P) int64.

    Two more pick a point on the disc of a directional light. They are (s, 0, 3) without such lights, where P paths
    sample every delta light. Numbers are stratified as points are.
    """
    needed = len(lights.kind) > path.shape[1] or lights.suns > 0
    out = np.empty((len(path), path.shape[1] if needed else 0, 3))
    _pick(seed, m, vertex, path, out)
    return out


def least_set(lights: DeltaLights) -> int:
    """Return log2 of the paths of a set that sample every delta light at their start; 0 for many lights."""
    lamps = len(lights.kind)
    return max(lamps - 1, 0).bit_length() if lamps <= 16 else 0  # sets of more would be long


@kernel
def _pick(seed, m, vertex, path, out):
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[k, j, 0] = random_numbers.stratified(seed, path[k, j], vertex, SMALL_PICK, m)
            out[k, j, 1] = random_numbers.stratified(seed, path[k, j], vertex, LIGHT_U, m)
            out[k, j, 2] = random_numbers.stratified(seed, path[k, j], vertex, LIGHT_V, m)


@kernel
def join_area(bsdfs, points, ends, lights, out):
    """Write shadow rays from n path ends to LampPoints; return their number.

    Ends that face away get no ray. Values [W/m2] of a start sum to P times its irradiance.

    Weighted by the balance heuristic against bounces: E = Le cos cos' / d^2 / (p_light + p_bounce), both densities per
    area. A plain E / p_light has no finite variance where a lamp meets a wall: 1 / d^2 has no bound there.
    """
    count = 0
    for k in range(len(ends.row)):
        position, normal = ends.position[k], ends.normal[k]
        for j in range(points.face.shape[1]):
            e, p = points.face[k, j], points.point[k, j]
            cosine, at_light, way, d2 = _arriving(difference(p, position), normal, lights.normal[e])
            if lights.table[e] >= 0:
                axis, c0 = lights.normal[e], lights.c0[e]
                at_light = math.pi * density(lights.tables, lights.table[e], axis, c0, -way[0], -way[1], -way[2])
            if not (cosine > 0.0 and at_light > 0.0):
                continue
            T, p_bounce = _reflected(bsdfs, ends, k, way), 0.0
            if lights.table[e] < 0:  # no bounce hits a luminaire
                p_bounce = _density(bsdfs, ends, k, way, cosine)
            geometry = cosine * at_light / d2 / (points.density[k, j] + p_bounce * at_light / d2)
            radiance = lights.radiance[e]
            out.value[count, 0] = T[0] * radiance[0] * geometry
            out.value[count, 1] = T[1] * radiance[1] * geometry
            out.value[count, 2] = T[2] * radiance[2] * geometry
            out.lamp[count] = lights.lamp[e]
            aim_at_lamp(ends, k, lights.corners[e], p, out, count)
            count += 1
    return count


@allocating
def join_delta(bsdfs, pick, paths, ends, lights, far, first, out, together):
    """Write shadow rays from n path ends to delta lights, from row `first` on; return the next free row.

    With no more delta lights than paths, each end samples all of them, so their light is exact. Otherwise each path
    picks one by pick (n, paths, 3), in proportion to its unoccluded contribution; starts share pick (1, paths, 3).
    together: ends of a set that are one point; they distribute the lights among themselves, so the light of a set is
    exact. Of a directional light each samples another point of its disc. Values as in join_area().
    """
    lamps, count, own = len(lights.kind), first, len(pick) > 1
    reached, weight = np.empty((lamps, 5)), np.empty(lamps)
    for k in range(len(ends.row)):
        position, normal, total = ends.position[k], ends.normal[k], 0.0
        for e in range(lamps):
            if lights.kind[e] == SUN:
                numbers = pick[k if own else 0, 0]
                way = sun.towards(lights.parameters[e], numbers[1], numbers[2])
                light = sun.arrive_from(way, normal, far)
            else:
                light = arrived(lights.kind[e], lights.parameters[e], lights.tables, position, normal, far)
            reached[e, 0], reached[e, 1], reached[e, 2], reached[e, 3], reached[e, 4] = light
            weight[e] = reached[e, 0] * max(lights.value[e, 0], max(lights.value[e, 1], lights.value[e, 2]))
            total += weight[e]
        if total <= 0.0:
            continue
        if lamps <= paths * together:
            for e in range(lamps):
                share = 1 if lights.kind[e] == SUN else together
                if weight[e] > 0.0 and (ends.path[k] ^ e) & (share - 1) == 0:
                    strength, T = paths * share * reached[e, 0], _reflected(bsdfs, ends, k, reached[e, 1:4])
                    out.lamp[count] = lights.lamp[e]
                    _reach(ends, k, T, lights, e, reached[e], strength, out, count)
                    count += 1
            continue
        for j in range(paths):
            left, chosen = pick[k if own else 0, j, 0] * total, -1
            for e in range(lamps):
                if weight[e] > 0.0:
                    chosen = e  # the last candidate stays if rounding exhausts the sum
                    left -= weight[e]
                    if left < 0.0:
                        break
            strength, T = (
                reached[chosen, 0] * (total / weight[chosen]),
                _reflected(bsdfs, ends, k, reached[chosen, 1:4]),
            )
            out.lamp[count] = lights.lamp[chosen]
            _reach(ends, k, T, lights, chosen, reached[chosen], strength, out, count)
            count += 1
    return count


@kernel
def _reach(ends, k, throughput, lights, e, reached, strength, out, count):
    value = lights.value[e]
    out.value[count, 0] = throughput[0] * value[0] * strength
    out.value[count, 1] = throughput[1] * value[1] * strength
    out.value[count, 2] = throughput[2] * value[2] * strength
    if lights.kind[e] == SUN:
        aim_ray(ends.row[k], lifted(ends, k), reached[1:4], reached[4], out, count)
    else:
        aim_at(ends, k, lights.parameters[e], GAP * largest(lights.parameters[e]), out, count)


@kernel
def add_lit(row, value, lamp, blocked, total):
    """Add the values of unblocked rays to their rows of `total` (n, 3 G), each to the channels of its lamp."""
    for j in range(len(blocked)):
        if not blocked[j]:
            for c in range(3):
                total[row[j], 3 * lamp[j] + c] += value[j, c]


@inlined
def _arriving(way, normal, light_normal):
    """Return both cosines of a lamp point at the offset `way` [m], the unit direction and its squared distance."""
    d2 = dot(way, way)
    d = math.sqrt(d2)
    cosine, at_light = 0.0, 0.0
    if d2 > 0.0:
        way = way[0] / d, way[1] / d, way[2] / d
        cosine, at_light = dot(way, normal), -dot(way, light_normal)
    return cosine, at_light, way, d2


@inlined
def _reflected(bsdfs, ends, k, way):
    """Return the throughput of path end k for light from the unit direction `way`: red, green, blue."""
    T, f = ends.throughput[k], ends.face[k]
    if f < 0:
        r, g, b = T[0], T[1], T[2]
    else:
        r, g, b = surface.value(bsdfs, f, row(ends.arrival, k), way, row(ends.normal, k), row(ends.tangent, k))
        r, g, b = math.pi * r * T[0], math.pi * g * T[1], math.pi * b * T[2]
    return r, g, b


@inlined
def _density(bsdfs, ends, k, way, cosine):
    """Return the density [1/sr] with which a bounce from path end k takes the unit direction `way`."""
    f = ends.face[k]
    if f < 0:
        p = lambertian.pdf(cosine)
    else:
        p = surface.pdf(bsdfs, f, row(ends.arrival, k), way, row(ends.normal, k), row(ends.tangent, k))
    return p


@inlined
def share_of_bounce(p, facing, distance, density):
    """Return the balance weight of a bounce of density p [1/sr] that hits a lamp: p_bounce / (p_light + p_bounce).

    p < 0: a mirror's direction, which light sampling never finds.
    """
    p_bounce = p * facing / max(distance * distance, 1e-30)
    return 1.0 if p < 0.0 else (p_bounce / (p_bounce + density) if p_bounce > 0.0 else 0.0)


@inlined
def lifted(ends, k):
    """Return where rays from path end k start (x, y, z) [m]."""
    x, n, lift = row(ends.position, k), row(ends.normal, k), ends.lift[k]
    return x[0] + lift * n[0], x[1] + lift * n[1], x[2] + lift * n[2]


@kernel
def aim_at_lamp(ends, k, corners, point, out, j):
    """Write ray j, from path end k to a point on a triangle of corners (9,)."""
    aim_at(ends, k, point, gap_before(corners, ends.position[k]), out, j)


@kernel
def aim_at(ends, k, point, gap, out, j):
    """Write ray j, from path end k to a point, short of it by `gap` [m] at least."""
    start = lifted(ends, k)
    way = difference(point, start)
    d = math.sqrt(dot(way, way))
    s = 1.0 / d if d > 0.0 else 0.0
    gap = max(gap, GAP * largest(start))
    aim_ray(ends.row[k], start, (s * way[0], s * way[1], s * way[2]), max(d - gap, 0.0), out, j)


@kernel
def aim_ray(row, position, direction, limit, out, j):
    """Write ray j, from a position."""
    out.row[j], out.limit[j], out.stratum[j] = row, limit, -1
    for c in range(3):
        out.origin[j, c] = position[c]
    out.direction[j, 0], out.direction[j, 1], out.direction[j, 2] = direction[0], direction[1], direction[2]


LIGHT_POINTS = 64  # on area lights, and directions to the disc of a directional light
SKY_DIRECTIONS = 1024  # where little of it arrives, else a quarter: of 64, one or two show through a window
MOST_DELTA = 64  # delta lights: beyond, photons alone measure changes
FACE, DELTA, SKY = range(3)


class LightPoints(NamedTuple):
    """P points on lights, or directions to them."""

    kind: np.ndarray  # (P,) int64
    index: np.ndarray  # (P,) int64, of the area or delta light
    place: np.ndarray  # (P, 3) float64 [m]; of a direction: unit, towards the light
    reach: np.ndarray  # (P,) float64 [m], largest coordinate of the light; inf: `place` is a direction
    value: np.ndarray  # (P, 3) float64: irradiance over that of strength_of()
    lamp: np.ndarray  # (P,) int64
    spread: np.ndarray  # (P,) float64 [m2], squared radius of a disc of the area that a point on a face stands for
    halves: np.ndarray  # (P, 2) float64, weight in the light by each half of the points; 1 in both where one is exact

    @property
    def distant(self) -> np.ndarray:
        """Whether `place` is a direction, (P,) bool."""
        return np.isinf(self.reach)


def light_points(
    lights: Lights, arriving: np.ndarray, seed: int, kinds: Collection[int] = (FACE, DELTA, SKY),
    most: float = MOST_DELTA, sun_points: int = LIGHT_POINTS,
) -> LightPoints | None:  # fmt: skip
    """Return points on the lights of some kinds; None where there are more than `most` delta lights.

    arriving: of `Emitters`; sun_points: 1, or an even number.
    """
    if len(lights.delta.kind) > most:
        return None
    seed = random_numbers.seed_of(random_numbers.Stream.LIGHT_POINTS, seed)
    area, delta, sky = lights.area, lights.delta, lights.sky
    near, suns = np.flatnonzero(~delta.distant), np.flatnonzero(delta.distant)
    reach = np.abs(delta.place[near]).max(axis=1, initial=0.0)
    of_near = delta.value[near], delta.lamp[near], np.zeros(len(near)), np.ones((len(near), 2))
    parts = [(DELTA, near, delta.place[near], reach, *of_near)]
    for e in suns:
        turn = random_numbers.independent(seed, int(e), 0, LIGHT_U)
        place = sun.points(delta.parameters[e], sun_points if delta.parameters[e, 7] < 1.0 else 1, turn)
        n = len(place)
        each, lamp_of = np.tile(delta.value[e] / n, (n, 1)), np.full(n, delta.lamp[e])
        parts.append((DELTA, np.full(n, e), place, np.full(n, np.inf), each, lamp_of, np.zeros(n), _halves(n)))
    share = np.diff(area.cdf, prepend=0.0)
    lamps = np.unique(area.lamp[share > 0]) if FACE in kinds else ()
    count = max(LIGHT_POINTS // max(len(lamps), 1), 8)  # 8 points per lamp with area lights at least
    for lamp in lamps:
        rows = np.flatnonzero((area.lamp == lamp) & (share > 0))
        face, place, each = _on_faces(seed ^ int(lamp), count, area, rows, share[rows])
        reach, lamp_of = np.abs(area.corners[face]).max(axis=1), np.full(count, lamp)
        value, halves = area.radiance[face] * each[:, None], _halves(count)
        parts.append((FACE, face, place, reach, value, lamp_of, each / math.pi, halves))
    if SKY in kinds and sky.radiance.any():
        by_window = arriving[sky.lamp] < 1.0
        count = SKY_DIRECTIONS if by_window else SKY_DIRECTIONS // 4
        lamp_of, reach = np.full(count, sky.lamp), np.full(count, np.inf)
        towards, value = (low_directions if by_window else directions)(sky, _pairs(seed, count))
        index, spread = np.zeros(count, np.int64), np.zeros(count)
        parts.append((SKY, index, towards, reach, value, lamp_of, spread, _halves(count)))
    kind = np.concatenate([np.full(len(part[1]), part[0], np.int64) for part in parts])
    return LightPoints(kind, *(np.concatenate(a) for a in list(zip(*parts, strict=True))[1:]))


def point_keys(points: LightPoints, lights: Lights) -> list[tuple]:
    """Return a key per point: all that strength_of() depends on, and a number among equal ones."""
    area, delta, index, keys = lights.area, lights.delta, points.index, Counter[tuple]()
    near, on_face = (points.kind == DELTA) & ~points.distant, points.kind == FACE
    rows = np.zeros((len(index), 20))
    rows[:, :6] = np.column_stack([points.kind, points.place, points.reach, points.spread])
    rows[near, 6:19] = np.column_stack([delta.kind, delta.parameters])[index[near]]
    rows[on_face, 6:13] = np.column_stack([area.normal, area.c0, area.table])[index[on_face]]
    tables = [digest(area.tables), digest(delta.tables)]
    out = []
    for values, by_area, by_delta in zip(rows, on_face & (rows[:, 12] >= 0), near, strict=True):
        key = values.tobytes(), tables[0] if by_area else tables[1] if by_delta else ""
        out.append((*key, keys[key]))
        keys[key] += 1
    return out


def _halves(count: int) -> np.ndarray:
    """Return the weights (count, 2) of points in halves of a stratified set: runs of half its root in turn, or of 4."""
    first = np.arange(count) >> max(count.bit_length() // 2 - 1, 2) & 1 == 0
    of_each = np.stack([first, ~first], axis=1).astype(float)
    return of_each * (count / of_each.sum(axis=0)) if count > 4 else np.ones((count, 2))


def _on_faces(seed: int, count: int, area: AreaLights, rows: np.ndarray, share: np.ndarray):
    """Return faces, points [m] and the area [m2] that each point stands for, by the shares of some faces."""
    cdf = np.cumsum(share / share.sum())
    cdf[-1:] = 1.0
    subset = area._replace(cdf=cdf, corners=area.corners[rows])
    drawn = points_on_lamps(seed, (count - 1).bit_length(), 0, np.arange(count)[None], subset)
    return rows[drawn.face[0]], drawn.point[0], 1.0 / (count * drawn.density[0])


def _pairs(seed: int, count: int) -> np.ndarray:
    """Return a Hammersley set of pairs in [0, 1), (count, 2)."""
    key, k = np.uint64(random_numbers.hashed(seed, 0, 0, LIGHT_V)), np.arange(count)
    return np.stack([(k + 0.5) / count, [random_numbers.scrambled(np.uint64(i), key) for i in k]], axis=1)


@inlined
def way_to(place, distant, far, start):
    """Return the unit direction from a start to a point on a light, and its distance [m]; 0 at the point itself."""
    if distant:
        return place[0], place[1], place[2], far
    u, v, w = difference(place, start)
    d = math.sqrt(u * u + v * v + w * w)
    scale = 1.0 / d if d > 0.0 else 0.0
    return u * scale, v * scale, w * scale, d


@inlined
def strength_of(points, area, delta, j, far, position, normal, to_point):
    """Return the irradiance of point j over its value, without shadow; to_point: of way_to().

    A point on a face stands for a disc of some area. Nearer than the radius of this disc, light stays as at its rim: it
    would have no bound.
    """
    kind, e, way, d = points.kind[j], points.index[j], (to_point[0], to_point[1], to_point[2]), to_point[3]
    if kind == DELTA and points.reach[j] < np.inf:
        return arrived(delta.kind[e], delta.parameters[e], delta.tables, position, normal, far)[0]
    cosine = dot(way, normal)
    if kind != FACE or cosine <= 0.0 or d <= 0.0:
        return max(cosine, 0.0)
    axis = row(area.normal, e)
    at_light = -dot(way, axis)
    if area.table[e] >= 0:
        at_light = math.pi * density(area.tables, area.table[e], axis, row(area.c0, e), -way[0], -way[1], -way[2])
    return cosine * max(at_light, 0.0) / max(d * d, points.spread[j])

"""Direct light of static receivers, and the part of it that mobiles block.

Points on lights are fixed, the same for all receivers and poses. How much light each brings past the static part is
found once. A frame tests the rays that bring light against mobiles alone, so shadows have no noise of photons.
Receivers lie in groups along a Hilbert curve: one test per group, point and mobile excludes most rays.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gi_core.base import owen_sobol, random_numbers
from gi_core.base.hilbert_curve import hilbert_order
from gi_core.base.jit import allocating, inlined, kernel
from gi_core.base.pace import STEP, Pace
from gi_core.base.threads import run_ranges
from gi_core.base.vec import difference, dot, rotate_back, row
from gi_core.gather.path_tracer import SHADOW_GAP
from gi_core.lights.light_sampling import DIRECTIONAL, AreaLights, Lights
from gi_core.lights.next_event import LIGHT_V, delta_light_at, points_on_lamps
from gi_core.lights.photometric import density
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, ORIGIN_LIFT, Transforms
from gi_core.rays.structures import any_hit, new_ray

STREAM = 0x5D17  # separates these random numbers from others of the same seed
POINTS = 64  # on area lights, and directions to the sky
LEAST_POINTS = 8  # per lamp with area lights
MOST_DELTA = 64  # delta lights: beyond, photons alone measure changes
GROUP = 16  # receivers: the strengths of a point fill a line of the cache
SEE_GRAIN, BLOCK_GRAIN = 4, 32  # groups per thread
FIRST_SECONDS, LEAST, MOST = 2e-4, 16, 1 << 12  # per group before measurements; groups per step
FACE, DELTA, SKY = range(3)


class LightPoints(NamedTuple):
    """P points on lights, or directions to them."""

    kind: np.ndarray  # (P,) int64
    index: np.ndarray  # (P,) int64, of the area or delta light
    place: np.ndarray  # (P, 3) float64 [m]; of a direction: unit, towards the light
    distant: np.ndarray  # (P,) bool: `place` is a direction
    value: np.ndarray  # (P, 3) float64: irradiance over what _strength() returns
    lamp: np.ndarray  # (P,) int64


class Groups(NamedTuple):
    """Groups of GROUP receivers each, successive along a Hilbert curve; the last one has room to spare."""

    receiver: np.ndarray  # (g, GROUP) int64
    position: np.ndarray  # (g, GROUP, 3) float32 [m], lifted off the surface
    normal: np.ndarray  # (g, GROUP, 3) float64 unit; 0 in the room to spare, which gets no light
    strength: np.ndarray  # (g, P, GROUP) float32: irradiance over the value of each point; 0: the static part hides it
    lit: np.ndarray  # (g, P) bool: a point brings light to the group
    centre: np.ndarray  # (g, 3) float64 [m], of a sphere around it
    radius: np.ndarray  # (g,) float64 [m]


class DirectLight:
    """`per_lamp` (n, 3 G) [W/m2] is the direct light of static receivers without mobiles, once `is_known`."""

    def __init__(self, model: Model, seed: int):
        self._model, self._points = model, light_points(model.lights, (int(seed) ^ (STREAM << 40)) & (2**63 - 1))
        self.per_lamp = np.empty((0, model.lights.channels))
        self._groups: Groups | None = None

    def copied(self, model: Model) -> DirectLight:
        """Return the same light for a model of the same static part and lights."""
        other = copy.copy(self)
        other._model = model
        return other

    @property
    def is_known(self) -> bool:
        return self._groups is not None

    def steps(self) -> Iterator[None]:
        """Measure direct light in steps of some 10 ms, once; nothing where no mobile can block it."""
        if self.is_known or self._points is None or self._model.surfaces.objects == 1:
            return
        m, static = self._model, self._model.surfaces.receiver_range(0)
        groups = _groups(*(a[static] for a in m.evaluation_points), ORIGIN_LIFT * m.world.size, len(self._points.kind))
        light, at, pace = np.zeros((static.stop, m.lights.channels)), 0, Pace(FIRST_SECONDS, LEAST, MOST)
        yield
        while at < len(groups.radius):
            count, began = pace.share_of(len(groups.radius) - at, STEP), time.perf_counter()
            self._measure(groups, at, count, light)
            pace.took(count, time.perf_counter() - began)
            at += count
            yield
        self.per_lamp, self._groups = light, groups

    def _measure(self, groups: Groups, at: int, count: int, light: np.ndarray) -> None:
        """Measure the light of `count` groups from `at` on."""
        m = self._model
        given = m.accelerator.scenes, self._points, m.lights.area, m.lights.delta, *_lengths(m), groups

        def work(_, first, last):
            _see(*given, new_ray(), at + first, at + last, light)

        run_ranges(work, count, m.threads, SEE_GRAIN)

    def blocked(self, at: Transforms, levels: np.ndarray) -> np.ndarray:
        """Return the direct light (n, 3) [W/m2] that mobiles block at their poses, at levels (G, 3) of the lamps."""
        m, p, groups = self._model, self._points, self._groups
        out, n = np.zeros((len(self.per_lamp), 3)), len(groups.radius)
        there = np.stack([_in_object(at, o, p) for o in range(len(at.position))])
        value = p.value * levels[p.lamp]
        given = m.accelerator.scenes, m.accelerator.boxes, at, there, p.distant, value, *_lengths(m), groups
        starts = iter(range(0, n, BLOCK_GRAIN))

        def work(*_):
            for first in starts:  # each thread takes the next ones: shadows lie in few
                _block(*given, new_ray(), first, min(first + BLOCK_GRAIN, n), out)

        run_ranges(work, m.threads, m.threads, 1)
        return out


def _lengths(model: Model) -> tuple[float, float]:
    """Return how far [m] a distant light is, and the gap between a ray's end and its light."""
    return float(np.float32(FAR * model.world.size)), SHADOW_GAP * model.world.size


def _in_object(at: Transforms, o: int, points: LightPoints) -> np.ndarray:
    """Return the places (P, 3) of points in the space of object o."""
    return (points.place - np.where(points.distant[:, None], 0.0, at.position[o])) @ at.rotation[o]


def light_points(lights: Lights, seed: int) -> LightPoints | None:
    """Return points on all lights of a scene; None where there are too many delta lights."""
    if len(lights.delta.kind) > MOST_DELTA:
        return None
    area, delta, sky = lights.area, lights.delta, lights.sky
    parts = [(DELTA, np.arange(len(delta.kind)), *_delta_places(delta), delta.value, delta.lamp)]
    share = np.diff(area.cdf, prepend=0.0)
    lamps = np.unique(area.lamp[share > 0])
    count = max(POINTS // max(len(lamps), 1), LEAST_POINTS)
    for lamp in lamps:
        rows = np.flatnonzero((area.lamp == lamp) & (share > 0))
        face, place, each = _on_faces(seed ^ int(lamp), count, area, rows, share[rows])
        near, lamp_of = np.zeros(count, bool), np.full(count, lamp)
        parts.append((FACE, face, place, near, area.radiance[face] * each[:, None], lamp_of))
    if sky.radiance.any():
        towards, each = _to_sky(seed, sky.up), 2 * math.pi / POINTS
        value, lamp_of = np.tile(sky.radiance * each, (POINTS, 1)), np.full(POINTS, sky.lamp)
        parts.append((SKY, np.zeros(POINTS, np.int64), towards, np.ones(POINTS, bool), value, lamp_of))
    kinds = np.concatenate([np.full(len(part[1]), part[0], np.int64) for part in parts])
    index, place, distant, value, lamp = (np.concatenate(a) for a in list(zip(*parts, strict=True))[1:])
    return LightPoints(kinds, index, place, distant, value, lamp)


def _delta_places(delta) -> tuple[np.ndarray, np.ndarray]:
    distant = delta.kind == DIRECTIONAL
    return np.where(distant[:, None], -delta.parameters[:, 3:6], delta.parameters[:, :3]), distant


def _on_faces(seed: int, count: int, area: AreaLights, rows: np.ndarray, share: np.ndarray):
    """Return faces, points [m] and the area [m2] that each point stands for, by the shares of some faces."""
    cdf = np.cumsum(share / share.sum())
    cdf[-1:] = 1.0
    some = area._replace(cdf=cdf, corners=area.corners[rows])
    found = points_on_lamps(seed, (count - 1).bit_length(), 0, np.arange(count)[None], some)
    return rows[found.face[0]], found.point[0], 1.0 / (count * found.density[0])


def _to_sky(seed: int, up: np.ndarray) -> np.ndarray:
    """Return unit directions (POINTS, 3) of equal solid angle above the horizon."""
    key, k = np.uint64(random_numbers.hashed(seed, 0, 0, LIGHT_V)), np.arange(POINTS)
    turn = 2 * math.pi * np.array([owen_sobol.unit(np.uint64(i), key) for i in k])  # a Hammersley set
    z = (k + 0.5) / POINTS
    r = np.sqrt(1 - z * z)
    local = zip(r * np.cos(turn), r * np.sin(turn), z, strict=True)
    return np.array([random_numbers.from_frame(*way, *up) for way in local])


def _groups(position: np.ndarray, normal: np.ndarray, lift: float, points: int) -> Groups:
    """Return groups of receivers (n, 3), without light."""
    n, count = len(position), -(-len(position) // GROUP)
    order = np.resize(hilbert_order(position), count * GROUP)
    place = (position + lift * normal)[order].astype(np.float32).reshape(count, GROUP, 3)
    up = normal[order]
    up[n:] = 0.0
    low, high = place.min(axis=1).astype(np.float64), place.max(axis=1).astype(np.float64)
    centre = (low + high) / 2
    radius = np.sqrt(((place - centre[:, None]) ** 2).sum(axis=2).max(axis=1))
    strength, lit = np.zeros((count, points, GROUP), np.float32), np.zeros((count, points), bool)
    return Groups(order.reshape(-1, GROUP), place, up.reshape(-1, GROUP, 3), strength, lit, centre, radius)


@inlined
def _end(place, distant, far, start):
    """Return where the line from a start to a point on a light ends."""
    if distant:
        return start[0] + far * place[0], start[1] + far * place[1], start[2] + far * place[2]
    return place


@inlined
def _way(place, distant, far, start):
    """Return the unit direction from a start to a point on a light, and its distance [m]; 0 at the point itself."""
    if distant:
        return place[0], place[1], place[2], far
    u, v, w = difference(place, start)
    d = math.sqrt(u * u + v * v + w * w)
    scale = 1.0 / d if d > 0.0 else 0.0
    return u * scale, v * scale, w * scale, d


@inlined
def _strength(points, area, delta, j, far, position, normal, to_point):
    """Return the irradiance of point j over its value, without shadow; to_point: of _way()."""
    kind, e, way, d = points.kind[j], points.index[j], (to_point[0], to_point[1], to_point[2]), to_point[3]
    if kind == DELTA:
        return delta_light_at(delta.kind[e], delta.parameters[e], delta.tables, position, normal, far)[0]
    cosine = dot(way, normal)
    if kind == SKY or cosine <= 0.0 or d <= 0.0:
        return max(cosine, 0.0)
    axis = row(area.normal, e)
    at_light = -dot(way, axis)
    if area.table[e] >= 0:
        at_light = math.pi * density(area.tables, area.table[e], axis, row(area.c0, e), -way[0], -way[1], -way[2])
    return cosine * max(at_light, 0.0) / (d * d)


@kernel
def _see(scenes, points, area, delta, far, gap, groups, ray, first, last, light):
    """Write the strengths and the light of groups first .. last - 1."""
    for g in range(first, last):
        for k in range(GROUP):
            position, normal, r = row(groups.position[g], k), row(groups.normal[g], k), groups.receiver[g, k]
            for j in range(len(points.kind)):
                u, v, w, d = way = _way(row(points.place, j), points.distant[j], far, position)
                strength = np.float32(_strength(points, area, delta, j, far, position, normal, way))
                if strength <= 0.0:
                    continue
                u, v, w, limit = np.float32(u), np.float32(v), np.float32(w), np.float32(max(d - gap, 0.0))
                if any_hit(scenes, 0, ray, position[0], position[1], position[2], u, v, w, limit):
                    continue
                groups.strength[g, j, k], groups.lit[g, j] = strength, True
                for c in range(3):
                    light[r, 3 * points.lamp[j] + c] += strength * points.value[j, c]


@inlined
def _misses(start, end, box, pad):
    """Return whether a segment misses a box (middle, half its size), by separating axes. pad [m]: around the box."""
    middle, half = box
    x, y, z = 0.5 * (end[0] - start[0]), 0.5 * (end[1] - start[1]), 0.5 * (end[2] - start[2])
    u, v, w = start[0] + x - middle[0], start[1] + y - middle[1], start[2] + z - middle[2]
    a, b, c = abs(x), abs(y), abs(z)
    p, q, r = half[0] + pad, half[1] + pad, half[2] + pad
    if abs(u) > p + a or abs(v) > q + b or abs(w) > r + c:
        return True
    if abs(v * z - w * y) > q * c + r * b or abs(w * x - u * z) > r * a + p * c:
        return True
    return abs(u * y - v * x) > p * b + q * a


@allocating
def _block(scenes, boxes, at, there, distant, value, far, gap, groups, ray, first, last, out):
    """Add the light of the points that mobiles block, of groups first .. last - 1.

    there (objects, P, 3): places of the points in the space of each object; value (P, 3): of the points, at the levels.
    """
    objects = len(at.position)
    hidden, local = np.zeros(GROUP, np.bool_), np.empty((objects, GROUP, 3), np.float32)
    middle, half, centre = np.empty((3, objects, 3))
    is_local = np.zeros(objects, np.bool_)
    for o in range(objects):
        for c in range(3):
            middle[o, c], half[o, c] = 0.5 * (boxes[o, 0, c] + boxes[o, 1, c]), 0.5 * (boxes[o, 1, c] - boxes[o, 0, c])
    for g in range(first, last):
        for o in range(1, objects):
            centre[o] = rotate_back(at.rotation[o], difference(row(groups.centre, g), row(at.position, o)))
        is_local[:] = False
        for j in range(len(distant)):
            if not groups.lit[g, j]:
                continue
            strength = groups.strength[g, j]
            hidden[:] = False
            for o in range(1, objects):
                place, start = row(there[o], j), row(centre, o)
                box = row(middle, o), row(half, o)
                if _misses(start, _end(place, distant[j], far, start), box, groups.radius[g]):
                    continue
                if not is_local[o]:
                    _to_local(at, o, groups.position[g], local[o])
                    is_local[o] = True
                for k in range(GROUP):
                    if strength[k] == 0.0 or hidden[k]:
                        continue
                    start = row(local[o], k)
                    if _misses(start, _end(place, distant[j], far, start), box, 0.0):
                        continue
                    u, v, w, d = _way(place, distant[j], far, start)
                    u, v, w, limit = np.float32(u), np.float32(v), np.float32(w), np.float32(max(d - gap, 0.0))
                    if any_hit(scenes, o, ray, start[0], start[1], start[2], u, v, w, limit):
                        hidden[k] = True
                        for c in range(3):
                            out[groups.receiver[g, k], c] += strength[k] * value[j, c]


@inlined
def _to_local(at, o, position, local):
    """Write positions of a group in the space of object o."""
    for k in range(GROUP):
        local[k] = rotate_back(at.rotation[o], difference(row(position, k), row(at.position, o)))

"""Light at places that are no receivers, such as those that a picture's rays meet: parts of it, each by its own rays.

Direct light chooses among sets of points on lights in proportion to the light that each would bring; its rays bring
shadows alone. Bounced light and whole paths are those of `path_tracer.py`. Rays of a pixel that meet one surface share
a site. Light of sites is averaged over those around.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import inlined, kernel
from gi_core.base.nearest_points import hilbert_order
from gi_core.base.random_numbers import Stream, seed_of
from gi_core.base.threads import run_ranges
from gi_core.base.vec import difference, dot, largest, row
from gi_core.bsdf import lambertian
from gi_core.gather.direct_light import limit_of
from gi_core.gather.path_ends import InKnownLight, starts
from gi_core.gather.path_tracer import BLOCK, PathTracer, add_unblocked
from gi_core.geometry.error import luminance
from gi_core.geometry.mesh_neighbours import SAME_WAY
from gi_core.lights.next_event import (
    DELTA,
    FACE,
    LightPoints,
    aim_ray,
    light_points,
    room_for_shadows,
    strength_of,
    way_to,
)
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, LIFT, Transforms
from gi_core.rays.all_objects import nearest_in_world

TILE = 7  # pixels of a square in which each has a set of points of its own (Keller and Heidrich 2001, interleaved)
LIGHT_SETS = TILE**2  # of points on lights: a place has one by its key
SPARSE = 4.0  # radii of the disc that a point on a light stands for: nearer places have ...
NEAR_SETS = 16  # ... so many sets, ...
TOO_NEAR = 3.0  # ... and no points serve places nearer than so many radii of the discs of these
LOG2_SET = 3  # of the paths of a set at a place
OFFSET, WAY = range(2)  # dimensions of random numbers


class Sites(NamedTuple):
    """n places on surfaces where light is asked for, in the space of the model. Rays start at some points of each."""

    start: np.ndarray  # (m, 3) float64 [m], points off the surface, of these places and others
    first: np.ndarray  # (n,) int64, the first point of each place
    count: np.ndarray  # (n,) int64, points of each place: rays take them in turn
    normal: np.ndarray  # (n, 3) float64 unit
    key: np.ndarray  # (n,) int64 >= 0, of random numbers and sets: light does not depend on other places

    def at(self, rows) -> Sites:
        """Return some of the places."""
        return Sites(self.start, *(a[rows] for a in self[1:]))

    def turn(self, k: int) -> np.ndarray:
        """Return point number k (n, 3) of each place, again from the first one after the last."""
        return self.start[self.first + k % self.count]


class PixelLight:
    """Lights and surfaces at poses, prepared for places."""

    def __init__(self, model: Model, at: Transforms, levels: np.ndarray, seed: int):
        """levels (G, 3): of the lamps."""
        self._model, self._at, self._seed = model, at, seed_of(Stream.PIXELS, seed)
        self._lights = model.lights_at(levels)
        of, kinds = (model.lights, model.emitters.arriving), (FACE, DELTA)
        points_of = (light_points(*of, self._seed + k, kinds, math.inf) for k in range(LIGHT_SETS))
        sets = [_along_curve(points) for points in points_of if points is not None]
        points = LightPoints(*(np.concatenate(a) for a in zip(*sets, strict=True)))
        self._points = points._replace(spread=points.spread / NEAR_SETS)
        self._value = self._points.value * levels[self._points.lamp]

    def direct(self, sites: Sites, rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return direct light (n, 3) [W/m2] by at most `rays` shadow rays per place, and its luminance (n,) unblocked.

        The third result (n,) bool: the place is too near to a lamp for points on it. Light of the sky is left out.
        """
        m, points = self._model, self._points
        n = len(sites.key)
        light, whole, near = np.zeros((n, 3)), np.zeros(n), np.zeros(n, bool)
        count, far = len(points.kind) // LIGHT_SETS, float(np.float32(FAR * m.world.size))
        lights, bright = (points, m.lights.area, m.lights.delta, far), luminance(self._value)

        def work(_, a, b):
            block = max(BLOCK // rays, 1)
            shadows = room_for_shadows(block * rays)
            room = np.empty((NEAR_SETS, count)), np.empty(m.lights.lamps, bool)
            for first in range(a, b, block):
                s = slice(first, min(first + block, b))
                choice = self._seed, rays, self._value, bright, room
                lines = _aim_at_points(*lights, sites.at(s), choice, shadows, whole[s], near[s])
                add_unblocked(m, self._at, shadows, lines, light[s])

        run_ranges(work, n, m.threads, 1 << 8)
        return light, whole, near

    def closeness(self, sites: Sites, reach: np.ndarray, rays: int) -> np.ndarray:
        """Return means (n,) of 1 / distance [1/m] over cosine-distributed rays, 0 beyond `reach` (n,) [m]."""
        out = np.empty(len(sites.key))

        def work(_, a, b):
            block = max(BLOCK // rays, 1)
            for first in range(a, b, block):
                s = slice(first, min(first + block, b))
                batch = sites.at(s)
                ways = np.empty((len(batch.key) * rays, 3), np.float32)
                _cosine_ways(self._seed, rays, batch, ways)
                limits = np.repeat(reach[s].astype(np.float32), rays)
                of = self._model.accelerator.opaque
                t, face = nearest_in_world(of, self._at, np.repeat(batch.turn(0), rays, axis=0), ways, limits)
                near = np.where(face >= 0, 1 / np.maximum(t, 1e-6 * limits), 0.0)
                out[s] = near.reshape(-1, rays).mean(axis=1)

        run_ranges(work, len(out), self._model.threads, 1 << 8)
        return out

    def gathered(self, sites: Sites, first: int, sets: int, ending: InKnownLight, bounced: bool) -> np.ndarray:
        """Return the means (sets, n, 3) [W/m2] of sets `first` and following of 2^LOG2_SET paths per place.

        bounced: without light straight from lamps.
        """
        n, count = len(sites.key), 1 << LOG2_SET
        out, tracer = np.zeros((sets, n, 3)), PathTracer(self._model, self._at, self._lights, self._seed, LOG2_SET,
                                                         ending, bounced)  # fmt: skip

        def work(_, a, b):
            block = BLOCK // count
            for k in range(a, b, block):
                batch = sites.at(slice(k, min(k + block, b)))
                path = ((batch.key[:, None] << 16) * count + np.arange(count)).reshape(-1)
                normal = np.repeat(batch.normal, count, axis=0)
                row = np.repeat(np.arange(len(batch.key)), count)
                for j in range(sets):
                    place, none = np.repeat(batch.turn(first + j), count, axis=0), np.zeros(len(row))
                    ends = starts(path + (first + j) * count, row.copy(), place, normal.copy(), none)
                    tracer.follow(ends, out[j, k : k + len(batch.key)])

        run_ranges(work, n, self._model.threads, 1 << 6)
        return out / count


def _along_curve(points: LightPoints) -> LightPoints:
    """Return points in an order along a curve per lamp: every n-th of them covers the lamp evenly."""
    order = np.concatenate([np.flatnonzero(points.kind == DELTA)] + [
        (rows := np.flatnonzero((points.kind == FACE) & (points.lamp == lamp)))[hilbert_order(points.place[rows])]
        for lamp in np.unique(points.lamp[points.kind == FACE])])  # fmt: skip
    return LightPoints(*(a[order] for a in points))


@inlined
def _unblocked(points, area, delta, far, bright, i, position, normal):
    """Return the luminance that point i brings without shadow, and its squared distance over that of its disc."""
    way = way_to(row(points.place, i), points.reach[i] == np.inf, far, position)
    strength = strength_of(points, area, delta, i, far, position, normal, way)
    apart = way[3] * way[3] / points.spread[i] if strength > 0.0 < points.spread[i] else np.inf
    return strength * bright[i], apart


@kernel
def _aim_at_points(points, area, delta, far, sites, choice, out, whole, near):
    """Write rays from places to points on lights, the luminance (n,) of all these, and whether a lamp is too near.

    Return the number of rays. choice: seed, rays per place, values and luminance of points, room for a number of each,
    and for a truth per lamp. Rays follow light along the points in equal steps (systematic sampling). A point that
    brings more light than a step gets one ray from each point of the place.
    """
    seed, rays, value, bright, (room, close) = choice
    count, n = room.shape[1], 0
    for k in range(len(sites.key)):
        normal, middle = row(sites.normal, k), (0.0, 0.0, 0.0)
        for q in range(sites.first[k], sites.first[k] + sites.count[k]):
            share, start = 1.0 / sites.count[k], row(sites.start, q)
            middle = middle[0] + share * start[0], middle[1] + share * start[1], middle[2] + share * start[2]
        chosen = sites.key[k] % LIGHT_SETS
        total, of_suns, sets, base = 0.0, 0.0, 1, chosen * count
        close[:] = False
        for j in range(count):
            room[0, j], apart = _unblocked(points, area, delta, far, bright, base + j, middle, normal)
            if apart < SPARSE * SPARSE * NEAR_SETS:
                sets, close[points.lamp[base + j]] = NEAR_SETS, True
                near[k] |= apart < TOO_NEAR * TOO_NEAR
        for j in range(count):
            if close[points.lamp[base + j]]:
                for s in range(1, sets):
                    i = (chosen + s) % LIGHT_SETS * count + j
                    room[s, j], apart = _unblocked(points, area, delta, far, bright, i, middle, normal)
                    total += room[s, j]
                    near[k] |= apart < TOO_NEAR * TOO_NEAR
            else:
                room[0, j] *= sets  # one set stands for all
            total += room[0, j]
            if points.reach[base + j] == np.inf:
                of_suns += room[0, j]
        whole[k] = total / sets
        if total <= 0.0:
            continue
        # Where suns would bring most and other lamps something, each get half of the rays: suns are mostly hidden.
        less = (total - of_suns) / of_suns if 0.5 * total < of_suns < total else 1.0
        step, passed, taken = (total - of_suns + less * of_suns) / rays, 0.0, 0
        offset = random_numbers.independent(seed, sites.key[k], 0, OFFSET)
        for j in range(count):  # along the curve, the sets abreast
            for s in range(sets if close[points.lamp[chosen * count + j]] else 1):
                chance = less if points.reach[chosen * count + j] == np.inf else 1.0
                passed += chance * room[s, j]
                times = 0
                while taken + times < rays and (taken + times + offset) * step < passed:
                    times += 1
                i, of = (chosen + s) % LIGHT_SETS * count + j, sites.count[k]
                for q in range(min(times, of)):
                    start = row(sites.start, sites.first[k] + (taken + q) % of)
                    share = (times - q + of - 1) // of * step / chance / sets / bright[i]
                    u, v, w, d = way_to(row(points.place, i), points.reach[i] == np.inf, far, start)
                    out.lamp[n] = 0
                    for c in range(3):
                        out.value[n, c] = share * value[i, c]
                    aim_ray(k, start, (u, v, w), limit_of(d, points.reach[i], start), out, n)
                    n += 1
                taken += times
    return n


@kernel
def _cosine_ways(seed, rays, sites, out):
    """Write directions (n rays, 3) from places."""
    for k in range(len(sites.key)):
        n = row(sites.normal, k)
        for j in range(rays):
            u = random_numbers.independent(seed, sites.key[k], j, WAY)
            v = (random_numbers.independent(seed, sites.key[k], 0, WAY + 1) + j / rays) % 1.0
            x, y, z = lambertian.sample(u, v)
            x, y, z = random_numbers.from_frame(x, y, z, n[0], n[1], n[2])
            out[k * rays + j, 0], out[k * rays + j, 1], out[k * rays + j, 2] = x, y, z


# Sites of a picture ---------------------------------------------------------------------------------------------------


@kernel
def start_rays(corners, flat, corner_normals, corner_of, face, u, v, facing, start, normal):
    """Write where rays from n hits start, and shading normals there, (n, 3) float64, on the sides that are seen.

    On a curved surface they start on the tangent planes of the corners (Hanika 2021), else coarse faces would shade
    themselves. corners (F, 3, 3), flat (F, 3) float32; corner_normals (D, 3) float64 unit, corner_of (F, 3) into them.
    """
    for k in range(len(face)):
        f, side = face[k], 1.0 if facing[k] else -1.0
        n = row(flat, f)
        scale = side / max(math.sqrt(dot(n, n)), 1e-30)
        n = n[0] * scale, n[1] * scale, n[2] * scale
        b, c = np.float64(u[k]), np.float64(v[k])
        x, smooth, reach, least = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 1.0
        for j in range(3):
            share = 1.0 - b - c if j == 0 else (b if j == 1 else c)
            p, m = row(corners[f], j), row(corner_normals, corner_of[f, j])
            m = side * m[0], side * m[1], side * m[2]
            least = min(least, dot(m, n))
            reach = max(reach, largest(p))
            x = x[0] + share * p[0], x[1] + share * p[1], x[2] + share * p[2]
            smooth = smooth[0] + share * m[0], smooth[1] + share * m[1], smooth[2] + share * m[2]
        size = math.sqrt(dot(smooth, smooth))
        lift = LIFT * reach
        # A face is flat up to 1e-6 of the cosine; normals steeper than 0.1 over it would shade it.
        if least < 1 - 1e-6 and dot(smooth, n) > 0.1 * size:
            y = x
            for j in range(3):
                share = 1.0 - b - c if j == 0 else (b if j == 1 else c)
                m = row(corner_normals, corner_of[f, j])
                below = share * min(side * dot(difference(y, row(corners[f], j)), m), 0.0) * side
                x = x[0] - below * m[0], x[1] - below * m[1], x[2] - below * m[2]
            normal[k, 0], normal[k, 1], normal[k, 2] = smooth[0] / size, smooth[1] / size, smooth[2] / size
        else:
            normal[k, 0], normal[k, 1], normal[k, 2] = n
        start[k, 0], start[k, 1], start[k, 2] = x[0] + lift * n[0], x[1] + lift * n[1], x[2] + lift * n[2]


@kernel
def group(pixel, start, normal, site, first):
    """Write the site (n,) of each hit, counted from 0, and the first hit (n,) of each site; return their number.

    pixel (n,) int64: ascending; start, normal (n, 3) float64: of hits. Hits of a pixel on one surface share a site.
    """
    count, begin = 0, 0
    for k in range(len(pixel)):
        if k > 0 and pixel[k] != pixel[k - 1]:
            begin = count
        site[k] = count
        for s in range(begin, count):
            if _on_one_surface(start, normal, first[s], k):
                site[k] = s
                break
        if site[k] == count:
            first[count] = k
            count += 1
    return count


@kernel
def _on_one_surface(start, normal, i, k):
    way, n = difference(row(start, k), row(start, i)), row(normal, i)
    if dot(n, row(normal, k)) < SAME_WAY:
        return False
    return abs(dot(way, n)) <= 0.2 * math.sqrt(dot(way, way))  # height over the tangent plane per distance


@kernel
def around(pixels, pixel, start, normal, values, at, width, radius, first, out):
    """Write means (m, c) of values (n, c) of sites `first` and following over those around, on the same surface.

    pixels (h, w): the first site of each pixel, -1: none; pixel (n,): of each site; radius: pixels. Weights fall with
    the distance between coordinates at (n, d) as a Gaussian of variance width (n,) / 2; width 0: the site alone. The
    last column: variances, whose weights are squared.
    """
    h, w = pixels.shape
    last = values.shape[1] - 1
    for k in range(len(out)):
        i = first + k
        y, x = pixel[i] // w, pixel[i] % w
        total = 1.0
        for c in range(last + 1):
            out[k, c] = values[i, c]
        if width[i] <= 0.0:
            continue
        for v in range(max(y - radius, 0), min(y + radius + 1, h)):
            for u in range(max(x - radius, 0), min(x + radius + 1, w)):
                j = pixels[v, u]
                if j < 0 or (u == x and v == y) or not _on_one_surface(start, normal, i, j):
                    continue
                apart = 0.0
                for c in range(at.shape[1]):
                    apart += (at[j, c] - at[i, c]) * (at[j, c] - at[i, c])
                weight = math.exp(-apart / width[i])
                total += weight
                for c in range(last):
                    out[k, c] += weight * values[j, c]
                out[k, last] += weight * weight * values[j, last]
        for c in range(last):
            out[k, c] /= total
        out[k, last] /= total * total


@kernel
def spans(pixels, pixel, start, normal, values, first, out):
    """Write the difference (m,) between extremes of values (n,) at and beside sites, on the same surface."""
    h, w = pixels.shape
    for k in range(len(out)):
        i = first + k
        y, x = pixel[i] // w, pixel[i] % w
        low, high = values[i], values[i]
        for v in range(max(y - 1, 0), min(y + 2, h)):
            for u in range(max(x - 1, 0), min(x + 2, w)):
                j = pixels[v, u]
                if j >= 0 and _on_one_surface(start, normal, i, j):
                    low, high = min(low, values[j]), max(high, values[j])
        out[k] = high - low

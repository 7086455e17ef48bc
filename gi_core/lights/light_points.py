"""Fixed points on all lights of a scene, the same for all receivers, and the light that each brings without shadow."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import inlined
from gi_core.base.vec import difference, dot, row
from gi_core.lights import sun
from gi_core.lights.area import AreaLights
from gi_core.lights.kinds import arrived
from gi_core.lights.lamps import Lights
from gi_core.lights.next_event import LIGHT_U, LIGHT_V, points_on_lamps
from gi_core.lights.photometric import density
from gi_core.lights.sky import directions

LIGHT_POINTS = 64  # on area lights, and directions to an open sky, and to the disc of a directional light
SKY_DIRECTIONS = 1024  # to a sky of which little arrives: of 64, one or two show through a window
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
    parts = [(DELTA, near, delta.place[near], reach, delta.value[near], delta.lamp[near], np.zeros(len(near)))]
    for e in suns:
        turn = random_numbers.independent(seed, int(e), 0, LIGHT_U)
        place = sun.points(delta.parameters[e], sun_points if delta.parameters[e, 7] < 1.0 else 1, turn)
        n = len(place)
        each, lamp_of = np.tile(delta.value[e] / n, (n, 1)), np.full(n, delta.lamp[e])
        parts.append((DELTA, np.full(n, e), place, np.full(n, np.inf), each, lamp_of, np.zeros(n)))
    share = np.diff(area.cdf, prepend=0.0)
    lamps = np.unique(area.lamp[share > 0]) if FACE in kinds else ()
    count = max(LIGHT_POINTS // max(len(lamps), 1), 8)  # 8 points per lamp with area lights at least
    for lamp in lamps:
        rows = np.flatnonzero((area.lamp == lamp) & (share > 0))
        face, place, each = _on_faces(seed ^ int(lamp), count, area, rows, share[rows])
        reach, lamp_of = np.abs(area.corners[face]).max(axis=1), np.full(count, lamp)
        parts.append((FACE, face, place, reach, area.radiance[face] * each[:, None], lamp_of, each / math.pi))
    if SKY in kinds and sky.radiance.any():
        count = SKY_DIRECTIONS if arriving[sky.lamp] < 1.0 else LIGHT_POINTS
        lamp_of, reach = np.full(count, sky.lamp), np.full(count, np.inf)
        towards, value = directions(sky, _pairs(seed, count))
        parts.append((SKY, np.zeros(count, np.int64), towards, reach, value, lamp_of, np.zeros(count)))
    kind = np.concatenate([np.full(len(part[1]), part[0], np.int64) for part in parts])
    return LightPoints(kind, *(np.concatenate(a) for a in list(zip(*parts, strict=True))[1:]))


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

    Nearer to a point on a face than the radius of a disc of the area that it stands for, light stays as there: it
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

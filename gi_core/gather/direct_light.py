"""Direct light of static receivers, and the part of it that mobiles block.

Points on lights are fixed, the same for all receivers and poses. How much light each brings past the static part is
found once. A frame tests the rays that bring light against mobiles alone, so shadows have no noise of photons.
Receivers lie in groups along a Hilbert curve: one test per group, point and mobile excludes most rays. What a mobile
blocks stays known while it rests.
"""

from __future__ import annotations

import copy
import itertools
import time
from collections.abc import Collection, Sequence
from functools import cached_property, partial
from typing import NamedTuple, cast

import numpy as np

from gi_core.base.jit import allocating, inlined, kernel
from gi_core.base.nearest_points import hilbert_order
from gi_core.base.pause import STEP, Pace, pause
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.base.vec import difference, largest, rotate_back, row
from gi_core.gather.denoise import averaged
from gi_core.gather.hit_cache import pose_bits
from gi_core.geometry.error import luminance
from gi_core.lights.lamps import mix
from gi_core.lights.next_event import (
    DELTA,
    FACE,
    LIGHT_POINTS,
    SKY,
    LightPoints,
    light_points,
    point_keys,
    strength_of,
    way_to,
)
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, GAP, LIFT, Transforms
from gi_core.rays.panes import transmitted
from gi_core.rays.structures import new_ray
from gi_core.scene.pose import to_world_at

GROUP = 16  # receivers: the strengths of a point fill a line of the cache
SEE_AT_ONCE = 16  # groups: their strengths before those of 0 are left out


class Groups(NamedTuple):
    """Groups of GROUP receivers each, successive along a Hilbert curve; the last one has room to spare."""

    receiver: np.ndarray  # (g, GROUP) int64
    position: np.ndarray  # (g, GROUP, 3) float32 [m], lifted off the surface
    normal: np.ndarray  # (g, GROUP, 3) float64 unit; 0 in the room to spare, which gets no light
    centre: np.ndarray  # (g, 3) float64 [m], of a sphere around it
    radius: np.ndarray  # (g,) float64 [m]
    # Pairs of a group and a point that brings light to it, by group:
    first: np.ndarray  # (g + 1,) int64, pairs before those of each group
    point: np.ndarray  # (n,) int64
    # (n, GROUP, S) float32: irradiance over the value of the point; 0: the static part hides it. S: 3 channels where
    # panes of the static part have a colour, else 1.
    strength: np.ndarray


Pairs = tuple[np.ndarray, np.ndarray, np.ndarray]  # group (n,), point (n,) int64, strength as of Groups


class Blocked(NamedTuple):
    """Rays that mobiles block, or that their panes dim, one row per mobile."""

    pose: list[bytes]  # of each mobile, b"": unknown
    rays: np.ndarray  # (m, n) uint16 of each pair, a bit per receiver of the group
    any: np.ndarray  # (m, g) bool, the mobile blocks a ray of the group
    glass: np.ndarray  # (m,) int64, row in `passed`, -1: no pane
    passed: np.ndarray  # (p, n, GROUP, 3) float32, share of a blocked ray's light that passes mobiles with panes

    @classmethod
    def unknown(cls, panes: np.ndarray, groups: int, pairs: int) -> Blocked:
        """Return the record before any pose; panes (m,) bool: mobiles with panes."""
        mobiles = len(panes)
        rays, shaded = np.empty((mobiles, pairs), np.uint16), np.empty((mobiles, groups), bool)
        glass = np.where(panes, np.cumsum(panes) - 1, -1).astype(np.int64)
        passed = np.empty((int(panes.sum()), pairs, GROUP, 3), np.float32)
        return cls([b""] * mobiles, rays, shaded, glass, passed)


class Places(NamedTuple):
    """Where direct light is measured."""

    positions: np.ndarray  # (n, 3) float64 [m]
    normals: np.ndarray  # (n, 3) float64 unit
    lifts: np.ndarray  # (n,) float64 [m], how far rays start off them

    @classmethod
    def of_receivers(cls, model: Model) -> Places:
        """Return the evaluation points of static receivers."""
        static = model.surfaces.receiver_range(0)
        return cls(*(a[static] for a in model.evaluation_points), model.lifts)

    @classmethod
    def at_poses(cls, model: Model, at: Transforms) -> Places:
        """Return the evaluation points of all receivers, mobiles at their poses."""
        o = model.surfaces.object_of(np.arange(len(model.object_receivers.areas)))
        R, p = at.rotation[o], at.position[o]
        positions, normals = (to_world_at(R, to, a) for to, a in zip((p, 0 * p), model.evaluation_points, strict=True))
        lifts = LIFT * np.abs(positions).max(axis=1, initial=0.0)
        lifts[: len(model.lifts)] = model.lifts
        return cls(positions, normals, lifts)


class DirectLight:
    """`per_lamp` (n, 3 G) [W/m2] is the direct light of places without mobiles, once `is_known`; of static receivers
    at first.
    """

    def __init__(
        self, model: Model, seed: int, kinds: Collection[int] = (FACE, DELTA, SKY), sun_points: int = LIGHT_POINTS
    ):
        """kinds, sun_points: see `next_event.py`; delta lights always."""
        of = model.lights, model.emitters.arriving
        self._model, self._points = model, light_points(*of, seed, kinds, sun_points=sun_points)
        self._keys = [] if self._points is None else point_keys(self._points, model.lights)
        self._earlier: DirectLight | None = None  # of the same places past the same static part
        self._places: Places | None = None
        self.per_lamp = np.empty((0, model.lights.channels))
        self._groups: Groups | None = None
        self._blocked: Blocked | None = None

    def kept(self) -> DirectLight:
        """Return the same light without a model, to begin others with."""
        other = copy.copy(self)
        other._model, other._blocked, other._earlier = cast(Model, None), None, None
        return other

    def begin_with(self, earlier: DirectLight) -> None:
        """Take over points of a light with the same `Model.static_rays_key`; this one is known where it has all."""
        self._earlier = earlier
        if set(self._keys) <= set(earlier._keys):
            self.measure()

    def resolves(self, positions: np.ndarray | None = None) -> np.ndarray:
        """Return whether positions (n, 3) [m] are far enough from all lights for their points to stand for them.

        None: static receivers.
        """
        if positions is None:
            positions = Places.of_receivers(self._model).positions
        out = np.ones(len(positions), bool)
        on_faces = self._points.spread > 0.0
        for place, spread in zip(self._points.place[on_faces], self._points.spread[on_faces], strict=True):
            away = positions - place
            out &= (away * away).sum(axis=1) >= 9.0 * spread  # three radii of the disc
        return out

    def stands_for(self, lamp: int) -> bool:
        """Return whether the points on a lamp stand for it at all receivers."""
        of_lamp = self._points.lamp == lamp
        return not (self._points.spread[of_lamp] > 0.0).any() or bool(self.resolves().all())

    @property
    def deviation(self) -> np.ndarray:
        """Standard error (n, 3 G) [W/m2] of `per_lamp`, from two halves of the points; see share_error()."""
        p = self._points
        one, other = (self._sum(self._groups, len(self.per_lamp), p.value * half[:, None]) for half in p.halves.T)
        return 0.5**0.25 * 0.5 * np.abs(one - other)

    def _sum(self, groups: Groups, places: int, value: np.ndarray) -> np.ndarray:
        """Return the light (places, 3 G) of points of some value (P, 3)."""
        light, lamp = np.zeros((places, self._model.lights.channels)), self._points.lamp
        work = partial(_sum, groups, value, lamp)
        run_ranges(lambda _, a, b: work(a, b, light), len(groups.radius), self._model.threads, COSTLY)
        return light

    @property
    def by_delta(self) -> np.ndarray:
        """The part (n, 3 G) [W/m2] of `per_lamp` that comes from delta lights."""
        p = self._points
        return self._sum(self._groups, len(self.per_lamp), p.value * (p.kind == DELTA)[:, None])

    def has_delta(self, lamp: int) -> bool:
        """Return whether a lamp has a delta light."""
        return bool((self._points.kind[self._points.lamp == lamp] == DELTA).any())

    @property
    def points_of_lamps(self) -> np.ndarray:
        """Points on each lamp, (G,) int64."""
        return np.bincount(self._points.lamp, minlength=self._model.emitters.lamps.count)

    @property
    def is_known(self) -> bool:
        return self._groups is not None

    @property
    def rays(self) -> int:
        """Rays that measure() traces at most; 0 once it is known."""
        if self.is_known:
            return 0
        earlier = () if self._earlier is None else self._earlier._keys
        return len(set(self._keys).difference(earlier)) * self._model.surfaces.receiver_range(0).stop

    def measured_at(self, places: Places) -> DirectLight:
        """Return the direct light of other places, measured by the same points on lights."""
        other = copy.copy(self)
        other._places, other._groups, other._blocked, other._earlier = places, None, None, None
        other.measure()
        return other

    def measure(self) -> None:
        """Measure direct light, once."""
        if self.is_known or self._points is None:
            return
        places = self._places or Places.of_receivers(self._model)
        groups, at, pace = _groups(*places), 0, Pace(2e-4, 16, 1 << 12)
        taken, unknown = self._taken_over()
        parts = [taken]
        pause()
        while at < len(groups.radius) and len(unknown):
            count, began = pace.share_of(len(groups.radius) - at, STEP), time.perf_counter()
            parts += self._measure(groups, places.positions, at, count, unknown)
            pace.took(count, time.perf_counter() - began)
            at += count
            pause()
        group, point, strength = (np.concatenate(part) for part in zip(*parts, strict=True))
        if len(taken[0]) and len(unknown):
            order = np.lexsort((point, group))
            group, point, strength = group[order], point[order], strength[order]
        first = np.searchsorted(group, np.arange(len(groups.radius) + 1))
        groups = groups._replace(first=first, point=point, strength=strength)
        self.per_lamp = self._sum(groups, len(places.lifts), self._points.value)
        self._groups, self._earlier = groups, None

    def _taken_over(self) -> tuple[Pairs, np.ndarray]:
        """Return pairs of the points that an earlier light has too, and the numbers of those that it lacks."""
        none = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, GROUP, self._channels), np.float32)
        if self._earlier is None or (g := self._earlier._groups) is None:
            return none, np.arange(len(self._keys))
        numbers = {key: j for j, key in enumerate(self._keys)}
        now = np.array([numbers.get(key, -1) for key in self._earlier._keys], np.int64)
        group, point = np.repeat(np.arange(len(g.radius)), np.diff(g.first)), now[g.point]
        kept = point >= 0
        return (group[kept], point[kept], g.strength[kept]), np.setdiff1d(np.arange(len(self._keys)), now)

    @cached_property
    def _channels(self) -> int:
        """Channels of strengths."""
        s = self._model.surfaces
        kinds = np.unique(s.pane[s.face_range(0)])
        return 3 if np.ptp(s.panes[kinds[kinds >= 0], :3], axis=1).any() else 1

    def _measure(self, groups: Groups, places: np.ndarray, at: int, count: int, unknown: np.ndarray) -> list[Pairs]:
        """Return the pairs of `count` groups, from `at` on, with the unknown points."""
        m, points = self._model, LightPoints(*(a[unknown] for a in self._points))

        def see(first, last):
            strength = np.zeros((last - first, len(unknown), GROUP, self._channels), np.float32)
            whole = m.accelerator.scenes, points, m.lights.area, m.lights.delta, _far(m), groups, places, new_ray()
            _see(*whole, first, strength)
            lit = strength.any(axis=(2, 3))
            group, point = np.nonzero(lit)
            return first + group, unknown[point], strength[lit]

        def work(_, first, last):
            return [see(at + k, at + min(k + SEE_AT_ONCE, last)) for k in range(first, last, SEE_AT_ONCE)]

        return list(itertools.chain.from_iterable(run_ranges(work, count, m.threads, 1)))

    def at(self, at: Transforms, levels: np.ndarray) -> np.ndarray:
        """Return the direct light (n, 3) [W/m2] that passes mobiles at their poses, at levels (G, 3) of the lamps."""
        return mix(self.per_lamp, levels) - self.blocked(at, levels)

    def blocked(self, at: Transforms, levels: np.ndarray) -> np.ndarray:
        """Return the direct light (n, 3) [W/m2] that mobiles block at their poses, at levels (G, 3) of the lamps."""
        m, p, groups = self._model, self._points, self._groups
        out, n = np.zeros((len(self.per_lamp), 3)), len(groups.radius)
        if self._blocked is None:
            s = m.surfaces
            panes = np.array([(s.pane[s.face_range(o)] >= 0).any() for o in range(1, len(at.position))], bool)
            self._blocked = Blocked.unknown(panes, n, len(groups.point))
        pose, rays, shaded, glass, passed = self._blocked
        now = [pose_bits(at, k + 1) for k in range(len(pose))]
        moved = [k for k in range(len(pose)) if pose[k] != now[k]]
        if moved:
            for k in moved:
                pose[k] = b""  # until all is found
            self._find_blocked(at, moved, self._blocked)
            for k in moved:
                pose[k] = now[k]
        value = p.value * levels[p.lamp]
        parts = rays, shaded, glass, passed
        run_ranges(lambda _, a, b: _add(groups, *parts, value, a, b, out), n, m.threads, COSTLY)
        return out

    def share_error(self, levels: np.ndarray) -> np.ndarray:
        """Return the standard error (n,) of the share of direct light that mobiles block, as last asked of blocked().

        It comes from the difference between two halves of the points at levels (G, 3) of the lamps, squared and
        averaged over neighbours. An edge cuts the root of the number of strata: errors of N points fall as N^-3/4
        (Mitchell 1996), so that of all is 2^-1/4 of half the difference.
        """
        p, groups, out = self._points, self._groups, np.zeros(len(self.per_lamp))
        value, parts = luminance(p.value * levels[p.lamp])[:, None] * p.halves, self._blocked[1:]

        def compare(_, first, last):
            _compare_halves(groups, *parts, value, first, last, out)

        run_ranges(compare, len(groups.radius), self._model.threads, COSTLY)
        counts = np.zeros(len(out), bool)  # the others have none, nor have most of their neighbours
        counts[groups.receiver[self._blocked.any.any(axis=0)]] = True
        mean = averaged(self._model.adjacency, out * out, counts, self._model.threads)
        return 0.5**0.25 * np.sqrt(mean)

    def _find_blocked(self, at: Transforms, moved: list[int], blocked: Blocked) -> None:
        """Write the rays that the moved mobiles block."""
        m, p, groups = self._model, self._points, self._groups
        points = {k: p._replace(place=_in_object(at, k + 1, p)) for k in moved}

        def work(_, first, last):
            ray = new_ray()
            for k, part in itertools.product(moved, range(first, last)):
                o, of = k + 1, m.accelerator
                # Shadows lie in few groups, close by: each thread takes every n-th.
                row = blocked.glass[k]
                passed = blocked.passed[row] if row >= 0 else blocked.passed[:0].reshape(0, GROUP, 3)
                each = (part, m.threads), blocked.rays[k], blocked.any[k], passed
                _block(of.scenes, of.boxes[o], at, o, points[k], _far(m), groups, ray, *each)

        run_ranges(work, m.threads, m.threads, 1)


def joined(parts: Sequence[DirectLight]) -> DirectLight:
    """Return the direct light of the places of all parts, which share their points on lights, one after another."""
    whole, groups = copy.copy(parts[0]), [part._groups for part in parts]
    whole._places = Places(*map(np.concatenate, zip(*(part._places for part in parts), strict=True)))
    whole.per_lamp, whole._blocked = np.concatenate([part.per_lamp for part in parts]), None
    arrays = {name: np.concatenate([getattr(g, name) for g in groups]) for name in Groups._fields}
    places = np.cumsum([0, *(len(part.per_lamp) for part in parts)])
    pairs = np.cumsum([0, *(len(g.point) for g in groups)])
    arrays["receiver"] = np.concatenate([g.receiver + n for g, n in zip(groups, places, strict=False)])
    arrays["first"] = np.concatenate([[0], *(g.first[1:] + n for g, n in zip(groups, pairs, strict=False))])
    whole._groups = Groups(**arrays)
    return whole


def _far(model: Model) -> float:
    """Return how far [m] a distant light is."""
    return float(np.float32(FAR * model.world.size))


def _in_object(at: Transforms, o: int, points: LightPoints) -> np.ndarray:
    """Return the places (P, 3) of points in the space of object o."""
    return (points.place - np.where(points.distant[:, None], 0.0, at.position[o])) @ at.rotation[o]


def _groups(position: np.ndarray, normal: np.ndarray, lift: np.ndarray) -> Groups:
    """Return groups of receivers (n, 3), without light; lift (n,) [m]: of rays off the surface."""
    n, count = len(position), -(-len(position) // GROUP)
    order = np.resize(hilbert_order(position), count * GROUP)
    place = (position + lift[:, None] * normal)[order].astype(np.float32).reshape(count, GROUP, 3)
    up = normal[order]
    up[n:] = 0.0
    low, high = place.min(axis=1).astype(np.float64), place.max(axis=1).astype(np.float64)
    centre = (low + high) / 2
    radius = np.sqrt(((place - centre[:, None]) ** 2).sum(axis=2).max(axis=1))
    dark = np.zeros(count + 1, np.int64), np.zeros(0, np.int64), np.zeros((0, GROUP, 1), np.float32)
    return Groups(order.reshape(-1, GROUP), place, up.reshape(-1, GROUP, 3), centre, radius, *dark)


@inlined
def _end(place, distant, far, start):
    """Return where the line from a start to a point on a light ends."""
    if distant:
        return start[0] + far * place[0], start[1] + far * place[1], start[2] + far * place[2]
    return place


@inlined
def limit_of(distance, reach, position):
    """Return the length of a ray from a receiver at `position` to a point on a light, float32 [m]; see LightPoints."""
    gap = GAP * max(reach, largest(position)) if reach < np.inf else 0.0
    return np.float32(max(distance - gap, 0.0))


@kernel
def _see(scenes, points, area, delta, far, groups, places, ray, first, out):
    """Write strengths (m, P, GROUP, S) of m groups from `first` on, of receivers at places (n, 3) [m]."""
    for g in range(first, first + len(out)):
        for k in range(GROUP):
            position, normal = row(groups.position[g], k), row(groups.normal[g], k)
            place = row(places, groups.receiver[g, k])
            for j in range(len(points.kind)):
                way = way_to(row(points.place, j), points.reach[j] == np.inf, far, place)
                strength = np.float32(strength_of(points, area, delta, j, far, place, normal, way))
                if strength <= 0.0:
                    continue
                u, v, w, d = way_to(row(points.place, j), points.reach[j] == np.inf, far, position)
                u, v, w, limit = np.float32(u), np.float32(v), np.float32(w), limit_of(d, points.reach[j], position)
                shares = transmitted(scenes, 0, ray, position[0], position[1], position[2], u, v, w, limit)
                if shares[0] + shares[1] + shares[2] <= 0.0:
                    continue
                share = np.float32(shares[0]), np.float32(shares[1]), np.float32(shares[2])
                for c in range(out.shape[3]):
                    out[g - first, j, k, c] = strength * share[c]


@kernel
def _sum(groups, value, lamp, first, last, light):
    """Add the light (n, 3 G) of points of some value (P, 3) and lamp (P,) at groups first .. last - 1."""
    last_channel = groups.strength.shape[2] - 1
    for g in range(first, last):
        for i in range(groups.first[g], groups.first[g + 1]):
            j = groups.point[i]
            for k in range(GROUP):
                if groups.strength[i, k].any():
                    for c in range(3):
                        brought = groups.strength[i, k, min(c, last_channel)] * value[j, c]
                        light[groups.receiver[g, k], 3 * lamp[j] + c] += brought


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
def _block(scenes, box, at, o, points, far, groups, ray, turn, rays, shaded, passed):
    """Write the rays (n,) that mobile o blocks, and where it does (g,), of each n-th group; turn: the first one, and n.

    passed (n, GROUP, 3): their light that its panes let pass; (0, GROUP, 3): it has none.
    box (2, 3): of the mobile; points: LightPoints, both in its space.
    """
    local, middle, half = np.empty((GROUP, 3), np.float32), np.empty(3), np.empty(3)
    for c in range(3):
        middle[c], half[c] = 0.5 * (box[0, c] + box[1, c]), 0.5 * (box[1, c] - box[0, c])
    around = (middle[0], middle[1], middle[2]), (half[0], half[1], half[2])
    for g in range(turn[0], len(shaded), turn[1]):
        centre = rotate_back(at.rotation[o], difference(row(groups.centre, g), row(at.position, o)))
        is_local, shaded[g] = False, False
        for i in range(groups.first[g], groups.first[g + 1]):
            rays[i], j = 0, groups.point[i]
            place, distant = row(points.place, j), points.reach[j] == np.inf
            if _misses(centre, _end(place, distant, far, centre), around, groups.radius[g]):
                continue
            if not is_local:
                _to_local(at, o, groups.position[g], local)
                is_local = True
            hidden = 0
            for k in range(GROUP):
                if not groups.strength[i, k].any():
                    continue
                start = row(local, k)
                if _misses(start, _end(place, distant, far, start), around, 0.0):
                    continue
                u, v, w, d = way_to(place, distant, far, start)
                u, v, w = np.float32(u), np.float32(v), np.float32(w)
                limit = limit_of(d, points.reach[j], row(groups.position[g], k))
                red, green, blue = transmitted(scenes, o, ray, start[0], start[1], start[2], u, v, w, limit)
                if red + green + blue < 3.0:
                    hidden |= 1 << k
                    if len(passed) > 0:
                        passed[i, k, 0], passed[i, k, 1], passed[i, k, 2] = red, green, blue
            if hidden:
                rays[i], shaded[g] = hidden, True


@kernel
def _add(groups, rays, shaded, glass, passed, value, first, last, out):
    """Add the light of the points that mobiles block, of groups first .. last - 1; value (P, 3): of the points."""
    last_channel = groups.strength.shape[2] - 1
    for g in range(first, last):
        if not shaded[:, g].any():
            continue
        for i in range(groups.first[g], groups.first[g + 1]):
            hidden, j = 0, groups.point[i]
            for o in range(len(shaded)):
                if shaded[o, g]:
                    hidden |= rays[o, i]
            k = 0
            while hidden:
                if hidden & 1:
                    for c in range(3):
                        light = groups.strength[i, k, min(c, last_channel)] * value[j, c]
                        out[groups.receiver[g, k], c] += light
                        if len(passed) > 0:
                            out[groups.receiver[g, k], c] -= light * _left(rays, shaded, glass, passed, g, i, k, c)
                hidden >>= 1
                k += 1


@allocating
def _compare_halves(groups, rays, shaded, glass, passed, value, first, last, out):
    """Write half the differences of shares in groups first .. last - 1; value (P, 2): of the points, by halves."""
    light, lost = np.empty((GROUP, 2)), np.empty((GROUP, 2))
    for g in range(first, last):
        if not shaded[:, g].any():
            continue
        light[:], lost[:] = 0.0, 0.0
        for i in range(groups.first[g], groups.first[g + 1]):
            hidden, j = 0, groups.point[i]
            for o in range(len(shaded)):
                if shaded[o, g]:
                    hidden |= rays[o, i]
            for k, h in np.ndindex(GROUP, 2):
                brought = groups.strength[i, k, 0] * value[j, h]
                light[k, h] += brought
                if hidden >> k & 1:
                    left = _left(rays, shaded, glass, passed, g, i, k, 0) if len(passed) > 0 else 0.0
                    lost[k, h] += brought * (1.0 - left)
        for k in range(GROUP):
            a = lost[k, 0] / light[k, 0] if light[k, 0] > 0.0 else 0.0
            b = lost[k, 1] / light[k, 1] if light[k, 1] > 0.0 else 0.0
            out[groups.receiver[g, k]] = 0.5 * abs(a - b)


@kernel
def _left(rays, shaded, glass, passed, g, i, k, c):
    """Return the share of channel c of pair i's light that passes all mobiles on its way to receiver k of group g."""
    left = 1.0
    for o in range(len(shaded)):
        if shaded[o, g] and rays[o, i] >> k & 1:
            left *= passed[glass[o], i, k, c] if glass[o] >= 0 else 0.0
    return left


@inlined
def _to_local(at, o, position, local):
    """Write positions of a group in the space of object o."""
    for k in range(GROUP):
        local[k] = rotate_back(at.rotation[o], difference(row(position, k), row(at.position, o)))

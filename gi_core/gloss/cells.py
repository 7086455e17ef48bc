"""Directions of light at the receivers of glossy faces: integer moments in a fixed hierarchy of cells.

Report 2.10 stores the rays that reach a glossy vertex, and 2.10.1 summarises them in a QuadTree, whose list "gets
degraded after repeated insertion and deletion". Here a cell holds integer sums of its rays: flux per channel, and flux
times direction. Inserting and removing a ray cancel exactly, so no history degrades them.

Cells describe how light is distributed over directions; its irradiance comes from the frame, so gloss shares the
estimator, gathered light and artifact control of the diffuse part. Rays are the segments that cross the receiver's
disc, with any estimator. A frame takes its rays in the order of receivers, and computes only the cells that they reach.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import basis
from gi_core.base.threads import run_ranges
from gi_core.gloss.discs import GlossDiscs
from gi_core.gloss.hemisphere import CELLS, cell_of, even_light
from gi_core.gloss.radiance import GRAZING, Directions
from gi_core.gloss.rays import RayTree
from gi_core.photons.paths import PathVertices, Segments, segments_of
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange

FIELDS = 6  # of a cell, see GlossLight
SUMS = 7  # of a cell: flux of three channels, weight times direction (x, y, z) in the object's space, and weight
FLUX_SHIFT = 12  # bits of flux left out of moments ...
DIRECTION_BITS = 14  # ... and bits of a direction: 2^36.2 at most per ray, 2^26 rays in 63 bits
RAY = 8  # numbers of a ray, see _weigh()
PART = 8192  # photons added at a time
GRAIN = 256  # receivers per thread
MOST_PHOTONS = 1 << 20  # in the sums: a fourth of them leaves twice the error, decision 34


class GlossLight(NamedTuple):
    """Directional light of a frame at n glossy receivers, held by m of them. The arrays are never written to again.

    A cell holds the share of irradiance that arrives through it, per channel, and the mean direction towards that light
    in the object's space: (red, green, blue, x, y, z). The mean is shorter than 1 where directions spread. Rays weigh
    flux / sqrt(cos), between irradiance and radiance.
    """

    rows: np.ndarray  # (n,) int64, receivers, ascending
    owners: np.ndarray  # (m,) int64, receivers whose cells these are, ascending
    place: np.ndarray  # (n,) int32 into owners
    resting: np.ndarray  # (m, CELLS, 6) float32, without mobiles; no light on mobiles, even light where probes show it
    changed: np.ndarray  # (k,) int64 into owners, ascending
    cells: np.ndarray  # (k, CELLS, 6) float32, in place of `resting`
    tree: RayTree | None = None  # the rays one by one, see `gi_core.gloss.rays`; None: cells alone
    opened: float = 0.0  # see Directions

    def directions(self) -> Directions:
        """Return the light of all receivers."""
        cells, tree = self.resting.copy(), self.tree
        cells[self.changed] = self.cells
        if tree is None:
            return Directions(cells, np.zeros(1, np.int64), np.empty((0, FIELDS), np.float32), 0.0, self.place)
        return Directions(cells, tree.offsets, tree.rays, self.opened, self.place)


def settled(light: GlossLight, place: np.ndarray, cells: np.ndarray) -> GlossLight:
    """Return the light with other cells (n, CELLS, 6) of owners place (n,), ascending."""
    other = np.flatnonzero(~np.isin(light.changed, place))
    changed = np.concatenate([light.changed[other], place])
    order = np.argsort(changed)
    return light._replace(changed=changed[order], cells=np.concatenate([light.cells[other], cells])[order])


def as_light(sums: np.ndarray) -> np.ndarray:
    """Return cells (n, CELLS, 6) float32, as of a GlossLight, of gathered sums (n, CELLS, SUMS), see `GlossGather`."""
    scaled = sums * np.array([1.0] * 3 + [1 << DIRECTION_BITS] * 3 + [1.0])
    out = np.zeros((len(sums), CELLS, FIELDS), np.float32)
    _rest(scaled, np.arange(len(sums)), out, np.empty((len(sums), 3)))
    return out


class _Arrivals(NamedTuple):
    """Rays of segments at an object's receivers, in the order of receivers."""

    rows: np.ndarray  # (k,) int64, receivers that rays reach, ascending
    first: np.ndarray  # (k + 1,) int64 into `line`, first ray of each
    line: np.ndarray  # (m,) int32 into the next two
    rays: np.ndarray  # (S, RAY) int64, see _weigh()
    direction: np.ndarray  # (S, 3) float32, of the segments, in the object's space


class _Rest(NamedTuple):
    """Light without mobiles."""

    of: np.ndarray | None  # the gathered light, None: of photons
    sums: (
        np.ndarray
    )  # (static rows, CELLS, SUMS) float64 of gathered light in units of the photons' sums; else (0, ...)
    totals: np.ndarray  # (static rows, 3), of the cells
    light: np.ndarray  # (n, CELLS, FIELDS), see GlossLight.resting
    photons: int = 0  # of these units


class GlossCells:
    """Sums of a scene's glossy receivers. Not thread safe."""

    def __init__(self, discs: GlossDiscs, glossy: np.ndarray, owners: np.ndarray, place: np.ndarray):
        """discs: of the owners that have cells, others have even light; glossy (n,): all glossy receivers, ascending.

        owners (m,), ascending, and place (n,): see GlossLight.
        """
        self.discs, self.rows, self.owners, self.place, static = discs, glossy, owners, place, discs.count(0)
        self._place = np.searchsorted(owners, discs.rows)
        self._sums = np.zeros((static, CELLS, SUMS), np.int64)
        self._totals = np.zeros((static, 3))  # of the cells, without mobiles
        self._resting = self._unlit()
        self._gathered: _Rest | None = None
        self._store: object = None  # of the photons in the sums
        self._weights = np.ones((discs.model.emitters.lamps.count, 3))
        self.photons = self._rested = 0  # in the sums, and in `_resting`

    def _unlit(self) -> np.ndarray:
        """Return the light (m, CELLS, 6) of all owners before any ray: none where there are cells."""
        out = np.empty((len(self.owners), CELLS, FIELDS), np.float32)
        _turn(even_light(), self.discs.model.object_receivers.normals[self.owners], out)
        out[self._place, :, :3] = 0.0
        return out

    def bring_in(self, store: object, paths: PathVertices, weights: np.ndarray) -> Iterator[None]:
        """Add the photons of `paths` that are not yet in the sums, in steps; weights (G, 3): of the lamps' flux.

        store: identifies the photons. The sums begin anew when it or the weights differ from the last call.
        """
        if store is not self._store or not np.array_equal(weights, self._weights):
            self._store, self._weights, self.photons, self._rested = store, weights.copy(), 0, 0
            self._sums[:] = 0
        count, model = min(len(paths.offsets) - 1, MOST_PHOTONS), self.discs.model
        while self.photons < count:
            last = min(self.photons + PART, count)
            self._deposit([(1, segments_of(paths, model.eps, self.photons, last))], model.static, self._sums)
            self.photons = last
            yield
        if self._rested != self.photons:
            resting = self._unlit()
            _rest(self._sums, self._place, resting, self._totals)
            self._resting, self._rested = resting, self.photons

    def _base(self, gathered: np.ndarray | None) -> _Rest:
        """Return the light without mobiles: of photons, or gathered (static rows, CELLS, SUMS), see `GlossGather`."""
        if gathered is None:
            return _Rest(None, np.empty((0, CELLS, SUMS)), self._totals, self._resting)
        if self._gathered is None or self._gathered.of is not gathered or self._gathered.photons != self.photons:
            unit = self.discs.model.emitters.unit_flux / max(self.photons, 1) / (math.pi * self.discs.radius**2)
            weight = 1.0 / (unit * (1 << FLUX_SHIFT))
            sums = gathered * np.array([1 / unit] * 3 + [weight * (1 << DIRECTION_BITS)] * 3 + [weight])
            totals, light = np.empty_like(self._totals), self._unlit()
            _rest(sums, self._place, light, totals)
            self._gathered = _Rest(gathered, sums, totals, light, self.photons)
        return self._gathered

    def evaluate(self, change: PoseChange, gathered: np.ndarray | None = None) -> GlossLight:
        """Return the light of a frame's poses. Its photons may be fewer or more than those in the sums.

        gathered (static rows, CELLS, SUMS): light without mobiles by paths, in place of photons; see `GlossGather`.
        Mobiles then take the share of a cell's light that they take of its photons: a difference would leave the
        noise of photons in shadows.
        """
        scale, normals = self.photons / max(change.photons, 1), self.discs.normals_of
        base = self._base(gathered)
        parts = [self._changes(change), *([(1, segments)] for segments in change.near_mobiles)]
        arrivals = [self._arrivals(o, rays, change.at) for o, rays in enumerate(parts)]
        places = [self._place[self.discs.first[o] : self.discs.first[o + 1]] for o in range(len(parts))]
        rows = np.concatenate([place[a.rows] for place, a in zip(places, arrivals, strict=True)])
        cells, begin = np.empty((len(rows), CELLS, FIELDS), np.float32), 0
        for o, (place, a) in enumerate(zip(places, arrivals, strict=True)):
            # Mobiles have no light at rest.
            rest = self._sums if o == 0 else self._sums[:0], base.sums, base.totals, place, base.light
            out = cells[begin : begin + len(a.rows)]
            begin += len(a.rows)

            def work(_, first, last, o=o, a=a, rest=rest, out=out):
                zeros, now = np.zeros((2, CELLS, SUMS), np.int64), np.empty((CELLS, SUMS))
                room = zeros[0], zeros[1], now, np.empty(CELLS, np.int64)
                _evaluate(a, first, last, normals(o), *rest, scale if o == 0 else 1.0, *room, out)

            run_ranges(work, len(a.rows), self.discs.model.threads, GRAIN)
        return GlossLight(self.rows, self.owners, self.place, base.light, rows, cells)

    def _changes(self, change: PoseChange) -> list[tuple[int, Segments]]:
        return [(-1, change.removed_suffixes.segments(self.discs.model.threads)), (1, change.new_suffixes)]

    def current_sums(self, change: PoseChange) -> np.ndarray:
        """Return the sums (static rows, CELLS, SUMS) int64 of a frame of as many photons as are in the sums."""
        out = self._sums.copy()
        self._deposit(self._changes(change), change.at, out)
        return out

    def from_scratch(self, parts: Iterable[Segments], at: Transforms) -> np.ndarray:
        """Return the sums (static rows, CELLS, SUMS) int64 from all current segments: those of current_sums()."""
        out = np.zeros_like(self._sums)
        self._deposit([(1, segments) for segments in parts], at, out)
        return out

    def _deposit(self, parts: list[tuple[int, Segments]], at: Transforms, sums: np.ndarray) -> None:
        """Add the rays of segments, times their sign, to the cells of the static part's receivers."""
        a = self._arrivals(0, parts, at)

        def work(_, begin, end):
            _deposit(a, begin, end, self.discs.normals_of(0), sums)

        run_ranges(work, len(a.rows), self.discs.model.threads, GRAIN)

    def _arrivals(self, o: int, parts: list[tuple[int, Segments]], at: Transforms) -> _Arrivals:
        """Return the rays of segments, each part with its sign, at object o's receivers."""
        found = [(sign, c) for sign, segments in parts for c in self.discs.crossed(o, segments, at)]
        n, sizes = self.discs.count(o), [len(c.lines.low) for _, c in found]
        rays, receiver = np.empty((sum(sizes), RAY), np.int64), [np.empty(0, np.int32)]
        direction, lines = [np.empty((0, 3), np.float32)], [np.empty(0, np.int32)]
        for (sign, c), last in zip(found, np.cumsum(sizes), strict=True):
            first = int(last) - len(c.lines.low)
            _weigh(c.lines.direction, c.lines.flux, c.lines.lamp, self._weights, sign, rays[first:last])
            receiver.append(c.receiver)
            direction.append(c.lines.direction)
            lines.append(c.line + np.int32(first))
        at_receiver, along = np.concatenate(receiver), np.concatenate(lines)
        counts = np.bincount(at_receiver, minlength=n)
        cursor, ordered = np.cumsum(counts) - counts, np.empty_like(along)
        rows = np.flatnonzero(counts)
        starts = np.append(cursor[rows], len(along))
        _order(at_receiver, along, cursor, ordered)
        return _Arrivals(rows, starts, ordered, rays, np.concatenate(direction))


@kernel
def _turn(even, normals, out):
    """Write even light (CELLS, 6) around normals (n, 3) to out (n, CELLS, 6)."""
    for i in range(len(normals)):
        n = normals[i]
        ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
        for c in range(CELLS):
            e = even[c]
            out[i, c, 0], out[i, c, 1], out[i, c, 2] = e[0], e[1], e[2]
            out[i, c, 3] = e[3] * ax + e[4] * bx + e[5] * n[0]
            out[i, c, 4] = e[3] * ay + e[4] * by + e[5] * n[1]
            out[i, c, 5] = e[3] * az + e[4] * bz + e[5] * n[2]


@kernel
def _weigh(direction, flux, lamp, weights, sign, out):
    """Write rays (S, RAY): sign x flux per channel, direction towards the light, weight before its cosine, sign."""
    for k in range(len(out)):
        total = np.int64(0)
        for c in range(3):
            q = np.int64(flux[k, c] * weights[lamp[k], c] + 0.5)
            total += q
            out[k, c] = sign * q
            out[k, 3 + c] = np.int64(math.floor(0.5 - float(direction[k, c]) * (1 << DIRECTION_BITS)))
        out[k, 6], out[k, 7] = total >> FLUX_SHIFT, sign


@kernel
def _order(receiver, line, cursor, out):
    """Write lines in the order of receivers; cursor (n,): place of the first of each, advanced."""
    for j in range(len(receiver)):
        out[cursor[receiver[j]]] = line[j]
        cursor[receiver[j]] += 1


@kernel
def _add(arrivals, j, n, to, gone):
    """Add the rays at row j, a receiver of normal n, to its cells (CELLS, SUMS); return the cells reached as bits.

    Removed rays are subtracted from `gone` (CELLS, SUMS), which may be `to`.
    """
    ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
    reached = np.uint64(0)
    for e in range(arrivals.first[j], arrivals.first[j + 1]):
        k = arrivals.line[e]
        d, ray = arrivals.direction[k], arrivals.rays[k]
        x, y, z = -float(d[0]), -float(d[1]), -float(d[2])
        w = x * n[0] + y * n[1] + z * n[2]
        cell = cell_of(x * ax + y * ay + z * az, x * bx + y * by + z * bz, w)
        weight = ray[7] * np.int64(ray[6] / math.sqrt(max(w, GRAZING)) + 0.5)
        out = to[cell] if ray[7] > 0 else gone[cell]
        for c in range(3):
            out[c] += ray[c]
            out[3 + c] += weight * ray[3 + c]
        out[6] += weight
        reached |= np.uint64(1) << np.uint64(cell)
    return reached


@kernel
def _deposit(arrivals, first, last, normals, sums):
    """Add the rays at receivers, rows first .. last - 1, to their sums."""
    for j in range(first, last):
        i = arrivals.rows[j]
        _add(arrivals, j, normals[i], sums[i], sums[i])


@kernel
def _mean(x, y, z, weight, out):
    """Write the mean direction of a cell's sums, if there is any light."""
    size = math.sqrt(x * x + y * y + z * z)
    if size > 0.0:
        size = max(size, weight * (1 << DIRECTION_BITS))
        out[3], out[4], out[5] = x / size, y / size, z / size


@kernel
def _rest(sums, place, out, totals):
    """Write shares and mean directions of sums (n, CELLS, SUMS) to rows place (n,) of out, and totals (n, 3)."""
    for i in range(len(sums)):
        of, to = sums[i], out[place[i]]
        for k in range(3):
            total = 0.0
            for c in range(CELLS):
                total += of[c, k]
            for c in range(CELLS):
                to[c, k] = of[c, k] / total if total > 0.0 else 0.0
            totals[i, k] = total
        for c in range(CELLS):
            _mean(float(of[c, 3]), float(of[c, 4]), float(of[c, 5]), float(of[c, 6]), to[c])


@kernel
def _before(sums, better, lit, i, c, k):
    """Return number k of cell c of receiver i without mobiles."""
    if not lit:
        return 0.0
    return better[i, c, k] if len(better) else float(sums[i, c, k])


@kernel
def _now(sums, better, lit, i, c, k, scale, added, gone):
    """Return number k of cell c of receiver i at a frame's poses."""
    if not (lit and len(better)):
        return scale * (added[c, k] + gone[c, k]) + _before(sums, better, lit, i, c, k)
    of = k if k < 3 else 6  # directions lose the share that their weight does
    left = 1.0 + scale * gone[c, of] / sums[i, c, of] if sums[i, c, of] > 0 else 1.0
    return max(0.0, left) * better[i, c, k] + scale * added[c, k]


@kernel
def _evaluate(
    arrivals, first, last, normals, sums, better, totals, place, resting, scale, added, gone, now, listed, out
):
    """Write shares and mean directions of receivers, rows first .. last - 1, to rows of out (k, CELLS, 6).

    sums: of photons, without these rays, which count `scale` times; no sums: zeros. better, totals: sums of the light
    at rest, and of its cells; no `better`: photons. Scratch memory: added and gone (CELLS, SUMS), zeros before and
    after; now (CELLS, SUMS), listed (CELLS,).
    """
    for j in range(first, last):
        i = arrivals.rows[j]
        lit, rest, to, n = i < len(sums), resting[place[i]], out[j], 0
        reached = _add(arrivals, j, normals[i], added, gone)
        for c in range(CELLS):
            if (reached >> np.uint64(c)) & np.uint64(1):
                listed[n] = c
                n += 1
        red, green, blue = (totals[i, 0], totals[i, 1], totals[i, 2]) if lit else (0.0, 0.0, 0.0)
        r, g, b = red, green, blue
        for m in range(n):
            c = listed[m]
            for k in range(SUMS):
                now[c, k] = _now(sums, better, lit, i, c, k, scale, added, gone)
            for k in range(SUMS):
                added[c, k] = gone[c, k] = 0
            for k in range(3):
                now[c, k] = max(0.0, now[c, k])
            r += now[c, 0] - _before(sums, better, lit, i, c, 0)
            g += now[c, 1] - _before(sums, better, lit, i, c, 1)
            b += now[c, 2] - _before(sums, better, lit, i, c, 2)
        # Shares of the cells that no ray reaches change with the totals alone.
        red, green, blue = red / r if r > 0.0 else 0.0, green / g if g > 0.0 else 0.0, blue / b if b > 0.0 else 0.0
        for c in range(CELLS):
            to[c, 0], to[c, 1], to[c, 2] = red * rest[c, 0], green * rest[c, 1], blue * rest[c, 2]
            to[c, 3], to[c, 4], to[c, 5] = rest[c, 3], rest[c, 4], rest[c, 5]
        for m in range(n):
            c = listed[m]
            to[c, 0] = now[c, 0] / r if r > 0.0 else 0.0
            to[c, 1] = now[c, 1] / g if g > 0.0 else 0.0
            to[c, 2] = now[c, 2] / b if b > 0.0 else 0.0
            _mean(now[c, 3], now[c, 4], now[c, 5], now[c, 6], to[c])

"""Rays that reach glossy receivers: segments that cross their discs, with any estimator, and their integer sums."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.discs.region import RAYS, WHOLE, Regions
from gi_core.discs.search.disc_index import DiscIndex
from gi_core.discs.search.predicate import Discs, Lines, lines
from gi_core.geometry.receivers import NONE
from gi_core.gloss.hemisphere import GRAZING, add_ray, axes_of, cell_towards, weight_of
from gi_core.model import Model
from gi_core.photons.flux_sums import IntersectionLog, Sums
from gi_core.photons.paths import Segments, rows_of
from gi_core.rays.accelerator import Transforms

FLUX_SHIFT = 12  # bits of flux left out of moments ...
DIRECTION_BITS = 14  # ... and bits of a direction: 2^36.2 at most per ray, 2^26 rays in 63 bits
RAY = 8  # numbers of a ray, see _weigh()


class Crossings(NamedTuple):
    """Crossings of some segments with the discs of an object's glossy receivers."""

    receiver: np.ndarray  # (m,) int32, index among them
    line: np.ndarray  # (m,) int32 into `lines`
    lines: Lines  # in the object's space
    photon: np.ndarray  # (S,) int64, of each line
    bounce: np.ndarray  # (S,) int32


class GlossDiscs:
    """Discs of glossy receivers, object by object. Not thread safe."""

    def __init__(self, model: Model, radius: float, rows: np.ndarray):
        """radius [m]: of the discs; rows (n,) int64: the receivers, ascending. Without any it costs nothing."""
        self.model, self.radius, self.rows, s = model, radius, rows, model.surfaces
        self.first = np.searchsorted(self.rows, s.first_receiver)  # (objects + 1,) into `rows`
        self.normals = np.ascontiguousarray(model.object_receivers.normals[self.rows])  # (n, 3)
        self._searches = [self._search(o) for o in range(s.objects)] if len(self.rows) else []

    @property
    def on_mobiles(self) -> bool:
        """Whether a mobile has glossy faces: its receivers need the segments near it."""
        return len(self.rows) > self.first[1]

    def count(self, o: int) -> int:
        """Return the number of glossy receivers of an object."""
        return int(self.first[o + 1] - self.first[o])

    def normals_of(self, o: int) -> np.ndarray:
        """Return the normals (count, 3) of an object's glossy receivers, in its space."""
        return self.normals[self.first[o] : self.first[o + 1]]

    def _search(self, o: int) -> DiscIndex:
        rows = self.rows[self.first[o] : self.first[o + 1]]
        r, n = self.model.object_receivers, len(rows)
        region = Regions(
            np.full(n, WHOLE, np.int32), np.empty((0, RAYS, 2), np.uint8), np.full(n, math.pi * self.radius**2)
        )
        positions, normals = (np.ascontiguousarray(a[rows], np.float32) for a in (r.positions, r.normals))
        # The two sides of a face are discs of their own.
        own, back = self.model.receiver_sides[rows], np.full(n, NONE, np.int32)
        # the discs of a flat surface lie in one layer: cells of 2.0 radii, gloss-cells.md
        return DiscIndex(Discs(positions, normals, own, back, np.float32(self.radius), region), cell_radii=2.0)

    def crossed(self, o: int, parts: Sequence[Segments], at: Transforms) -> list[tuple[int, Crossings]]:
        """Return the crossings of segments with object o's discs at poses, each with the index of its part."""
        count, model, ends = self.count(o), self.model, np.cumsum([0, *(part.size for part in parts)])
        if not (ends[-1] and count):
            return []
        search = self._searches[o]

        def find(segments: Segments) -> Crossings:
            ready = lines(segments, at.rotation[o], at.position[o], model, self.radius)
            room = 4 * segments.size  # 4 crossings per segment in the first record
            while True:
                log = IntersectionLog.of(room)
                search.accumulate(ready, 1, Sums.zeros(count, model.emitters.lamps.channels)._replace(log=log))
                if log.count[0] <= room:
                    n = int(log.count[0])
                    return Crossings(log.receiver[:n], log.line[:n], ready, segments.photon, segments.bounce)
                room = int(log.count[0])

        def work(_, first, last):
            ranges = [(max(first - a, 0), min(last, b) - a) for a, b in itertools.pairwise(ends)]
            return [(k, find(rows_of(parts[k], slice(*r)))) for k, r in enumerate(ranges) if r[0] < r[1]]

        return list(itertools.chain(*run_ranges(work, int(ends[-1]), model.threads, COSTLY)))


class Intake:
    """The first `photons` of a store that glossy receivers have taken in; its lamps weigh `weights` (G, 3)."""

    def __init__(self, lamps: int):
        self.photons, self.weights = 0, np.ones((lamps, 3))
        self._store: object = None

    def begins_anew(self, store: object, weights: np.ndarray) -> bool:
        """Return whether store or weights differ from the last call; then no photon has been taken in."""
        anew = store is not self._store or not np.array_equal(weights, self.weights)
        if anew:
            self._store, self.weights, self.photons = store, weights.copy(), 0
        return anew

    def begin_with(self, store: object, weights: np.ndarray, photons: int) -> None:
        """Hold the first photons of a store, at these weights."""
        self._store, self.weights, self.photons = store, weights.copy(), photons

    def end_of_part(self, count: int) -> int:
        """Return the end of the next part of the first `count` photons."""
        return min(self.photons + 8192, count)


class Arrivals(NamedTuple):
    """Rays of segments at an object's receivers, in the order of receivers."""

    rows: np.ndarray  # (k,) int64, receivers that rays reach, ascending
    first: np.ndarray  # (k + 1,) int64 into `line`, first ray of each
    line: np.ndarray  # (m,) int32 into the next two
    rays: np.ndarray  # (S, RAY) int64, see _weigh()
    direction: np.ndarray  # (S, 3) float32, of the segments, in the object's space


def arrivals(
    discs: GlossDiscs, o: int, parts: list[tuple[int, Segments]], at: Transforms, weights: np.ndarray
) -> Arrivals:
    """Return the rays of segments, each part with its sign, at object o's receivers; weights (G, 3): of the lamps."""
    crossed = [(parts[k][0], c) for k, c in discs.crossed(o, [segments for _, segments in parts], at)]
    n, sizes = discs.count(o), [len(c.lines.low) for _, c in crossed]
    rays, receiver = np.empty((sum(sizes), RAY), np.int64), [np.empty(0, np.int32)]
    direction, lines = [np.empty((0, 3), np.float32)], [np.empty(0, np.int32)]
    for (sign, c), last in zip(crossed, np.cumsum(sizes), strict=True):
        first = int(last) - len(c.lines.low)
        _weigh(c.lines.direction, c.lines.flux, c.lines.lamp, weights, sign, rays[first:last])
        receiver.append(c.receiver)
        direction.append(c.lines.direction)
        lines.append(c.line + np.int32(first))
    at_receiver, along = np.concatenate(receiver), np.concatenate(lines)
    counts = np.bincount(at_receiver, minlength=n)
    cursor, ordered = np.cumsum(counts) - counts, np.empty_like(along)
    rows = np.flatnonzero(counts)
    starts = np.append(cursor[rows], len(along))
    _order(at_receiver, along, cursor, ordered)
    return Arrivals(rows, starts, ordered, rays, np.concatenate(direction))


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
def add_rays(arrivals, j, n, to, gone):
    """Add the rays at row j, a receiver of normal n, to its cells (CELLS, SUMS); return the cells reached as bits.

    Removed rays are subtracted from `gone` (CELLS, SUMS), which may be `to`.
    """
    axes, reached = axes_of(n), np.uint64(0)
    for e in range(arrivals.first[j], arrivals.first[j + 1]):
        k = arrivals.line[e]
        d, ray = arrivals.direction[k], arrivals.rays[k]
        cell, cosine = cell_towards(axes, (-float(d[0]), -float(d[1]), -float(d[2])))
        weight = ray[7] * np.int64(weight_of(ray[6], cosine, GRAZING) + 0.5)
        moment = weight * ray[3], weight * ray[4], weight * ray[5]
        add_ray(to[cell] if ray[7] > 0 else gone[cell], (ray[0], ray[1], ray[2]), moment, weight)
        reached |= np.uint64(1) << np.uint64(cell)
    return reached


@kernel
def deposit(arrivals, first, last, normals, sums):
    """Add the rays at receivers, rows first .. last - 1, to their sums (n, CELLS, SUMS)."""
    for j in range(first, last):
        i = arrivals.rows[j]
        add_rays(arrivals, j, normals[i], sums[i], sums[i])

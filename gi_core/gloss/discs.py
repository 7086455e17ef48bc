"""Rays that reach glossy receivers: segments that cross their discs, with any estimator."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.threads import run_ranges
from gi_core.discs.region import RAYS, WHOLE, Regions
from gi_core.discs.search.disc_index import DiscIndex
from gi_core.discs.search.predicate import Discs, Lines, lines
from gi_core.geometry.sides import NONE
from gi_core.model import Model
from gi_core.photons.flux_sums import IntersectionLog, Sums
from gi_core.photons.paths import Segments, take
from gi_core.rays.accelerator import Transforms

CELL_RADII = 2.0  # edge of the cells of the search: the discs of a flat surface lie in one layer, decision 37
ROOM = 4  # crossings per segment in the first record
GRAIN = 256  # segments per thread


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
        return DiscIndex(Discs(positions, normals, own, back, np.float32(self.radius), region), cell_radii=CELL_RADII)

    def crossed(self, o: int, parts: Sequence[Segments], at: Transforms) -> list[tuple[int, Crossings]]:
        """Return the crossings of segments with object o's discs at poses, each with the index of its part."""
        count, model, ends = self.count(o), self.model, np.cumsum([0, *(part.size for part in parts)])
        if not (ends[-1] and count):
            return []
        search = self._searches[o]

        def find(segments: Segments) -> Crossings:
            ready, room = lines(segments, at.rotation[o], at.position[o], model, self.radius), ROOM * segments.size
            while True:
                log = IntersectionLog.of(room)
                search.accumulate(ready, 1, Sums.zeros(count, model.emitters.lamps.channels)._replace(log=log))
                if log.count[0] <= room:
                    n = int(log.count[0])
                    return Crossings(log.receiver[:n], log.line[:n], ready, segments.photon, segments.bounce)
                room = int(log.count[0])

        def work(_, first, last):
            ranges = [(max(first - a, 0), min(last, b) - a) for a, b in itertools.pairwise(ends)]
            return [(k, find(take(parts[k], slice(*r)))) for k, r in enumerate(ranges) if r[0] < r[1]]

        return list(itertools.chain(*run_ranges(work, int(ends[-1]), model.threads, GRAIN)))

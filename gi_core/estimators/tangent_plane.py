"""Density Estimation on the Tangent Plane (Lastra et al. 2002; report 1.2.1).

E = flux of the segments that cross a receiver's disc from the front / the disc's reachable area. Additive in segments,
so on static receivers Eq. 2.4 holds: background - tails + branches. Receivers on a mobile are
estimated from all current segments near it (report 2.5.2), in its own space, where discs never move.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gi_core.accelerator import Transforms
from gi_core.cuts import Frame
from gi_core.disc_search import SEARCHES
from gi_core.disc_search.crossing import Discs, lines
from gi_core.estimators.thread_sums import ThreadSums
from gi_core.ladder import Ladder
from gi_core.model import Model
from gi_core.paths import Segments
from gi_core.reachable_area import regions, whole_discs
from gi_core.threads import run_ranges

LINE_GRAIN = 1024  # segments a thread


class TangentPlane:
    """See the module; `radius` [m] is the disc's."""

    search = "disc_index"  # of SEARCHES
    additive = True  # sums of parts are sums of the whole: preparing costs nothing
    on_faces = False  # probes are receivers like any other

    def __init__(self, model: Model, radius: float, neighbours: int, control: bool = True):
        self.model, self.radius, self.control = model, radius, control
        self.reach = radius
        self.area = np.full(len(model.object_receivers.areas), math.pi * radius * radius)
        self.photons = 0  # photons that were prepared
        self.prefixes = Ladder()  # sums of the background by the photons they cover
        self._background = np.zeros((model.surfaces.receiver_range(0).stop, 3), np.int64)
        self._searches: list = []
        self._added = ThreadSums(self._background.shape, model.threads)
        self._parts = ThreadSums((len(self.area), 3), model.threads)

    def build(self) -> Iterator[None]:
        """Find reachable regions and index the discs of every object, in steps of a few ms."""
        own, r = self.model.receiver_sides, self.model.object_receivers
        self._searches = []
        for o in range(self.model.surfaces.objects):
            rows = self.model.surfaces.receiver_range(o)
            if self.control:
                region = yield from regions(self.model, o, self.radius)
            else:
                region = whole_discs(self.model, o, self.radius)
            self.area[rows] = region.area
            positions = np.ascontiguousarray(r.positions[rows], np.float32)
            normals = np.ascontiguousarray(r.normals[rows], np.float32)
            discs = Discs(positions, normals, own[rows], self.model.backs(o), np.float32(self.radius), region)
            self._searches.append(SEARCHES[self.search](discs))
            yield

    def add_background(self, segments: Segments, thread: int) -> None:
        """Add background segments to the sums of static receivers; several threads may, each with its number."""
        self._splat_part(0, segments, self.model.static, 1, self._added[thread])

    def prepare(self, photons: int) -> Iterator[None]:
        """Let frames use all that was added, which is the first `photons`; kept by that prefix."""
        self._added.move_to(self._background)
        self.prefixes[photons] = self._background.copy()
        self.photons = photons
        return iter(())

    def evaluate(self, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
        """Return sums (R, 3) int64 in fixed-point units and the area (R,) [m2] to divide by."""
        sums = np.zeros((len(self.area), 3), np.int64)
        static = sums[self.model.surfaces.receiver_range(0)]
        static += self.prefixes[frame.photons]
        self._splat(0, frame.tails, self.model.static, -1, static)
        self._splat(0, frame.branches, self.model.static, 1, static)
        for o, near in enumerate(frame.near, 1):
            self._splat(o, near, frame.at, 1, sums[self.model.surfaces.receiver_range(o)])
        return sums, self.area

    def from_scratch(self, parts, at: Transforms) -> tuple[np.ndarray, np.ndarray]:
        """Return what evaluate() does, from all current segments (an iterable of Segments)."""
        sums = np.zeros((len(self.area), 3), np.int64)
        for segments in parts:
            for o in range(self.model.surfaces.objects):
                self._splat(o, segments, at, 1, sums[self.model.surfaces.receiver_range(o)])
        return sums, self.area

    def _splat(self, o: int, segments: Segments, at: Transforms, sign: int, sums: np.ndarray) -> None:
        if not segments.size or not len(sums):
            return
        rows = slice(len(sums))

        def work(part, first, last):
            own = sums if part == 0 else self._parts[part][rows]
            self._splat_part(o, Segments(*(a[first:last] for a in segments)), at, sign, own)

        parts = run_ranges(work, segments.size, self.model.threads, LINE_GRAIN)
        for part in range(1, len(parts)):
            sums += self._parts[part][rows]
            self._parts[part][rows] = 0

    def _splat_part(self, o: int, segments: Segments, at: Transforms, sign: int, sums: np.ndarray) -> None:
        if segments.size and len(sums):
            ready = lines(segments, at.rotation[o], at.position[o], self.model, self.radius)
            self._searches[o].splat(ready, 0, segments.size, sign, sums)

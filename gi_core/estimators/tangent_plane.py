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
        self._sums = np.zeros((len(self.area), 3), np.int64)  # of a frame
        self._parts = ThreadSums(self._sums.shape, model.threads)

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
        """Return sums (R, 3) int64 in fixed-point units and the area (R,) [m2] to divide by.

        The sums are valid until the next call.
        """
        static = self.model.surfaces.receiver_range(0)
        np.copyto(self._sums[static], self.prefixes[frame.photons])
        self._sums[static.stop :] = 0
        near = [(o, segments, 1) for o, segments in enumerate(frame.near, 1)]
        self._splat([(0, frame.tails, -1), (0, frame.branches, 1), *near], frame.at, self._sums)
        return self._sums, self.area

    def from_scratch(self, parts, at: Transforms) -> tuple[np.ndarray, np.ndarray]:
        """Return what evaluate() does, from all current segments (an iterable of Segments)."""
        sums = np.zeros_like(self._sums)
        for segments in parts:
            self._splat([(o, segments, 1) for o in range(self.model.surfaces.objects)], at, sums)
        return sums, self.area

    def _splat(self, jobs: list[tuple[int, Segments, int]], at: Transforms, sums: np.ndarray) -> None:
        """Add sign x flux of segments to the sums of object o, for each job (o, segments, sign).

        Every thread takes its share of every job, so that all end at about the same time.
        """
        threads = min(self.model.threads, 1 + sum(segments.size for _, segments, _ in jobs) // LINE_GRAIN)

        def work(part, *_):
            own = sums if part == 0 else self._parts[part]
            for o, segments, sign in jobs:
                share = slice(segments.size * part // threads, segments.size * (part + 1) // threads)
                rows = self.model.surfaces.receiver_range(o)
                self._splat_part(o, Segments(*(a[share] for a in segments)), at, sign, own[rows])

        run_ranges(work, threads, threads, 1)
        for part in range(1, threads):
            sums += self._parts[part]
            self._parts[part].fill(0)

    def _splat_part(self, o: int, segments: Segments, at: Transforms, sign: int, sums: np.ndarray) -> None:
        if segments.size and len(sums):
            ready = lines(segments, at.rotation[o], at.position[o], self.model, self.radius)
            self._searches[o].splat(ready, 0, segments.size, sign, sums)

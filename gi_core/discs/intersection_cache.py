"""Cache of the disc intersections of background segments: receiver and distance, found once per segment.

A cut removes the rest of a path. Whether an intersection is accepted does not depend on the cut
(`discs/search/predicate.py`), so a removed suffix has exactly the cached intersections behind the cut. A frame looks
them up instead of searching, unless the cache is full. An entry takes eight bytes.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.base.pause import pause
from gi_core.discs.search.predicate import begins
from gi_core.photons.flux_sums import CHUNK_BITS, IntersectionLog, Sums
from gi_core.photons.paths import Segments
from gi_core.retrace.cuts import RemovedSuffixes

MOST_PER_PHOTON = 64  # entries per photon: half a GB per million photons. Beyond it, frames search for removed suffixes
ENTRIES_PER_SEGMENT = 4  # entries per segment in the first allocation
ENTRIES_PER_STEP = 1 << 20  # entries merged or moved between two pauses


class _Entries(NamedTuple):
    """Entries of all segments of consecutive photons."""

    photon: int  # index of the first
    photons: int
    count: (
        np.ndarray
    )  # (vertices,) uint32, entries of the segment that leaves each vertex; 0 at the last vertex of a path
    receiver: np.ndarray  # (n,) int32
    distance: np.ndarray  # (n,) float32 [m]


class IntersectionCache:
    """Disc intersections of background segments, by start vertex; append-only."""

    def __init__(self):
        self.complete = True  # False: there were too many, and the cache is empty
        self._parts: list[_Entries] = []  # not merged yet
        self._photons = self._vertices = 0
        self._first = np.zeros(1, np.uint32)  # (vertices + 1,), first entry of each vertex
        self._receiver, self._distance = np.empty(0, np.int32), np.empty(0, np.float32)

    def copied(self) -> IntersectionCache:
        """Return a copy; both share the memory of their present entries, which stay as they are."""
        other, end = copy.copy(self), int(self._first[self._vertices])
        other._parts, other._first = list(self._parts), self._first[: self._vertices + 1]
        other._receiver, other._distance = self._receiver[:end], self._distance[:end]
        return other

    @property
    def bytes_per_vertex(self) -> int:
        """Bytes of the cache per path vertex; an estimate before photons are known."""
        # 3 entries per vertex, before any are counted
        entries = int(self._first[self._vertices]) / self._vertices if self._vertices else 3
        return 4 + int(8 * entries) if self.complete else 0

    def find(self, segments: Segments, accumulate: Callable[[int, IntersectionLog], None]) -> None:
        """Call `accumulate(sign, log)`, which adds sign x segments to sums; cache the intersections that it records.

        segments: all of consecutive photons, photon-major. Thread safe for disjoint photons.
        """
        log = IntersectionLog.of(1 + ENTRIES_PER_SEGMENT * segments.size if self.complete else 0)
        accumulate(1, log)
        if not self.complete or not segments.size:
            return
        n = int(log.count[0])
        if n > len(log.line):
            log = IntersectionLog.of(n)
            accumulate(0, log)  # sign 0: record only, the sums have them already
        photons = int((segments.bounce == 0).sum())
        count = np.zeros(segments.size + photons, np.uint32)
        receiver, distance = np.empty(n, np.int32), np.empty(n, np.float32)
        _by_vertex(segments.bounce, log, n, count, receiver, distance)
        self._parts.append(_Entries(int(segments.photon[0]), photons, count, receiver, distance))

    def settle(self) -> None:
        """Merge the parts, which now cover all photons up to some last one, for subtract().

        May be broken off at a pause and begun again.
        """
        at, end = self._vertices, int(self._first[self._vertices])
        parts = self._parts = sorted(self._parts, key=lambda part: part.photon)
        n = end + sum(len(p.receiver) for p in parts)
        # 1 << 32 entries: indices have 32 bits
        if n > min(MOST_PER_PHOTON * (self._photons + sum(p.photons for p in parts)), (1 << 32) - 1):
            self.__init__()
            self.complete = False
            return
        self._first = _grown(self._first, at + 1, at + 1 + sum(len(p.count) for p in parts))
        self._receiver = _grown(self._receiver, end, n)
        self._distance = _grown(self._distance, end, n)
        merged = 0
        while parts:
            p = parts.pop(0)
            rows, entries = slice(at + 1, at + 1 + len(p.count)), slice(end, end + len(p.receiver))
            self._first[rows] = np.cumsum(p.count, dtype=np.uint32) + np.uint32(end)
            self._receiver[entries], self._distance[entries] = p.receiver, p.distance
            at, end = at + len(p.count), entries.stop
            self._photons, self._vertices = self._photons + p.photons, at
            if end // ENTRIES_PER_STEP > merged:
                merged = end // ENTRIES_PER_STEP
                pause()

    def subtract(self, removed_suffixes: RemovedSuffixes, radius: float, first: int, last: int, sums: Sums) -> int:
        """Subtract removed suffixes first .. last - 1 from the sums of discs; return the number of intersections."""
        removed = removed_suffixes.of(slice(first, last))
        return _subtract(self._first, self._receiver, self._distance, removed, begins(removed, radius), sums)


def _grown(array: np.ndarray, used: int, n: int) -> np.ndarray:
    """Return the array, reallocated if it has fewer than n entries; `used` of them count."""
    if n <= len(array):
        return array
    out = np.empty(max(n, len(array) * 5 // 4), array.dtype)
    for first in range(0, used, ENTRIES_PER_STEP):
        part = slice(first, min(first + ENTRIES_PER_STEP, used))
        out[part] = array[part]
        pause()
    return out


@allocating
def _by_vertex(bounce, log, n, count, receiver, distance):
    """Sort the first n records of a log by start vertex, and count them per vertex."""
    vertex = np.empty(len(bounce), np.int64)
    v = -1
    for k in range(len(bounce)):
        v += 2 if bounce[k] == 0 and k > 0 else 1  # skip the last vertex of the previous photon
        vertex[k] = v
    for e in range(n):
        count[vertex[log.line[e]]] += 1
    cursor = np.zeros(len(count) + 1, np.int64)
    for v in range(len(count)):
        cursor[v + 1] = cursor[v] + count[v]
    for e in range(n):
        v = vertex[log.line[e]]
        receiver[cursor[v]], distance[cursor[v]] = log.receiver[e], log.distance[e]
        cursor[v] += 1


@kernel
def _subtract(first, receiver, distance, removed, low, sums):
    total = 0
    for j in range(len(low)):
        v, end = removed.vertex[j], removed.paths.offsets[removed.photon[j] + 1] - 1
        first_channel = 3 * removed.paths.lamp[removed.photon[j]]
        for k in range(v, end):
            for e in range(first[k], first[k + 1]):
                if k > v or distance[e] >= low[j]:
                    i = receiver[e]
                    sums.touched[(sums.first + i) >> CHUNK_BITS] = True
                    for c in range(3):
                        sums.flux[i, first_channel + c] -= removed.paths.flux[k, c]
                    total += 1
    return total

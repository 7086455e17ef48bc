"""Which receivers each background segment adds to, and where along it: found once, when it is estimated.

A mobile that cuts a photon takes out what lies behind the cut. Those crossings have all been found before, and
whether one counts does not depend on the cut (`discs/search/predicate.py`): a tail has those that are no nearer than
the cut. So a frame looks them up instead of searching for them again. They take eight bytes a crossing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.photons.flux_sums import CHUNK_BITS, Log, Sums
from gi_core.photons.paths import Segments, grown
from gi_core.retrace.removed_suffixes import RemovedSuffixes

MOST_A_PHOTON = 64  # crossings: half a GB a million photons. Where there are more, tails are searched for
MOST = 1 << 32  # crossings: they are counted in 32 bits
GUESS = 3  # crossings a vertex, before any are known
ROOM = 4  # crossings a segment that a first try has room for


class _Part(NamedTuple):
    """Crossings of all segments of some photons in a row."""

    photon: int  # the first of them
    photons: int
    count: np.ndarray  # (vertices,) uint32, crossings of the segment that leaves each; 0 at a path's last one
    receiver: np.ndarray  # (n,) int32
    distance: np.ndarray  # (n,) float32 [m]


class Crossings:
    """Crossings of background segments by the path vertex that each leaves, growing as photons are added."""

    def __init__(self):
        self.kept = True  # False: there were too many, and none are known
        self._parts: list[_Part] = []  # not settled yet
        self._photons = self._vertices = 0
        self._first = np.zeros(1, np.uint32)  # (vertices + 1,), where those of each begin
        self._receiver, self._distance = np.empty(0, np.int32), np.empty(0, np.float32)

    @property
    def bytes_a_vertex(self) -> int:
        """Memory that a path vertex takes, as far as is known."""
        crossings = int(self._first[self._vertices]) / self._vertices if self._vertices else GUESS
        return 4 + int(8 * crossings) if self.kept else 0

    def find(self, segments: Segments, splat: Callable[[int, Log], None]) -> None:
        """Call `splat(sign, log)`, which adds sign x segments to sums, and keep what it writes into the log.

        segments: all of some photons in a row, photon-major. Several threads may, each with photons of its own.
        """
        log = Log.of(1 + ROOM * segments.size if self.kept else 0)
        splat(1, log)
        if not self.kept or not segments.size:
            return
        n = int(log.count[0])
        if n > len(log.line):
            log = Log.of(n)
            splat(0, log)  # they have been added
        photons = int((segments.bounce == 0).sum())
        count = np.zeros(segments.size + photons, np.uint32)
        receiver, distance = np.empty(n, np.int32), np.empty(n, np.float32)
        _by_vertex(segments.bounce, log, n, count, receiver, distance)
        self._parts.append(_Part(int(segments.photon[0]), photons, count, receiver, distance))

    def settle(self) -> None:
        """Let take_out() know what was found, which is by now that of all photons up to some last one."""
        photons, at, end = self._photons, self._vertices, int(self._first[self._vertices])
        parts = sorted(self._parts, key=lambda part: part.photon)
        photons += sum(p.photons for p in parts)
        n = end + sum(len(p.receiver) for p in parts)
        if n > min(MOST_A_PHOTON * photons, MOST - 1):
            self.__init__()
            self.kept = False
            return
        self._first = grown(self._first, at + sum(len(p.count) for p in parts) + 1)
        self._receiver, self._distance = grown(self._receiver, n), grown(self._distance, n)
        for p in parts:
            rows, entries = slice(at + 1, at + 1 + len(p.count)), slice(end, end + len(p.receiver))
            self._first[rows] = np.cumsum(p.count, dtype=np.uint32) + np.uint32(end)
            self._receiver[entries], self._distance[entries] = p.receiver, p.distance
            at, end = at + len(p.count), entries.stop
        self._photons, self._vertices, self._parts = photons, at, []

    def take_out(self, removed_suffixes: RemovedSuffixes, first: int, last: int, sums: Sums) -> int:
        """Subtract tails first .. last - 1 from the sums of the receivers they cross; returns how many crossings."""
        t = removed_suffixes
        return _take_out(
            self._first, self._receiver, self._distance, t.paths.offsets, t.paths.flux, t.photon, t.vertex, t.low,
            first, last, sums.flux, sums.touched, sums.first,
        )  # fmt: skip


@allocating
def _by_vertex(bounce, log, n, count, receiver, distance):
    """Sort the first n crossings of a log by the path vertex that their segment leaves, and count those of each."""
    vertex = np.empty(len(bounce), np.int64)
    v = -1
    for k in range(len(bounce)):
        v += 2 if bounce[k] == 0 and k > 0 else 1  # over the last vertex of the photon before
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
def _take_out(first, receiver, distance, offsets, flux, photon, vertex, low, a, b, sums, touched, base):
    total = 0
    for j in range(a, b):
        v, end = vertex[j], offsets[photon[j] + 1] - 1
        for k in range(v, end):
            for e in range(first[k], first[k + 1]):
                if k > v or distance[e] >= low[j]:
                    i = receiver[e]
                    touched[(base + i) >> CHUNK_BITS] = True
                    for c in range(3):
                        sums[i, c] -= flux[k, c]
                    total += 1
    return total

"""Stored background paths, and segments, the input of estimators.

Positions are float32: 2^-24 of a room of 10 m is 0.6 um. Flux is int32 in fixed-point units. A path vertex takes 28
bytes. Photons are in index order, so a photon subset comes first in every array.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import CHEAP, COSTLY, run_ranges
from gi_core.base.vec import row as row_of
from gi_core.geometry.receivers import NONE
from gi_core.rays.accelerator import line


class PathVertices(NamedTuple):
    """Vertices of the paths of some photons, photon-major."""

    offsets: np.ndarray  # (N + 1,) int64, photon i has vertices offsets[i] .. offsets[i + 1] - 1
    position: np.ndarray  # (n, 3) float32 [m]
    side: np.ndarray  # (n,) int32, 2 face + (1 on the back), NONE in free space
    flux: np.ndarray  # (n, 3) int32, of the segment that leaves this vertex; 0 at the last vertex of a path
    lamp: np.ndarray  # (N,) uint8, lamp of each photon
    direct: (
        np.ndarray
    )  # (N,) uint8, segments of each photon until its first reflection: 1, and 1 per pane that it passes


class Segments(NamedTuple):
    """Segments, or parts of them: an interval [low, high) of distance along a line.

    The line runs from `origin` to `end` (its static end) and stays whole when a mobile cuts it. Discs lengthen parts
    behind their hits, see `discs/search/predicate.py`.
    """

    origin: np.ndarray  # (S, 3) float32 [m]
    end: np.ndarray  # (S, 3) float32 [m]
    low: np.ndarray  # (S,) float32 [m]; -1: the part begins where the line does
    high: np.ndarray  # (S,) float32 [m]
    flux: np.ndarray  # (S, 3) int32, fixed-point units
    start_side: np.ndarray  # (S,) int32, side at the origin or NONE
    end_side: np.ndarray  # (S,) int32, side at the line's static end or NONE
    cut_side: np.ndarray  # (S,) int32, side of a mobile where the part ends, or NONE
    hit: np.ndarray  # (S, 3) float32 [m], where the part ends
    photon: np.ndarray  # (S,) int64
    bounce: np.ndarray  # (S,) int32, 0 for the segment that leaves the light
    lamp: np.ndarray  # (S,) uint8, lamp of the photon
    direct: np.ndarray  # (S,) bool, straight from the lamp

    @property
    def size(self) -> int:
        """Number of segments."""
        return len(self.low)

    @property
    def hit_side(self) -> np.ndarray:
        """Side that receives the flux, (S,) int32: a mobile's if the segment is cut, else that of the static end."""
        return np.where(self.cut_side != NONE, self.cut_side, self.end_side)


KEPT, REMOVED, ADDED = range(3)  # kinds of segments: as without mobiles; blocked by one; from there on


def rows_of(segments: Segments, rows: np.ndarray | slice) -> Segments:
    """Return segments by index (m,), mask (S,) or slice."""
    return Segments(*(a[rows] for a in segments))


class PathStore:
    """Append-only store of the background paths of photons 0 .. N - 1."""

    def __init__(self):
        self._offsets = np.zeros(1, np.int64)
        self._position = np.empty((0, 3), np.float32)
        self._side = np.empty(0, np.int32)
        self._flux = np.empty((0, 3), np.int32)
        self._lamp, self._direct = np.empty((2, 0), np.uint8)
        self.photons = 0

    def copied(self) -> PathStore:
        """Return a copy; both share the memory of their present paths, which stay as they are."""
        other, photons = PathStore(), self.photons
        other._offsets, other._position, other._side, other._flux, other._lamp, other._direct = self.subset(photons)
        other.photons = photons
        return other

    def append(self, parts: Sequence[PathVertices], threads: int) -> None:
        """Append the paths of the next photons, part by part, on all threads: first writes to new memory are slow."""
        photons = np.cumsum([self.photons, *(len(p.offsets) - 1 for p in parts)])
        starts = np.cumsum([int(self._offsets[self.photons]), *(len(p.side) for p in parts)])
        self._offsets = grown(self._offsets, int(photons[-1]) + 1)
        self._lamp, self._direct = (grown(a, int(photons[-1])) for a in (self._lamp, self._direct))
        self._position, self._side, self._flux = (
            grown(a, int(starts[-1])) for a in (self._position, self._side, self._flux)
        )

        def work(_, first, last):
            for k in range(first, last):
                self._offsets[photons[k] + 1 : photons[k + 1] + 1] = parts[k].offsets[1:] + starts[k]
                self._lamp[photons[k] : photons[k + 1]] = parts[k].lamp
                self._direct[photons[k] : photons[k + 1]] = parts[k].direct
                rows = slice(starts[k], starts[k + 1])
                self._position[rows], self._side[rows], self._flux[rows] = parts[k][1:4]

        run_ranges(work, len(parts), threads, 1)
        self.photons = int(photons[-1])

    def reserve(self, photons: int) -> None:
        """Reserve memory for that many photons; untouched memory costs nothing."""
        if self.photons and photons >= len(self._offsets):
            n = int(1.05 * photons * int(self._offsets[self.photons]) / self.photons)
            self._offsets = grown(self._offsets, photons + 1)
            self._lamp, self._direct = grown(self._lamp, photons), grown(self._direct, photons)
            self._position, self._side, self._flux = (grown(a, n) for a in (self._position, self._side, self._flux))

    def subset(self, photons: int) -> PathVertices:
        """Return views of the paths of the first `photons` photons."""
        n = int(self._offsets[photons])
        vertices = self._position[:n], self._side[:n], self._flux[:n]
        return PathVertices(self._offsets[: photons + 1], *vertices, self._lamp[:photons], self._direct[:photons])

    @property
    def room(self) -> int:
        """Number of vertices that fit into the reserved memory."""
        return len(self._side)


def grown(array: np.ndarray, n: int) -> np.ndarray:
    """Return the array, reallocated if it has fewer than n rows."""
    if n <= len(array):
        return array
    grown = np.empty((max(n, len(array) * 5 // 4), *array.shape[1:]), array.dtype)
    grown[: len(array)] = array
    return grown


def empty_segments(n: int) -> Segments:
    """Return uninitialised arrays of n segments."""
    return Segments(
        origin=np.empty((n, 3), np.float32),
        end=np.empty((n, 3), np.float32),
        low=np.empty(n, np.float32),
        high=np.empty(n, np.float32),
        flux=np.empty((n, 3), np.int32),
        start_side=np.empty(n, np.int32),
        end_side=np.empty(n, np.int32),
        cut_side=np.full(n, NONE, np.int32),
        hit=np.empty((n, 3), np.float32),
        photon=np.empty(n, np.int64),
        bounce=np.empty(n, np.int32),
        lamp=np.empty(n, np.uint8),
        direct=np.empty(n, bool),
    )


def bounced(segments: Segments) -> Segments:
    """Return the segments that surfaces have reflected."""
    return rows_of(segments, ~segments.direct)


def concatenate(parts: list[Segments]) -> Segments:
    """Return the segments of all parts, in order."""
    if not parts:
        return empty_segments(0)
    return Segments(*(np.concatenate(a) for a in zip(*parts, strict=True)))


@kernel
def _write(paths, photons, vertices, counts, rows, first, last, out):
    """Write the whole segments that leave so many vertices of photons, from a vertex on, to rows from rows[j] on."""
    for j in range(first, last):
        photon = photons[j]
        for k in range(vertices[j], vertices[j] + counts[j]):
            row, a, b = rows[j] + k - vertices[j], row_of(paths.position, k), row_of(paths.position, k + 1)
            out.origin[row, 0], out.origin[row, 1], out.origin[row, 2] = a
            out.end[row, 0], out.end[row, 1], out.end[row, 2] = b
            out.hit[row, 0], out.hit[row, 1], out.hit[row, 2] = b
            for c in range(3):
                out.flux[row, c] = paths.flux[k, c]
            _, _, _, out.high[row] = line(a[0], a[1], a[2], b[0], b[1], b[2])
            out.low[row] = -1.0
            out.start_side[row], out.end_side[row], out.cut_side[row] = paths.side[k], paths.side[k + 1], NONE
            out.photon[row], out.bounce[row] = photon, k - paths.offsets[photon]
            out.lamp[row], out.direct[row] = paths.lamp[photon], out.bounce[row] < paths.direct[photon]


def _segments(paths: PathVertices, photons, vertices, counts, threads: int = 1, grain: int = COSTLY):
    """Return the whole segments that leave counts (n,) vertices of photons (n,), and the first row (n,) of each."""
    ends = np.cumsum(counts)
    rows, out = ends - counts, empty_segments(int(ends[-1]) if len(ends) else 0)
    run_ranges(lambda _, *part: _write(paths, photons, vertices, counts, rows, *part, out), len(rows), threads, grain)
    return out, rows


def segments_of(paths: PathVertices, first: int, last: int) -> Segments:
    """Return the whole segments of photons first .. last - 1."""
    vertices = paths.offsets[first : last + 1]
    return _segments(paths, np.arange(first, last), vertices[:-1], np.diff(vertices) - 1)[0]


def segments_at(paths: PathVertices, photons: np.ndarray, vertices: np.ndarray, threads: int) -> Segments:
    """Return the whole segments that leave the given vertices (n,) of the given photons (n,)."""
    return _segments(paths, photons, vertices, np.ones_like(vertices), threads, CHEAP)[0]


def segments_behind(
    paths: PathVertices, photons: np.ndarray, vertices: np.ndarray, low: np.ndarray, threads: int
) -> Segments:
    """Return all segments of photons (n,) behind vertices (n,), photon-major; the first of each begins at low (n,).

    Each suffix has a segment. A low of -1 keeps the first segment whole.
    """
    out, rows = _segments(paths, photons, vertices, paths.offsets[photons + 1] - 1 - vertices, threads)
    out.low[rows] = low
    return out

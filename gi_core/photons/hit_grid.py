"""Photon hits in a uniform grid, sorted by cell, and the k nearest hits of a point."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.pause import pause
from gi_core.base.vec import cell_of, difference, dot, rotate
from gi_core.geometry.receivers import NONE
from gi_core.photons.paths import Segments, rows_of
from gi_core.photons.trace import World
from gi_core.rays.accelerator import Transforms

# Cosine between normals of hit and receiver; a hit below it lies on the other side of something thin. The photon's
# direction does not decide: at the terminator of a two-sided sphere, hits on the outside also arrive from the front of
# the inside. In a corner the hits of both walls count, as in Jensen's sphere: error -15 % at edges. With one wall alone
# it is the report's 1 - alpha / 2 pi: -50 %.
OTHER_SIDE = np.float32(-0.5)


class Hits(NamedTuple):
    """Photon hits in cell order."""

    position: np.ndarray  # (n, 3) float32 [m]
    normal: np.ndarray  # (n, 3) float32 unit, of the side that was hit
    flux: np.ndarray  # (n, 3) int32, fixed-point units
    photon: np.ndarray  # (n,) int64
    bounce: np.ndarray  # (n,) int32
    own: np.ndarray  # (n,) int32, 2 patch + side of the hit
    lamp: np.ndarray  # (n,) uint8, lamp of the photon


class Nearest(NamedTuple):
    """The k nearest hits of a point, a heap with the farthest first; ties by photon, then bounce."""

    d2: np.ndarray  # (k,) float32, distance squared [m2]
    photon: np.ndarray  # (k,) int64
    bounce: np.ndarray  # (k,) int32
    hit: np.ndarray  # (k,) int64, 2 index + tag of the grid

    @classmethod
    def of(cls, k: int) -> Nearest:
        """Return memory for k hits."""
        return cls(np.empty(k, np.float32), np.empty(k, np.int64), np.empty(k, np.int32), np.empty(k, np.int64))


class HitGrid(NamedTuple):
    """Hits and the cells that contain them."""

    hits: Hits
    low: np.ndarray  # (3,) float64, corner of the grid [m]
    cell: float  # [m]
    shape: np.ndarray  # (3,) int64
    first: np.ndarray  # (cells + 1,) int64, cell c holds hits first[c] .. first[c + 1] - 1


def hits_of(segments: Segments, world: World, patch: np.ndarray, at: Transforms) -> Hits:
    """Return the hits at the ends of segments; `patch` (F,) of faces, `at`: poses of the mobiles."""
    s = rows_of(segments, segments.hit_side != NONE)
    own = 2 * patch[s.hit_side >> 1] + (s.hit_side & 1)
    normal = np.empty((s.size, 3), np.float32)
    _side_normals(s.hit_side, world.normals, at.rotation, world.face_object, normal)
    return Hits(s.hit, normal, s.flux, s.photon, s.bounce, own.astype(np.int32), s.lamp)


@kernel
def _side_normals(side, normals, rotation, face_object, out):
    for k in range(len(side)):
        n, R = normals[side[k] >> 1], rotation[face_object[side[k] >> 1]]
        s = 1.0 if side[k] & 1 == 0 else -1.0
        x, y, z = rotate(R, n)
        out[k, 0], out[k, 1], out[k, 2] = s * x, s * y, s * z


def room_for_hits(n: int) -> Hits:
    """Return uninitialised arrays of n hits."""
    vectors = (np.empty((n, 3), kind) for kind in (np.float32, np.float32, np.int32))
    return Hits(*vectors, *(np.empty(n, kind) for kind in (np.int64, np.int32, np.int32, np.uint8)))


def build(parts: list[Hits], cell: float) -> HitGrid:
    """Sort hits in parts into cells of about `cell` [m]; pauses after each part."""
    n = sum(len(p.photon) for p in parts)
    parts = [p for p in parts if len(p.photon)]
    low, high = np.zeros(3), np.zeros(3)
    if parts:
        low = np.min([p.position.min(axis=0) for p in parts], axis=0).astype(np.float64)
        high = np.max([p.position.max(axis=0) for p in parts], axis=0).astype(np.float64)
    shape, cell = _cells(high - low, cell, n)
    first = np.zeros(int(shape.prod()) + 1, np.int64)
    for p in parts:
        _count(p.position, low, cell, shape, first)
        pause()
    np.cumsum(first, out=first)
    sorted_hits, cursor = room_for_hits(n), first.copy()
    for p in parts:
        rows = np.empty(len(p.photon), np.int64)
        _place(p.position, low, cell, shape, cursor, rows)
        for to, values in zip(sorted_hits, p, strict=True):
            to[rows] = values
        pause()
    return HitGrid(sorted_hits, low, cell, shape, first)


def _cells(extent: np.ndarray, cell: float, n: int) -> tuple[np.ndarray, float]:
    """Return the number of cells along each axis, and their size, grown until memory is bounded."""
    while True:
        shape = np.floor(extent / cell).astype(np.int64) + 1
        # a bound on memory: 4 cells per hit; cells grow beyond it
        if float(shape[0]) * float(shape[1]) * float(shape[2]) <= 4 * n + 64:
            return shape, float(cell)
        cell *= 1.26


@kernel
def _key(x, y, z, low, cell, shape):
    i = min(max(cell_of(x, low[0], cell), 0), shape[0] - 1)
    j = min(max(cell_of(y, low[1], cell), 0), shape[1] - 1)
    m = min(max(cell_of(z, low[2], cell), 0), shape[2] - 1)
    return (i * shape[1] + j) * shape[2] + m


@kernel
def _count(position, low, cell, shape, first):
    """Count hits per cell at index cell + 1: the cumulative sum then gives the first hit of each cell."""
    for k in range(len(position)):
        first[_key(position[k, 0], position[k, 1], position[k, 2], low, cell, shape) + 1] += 1


@kernel
def _place(position, low, cell, shape, cursor, rows):
    """Write the row of each hit in the order of cells; cursor: the next row of each cell."""
    for k in range(len(position)):
        c = _key(position[k, 0], position[k, 1], position[k, 2], low, cell, shape)
        rows[k] = cursor[c]
        cursor[c] += 1


@kernel
def _later(heap, i, d2, photon, bounce):
    """Return whether hit i of a heap is farther than another; ties by photon, then bounce."""
    if heap.d2[i] != d2:
        return heap.d2[i] > d2
    if heap.photon[i] != photon:
        return heap.photon[i] > photon
    return heap.bounce[i] > bounce


@kernel
def _sift_down(heap, n):
    """Restore the heap order (farthest first) after its root was replaced."""
    i = 0
    while True:
        c = 2 * i + 1
        if c >= n:
            return
        if c + 1 < n and _later(heap, c + 1, heap.d2[c], heap.photon[c], heap.bounce[c]):
            c += 1
        if not _later(heap, c, heap.d2[i], heap.photon[i], heap.bounce[i]):
            return
        _swap(heap, i, c)
        i = c


@kernel
def _swap(heap, i, j):
    heap.d2[i], heap.d2[j] = heap.d2[j], heap.d2[i]
    heap.photon[i], heap.photon[j] = heap.photon[j], heap.photon[i]
    heap.bounce[i], heap.bounce[j] = heap.bounce[j], heap.bounce[i]
    heap.hit[i], heap.hit[j] = heap.hit[j], heap.hit[i]


@kernel
def _offer(d2, photon, bounce, hit, heap, n):
    """Add a hit to the nearest; return their number."""
    if n < len(heap.d2):
        heap.d2[n], heap.photon[n], heap.bounce[n], heap.hit[n] = d2, photon, bounce, hit
        i = n
        while i > 0:
            p = (i - 1) // 2
            if not _later(heap, i, heap.d2[p], heap.photon[p], heap.bounce[p]):
                break
            _swap(heap, i, p)
            i = p
        return n + 1
    if _later(heap, 0, d2, photon, bounce):
        heap.d2[0], heap.photon[0], heap.bounce[0], heap.hit[0] = d2, photon, bounce, hit
        _sift_down(heap, n)
    return n


@kernel
def gather(point, facing, mine, radius, grid, tag, cut_bounce, heap, n):
    """Add a grid's hits near a point with normal `facing` to a heap of n hits; return their number.

    Hits count on side `mine` of a patch; if that is NONE, on all surfaces that do not face away. Shells of cells are
    visited outwards until they lie behind the k-th hit. Hits of photon i from bounce cut_bounce[i] on are removed. A
    hit is stored as 2 index + tag.
    """
    (position, normal, _, photon, bounce, own, _), low, cell, shape, first = grid
    if len(photon) == 0:
        return n
    cx, cy, cz = cell_of(point[0], low[0], cell), cell_of(point[1], low[1], cell), cell_of(point[2], low[2], cell)
    r2 = radius * radius
    reach = int(math.ceil(radius / cell)) + 1
    for s in range(reach + 1):
        near = (s - 1) * cell  # lower bound of the distance to shell s
        limit = heap.d2[0] if n == len(heap.d2) else r2
        if s > 1 and near * near > limit:
            break
        for i in range(max(cx - s, 0), min(cx + s, shape[0] - 1) + 1):
            for j in range(max(cy - s, 0), min(cy + s, shape[1] - 1) + 1):
                edge = i == cx - s or i == cx + s or j == cy - s or j == cy + s
                step = 1 if edge or s == 0 else 2 * s
                for m in range(cz - s, cz + s + 1, step):
                    if m < 0 or m >= shape[2]:
                        continue
                    c = (i * shape[1] + j) * shape[2] + m
                    for h in range(first[c], first[c + 1]):
                        off = difference(position[h], point)
                        d2 = dot(off, off)
                        # Only background hits (tag 0) can be removed; added ones lie at or behind the cut.
                        if d2 > r2 or (tag == 0 and bounce[h] >= cut_bounce[photon[h]]):
                            continue
                        if mine != NONE and own[h] != mine:
                            continue
                        if not (dot(normal[h], facing) > OTHER_SIDE):
                            continue
                        n = _offer(d2, photon[h], bounce[h], 2 * h + tag, heap, n)
    return n

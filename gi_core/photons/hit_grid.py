"""Photon hits in a uniform grid, sorted by cell, and the k nearest hits of a point."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.steps import finish
from gi_core.geometry.sides import NONE
from gi_core.photons.paths import Segments, take
from gi_core.photons.trace import World
from gi_core.rays.accelerator import Transforms

# Cosine between normals of hit and receiver; a hit below it lies on the other side of something thin. The photon's
# direction does not decide: at the terminator of a two-sided sphere, hits on the outside also arrive from the front of
# the inside. In a corner the hits of both walls count, as in Jensen's sphere: error -15 % at edges. With one wall alone
# it is the report's 1 - alpha / 2 pi: -50 %.
OTHER_SIDE = np.float32(-0.5)
MAX_CELLS_PER_HIT = 4  # memory bound on cells per hit; cells grow beyond it


class Hits(NamedTuple):
    """Photon hits in cell order."""

    position: np.ndarray  # (n, 3) float32 [m]
    normal: np.ndarray  # (n, 3) float32 unit, of the side that was hit
    flux: np.ndarray  # (n, 3) int32, fixed-point units
    photon: np.ndarray  # (n,) int64
    bounce: np.ndarray  # (n,) int32
    own: np.ndarray  # (n,) int32, 2 patch + side of the hit


class HitGrid(NamedTuple):
    """Hits and the cells that contain them."""

    hits: Hits
    low: np.ndarray  # (3,) float64, corner of the grid [m]
    cell: float  # [m]
    shape: np.ndarray  # (3,) int64
    first: np.ndarray  # (cells + 1,) int64, cell c holds hits first[c] .. first[c + 1] - 1


def hits_of(segments: Segments, world: World, patch: np.ndarray, at: Transforms) -> Hits:
    """Return the hits at the ends of segments; `patch` (F,) of faces, `at`: poses of the mobiles."""
    s = take(segments, segments.hit_side != NONE)
    own = 2 * patch[s.hit_side >> 1] + (s.hit_side & 1)
    normal = np.empty((s.size, 3), np.float32)
    _side_normals(s.hit_side, world.normals, at.rotation, world.face_object, normal)
    return Hits(s.hit, normal, s.flux, s.photon, s.bounce, own.astype(np.int32))


@kernel
def _side_normals(side, normals, rotation, face_object, out):
    for k in range(len(side)):
        n, R = normals[side[k] >> 1], rotation[face_object[side[k] >> 1]]
        s = 1.0 if side[k] & 1 == 0 else -1.0
        for c in range(3):
            out[k, c] = s * (R[c, 0] * n[0] + R[c, 1] * n[1] + R[c, 2] * n[2])


def build(hits: Hits, cell: float) -> HitGrid:
    """Sort hits into cells of about `cell` [m]."""
    return finish(build_steps([hits], cell))


def build_steps(parts: list[Hits], cell: float):
    """Build the grid from hits in parts, in one step per part; the generator returns the grid."""
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
        yield
    np.cumsum(first, out=first)
    sorted_hits = Hits(
        np.empty((n, 3), np.float32),
        np.empty((n, 3), np.float32),
        np.empty((n, 3), np.int32),
        np.empty(n, np.int64),
        np.empty(n, np.int32),
        np.empty(n, np.int32),
    )
    cursor = first.copy()
    for p in parts:
        _scatter(tuple(p), low, cell, shape, cursor, tuple(sorted_hits))
        yield
    return HitGrid(sorted_hits, low, cell, shape, first)


def _cells(extent: np.ndarray, cell: float, n: int) -> tuple[np.ndarray, float]:
    """Return the number of cells along each axis, and their size, grown until memory is bounded."""
    while True:
        shape = np.floor(extent / cell).astype(np.int64) + 1
        if float(shape[0]) * float(shape[1]) * float(shape[2]) <= MAX_CELLS_PER_HIT * n + 64:
            return shape, float(cell)
        cell *= 1.26


@kernel
def cell_of(x, low, cell):
    """Return the index along one axis, not clamped."""
    return int(math.floor((x - low) / cell))


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
def _scatter(part, low, cell, shape, cursor, out):
    position, normal, flux, photon, bounce, own = part
    position2, normal2, flux2, photon2, bounce2, own2 = out
    for k in range(len(photon)):
        c = _key(position[k, 0], position[k, 1], position[k, 2], low, cell, shape)
        h = cursor[c]
        cursor[c] += 1
        photon2[h], bounce2[h], own2[h] = photon[k], bounce[k], own[k]
        for a in range(3):
            position2[h, a], normal2[h, a], flux2[h, a] = position[k, a], normal[k, a], flux[k, a]


@kernel
def _later(d2, photon, bounce, e2, other, other_bounce):
    """Return whether the first hit is farther than the second; ties by photon, then bounce."""
    if d2 != e2:
        return d2 > e2
    if photon != other:
        return photon > other
    return bounce > other_bounce


@kernel
def _sift_down(heap_d2, heap_photon, heap_bounce, heap_hit, n):
    """Restore the heap order (farthest first) after its root was replaced."""
    i = 0
    while True:
        c = 2 * i + 1
        if c >= n:
            return
        if c + 1 < n and _later(
            heap_d2[c + 1], heap_photon[c + 1], heap_bounce[c + 1], heap_d2[c], heap_photon[c], heap_bounce[c]
        ):
            c += 1
        if not _later(heap_d2[c], heap_photon[c], heap_bounce[c], heap_d2[i], heap_photon[i], heap_bounce[i]):
            return
        _swap(heap_d2, heap_photon, heap_bounce, heap_hit, i, c)
        i = c


@kernel
def _swap(heap_d2, heap_photon, heap_bounce, heap_hit, i, j):
    heap_d2[i], heap_d2[j] = heap_d2[j], heap_d2[i]
    heap_photon[i], heap_photon[j] = heap_photon[j], heap_photon[i]
    heap_bounce[i], heap_bounce[j] = heap_bounce[j], heap_bounce[i]
    heap_hit[i], heap_hit[j] = heap_hit[j], heap_hit[i]


@kernel
def _offer(d2, photon, bounce, hit, heap_d2, heap_photon, heap_bounce, heap_hit, n, k):
    """Add a hit to the k nearest; return their number."""
    if n < k:
        heap_d2[n], heap_photon[n], heap_bounce[n], heap_hit[n] = d2, photon, bounce, hit
        i = n
        while i > 0:
            p = (i - 1) // 2
            if not _later(heap_d2[i], heap_photon[i], heap_bounce[i], heap_d2[p], heap_photon[p], heap_bounce[p]):
                break
            _swap(heap_d2, heap_photon, heap_bounce, heap_hit, i, p)
            i = p
        return n + 1
    if _later(heap_d2[0], heap_photon[0], heap_bounce[0], d2, photon, bounce):
        heap_d2[0], heap_photon[0], heap_bounce[0], heap_hit[0] = d2, photon, bounce, hit
        _sift_down(heap_d2, heap_photon, heap_bounce, heap_hit, n)
    return n


@kernel
def gather(x, y, z, nx, ny, nz, mine, radius, k, grid, tag, cut_bounce, heap_d2, heap_photon, heap_bounce, heap_hit, n):
    """Add a grid's hits near (x, y, z) to the k nearest; return their number.

    Hits count on side `mine` of a patch; if that is NONE, on all surfaces that do not face away. Shells of cells are
    visited outwards until they lie behind the k-th hit. Hits of photon i from bounce cut_bounce[i] on are removed. A
    hit is stored as 2 index + tag.
    """
    (position, normal, _, photon, bounce, own), low, cell, shape, first = grid
    if len(photon) == 0:
        return n
    cx, cy, cz = cell_of(x, low[0], cell), cell_of(y, low[1], cell), cell_of(z, low[2], cell)
    r2 = radius * radius
    reach = int(math.ceil(radius / cell)) + 1
    for s in range(reach + 1):
        near = (s - 1) * cell  # lower bound of the distance to shell s
        limit = heap_d2[0] if n == k else r2
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
                        a, b, e = position[h, 0] - x, position[h, 1] - y, position[h, 2] - z
                        d2 = a * a + b * b + e * e
                        # Only background hits (tag 0) can be removed; added ones lie at or behind the cut.
                        if d2 > r2 or (tag == 0 and bounce[h] >= cut_bounce[photon[h]]):
                            continue
                        if mine != NONE and own[h] != mine:
                            continue
                        if not (normal[h, 0] * nx + normal[h, 1] * ny + normal[h, 2] * nz > OTHER_SIDE):
                            continue
                        n = _offer(
                            d2, photon[h], bounce[h], 2 * h + tag, heap_d2, heap_photon, heap_bounce, heap_hit, n, k
                        )
    return n

"""Mesh adjacency of receivers: two are neighbours if they share an edge of a face on one smooth side.

scattered_neighbours() are drawn from a wider surrounding: filters of few neighbours reach as far as those of many.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.base.random_numbers import independent
from gi_core.base.threads import CHEAP, run_ranges
from gi_core.base.vec import difference, dot

SCATTERED = 16  # neighbours at most; 12 leave a hundredth more error in changes of light, 24 a hundredth less
LOOKED_AT = 256  # receivers along the mesh, of which these are drawn
SAME_WAY = 0.9  # least cosine between normals


class Neighbours(NamedTuple):
    """Adjacency of receivers in compressed rows: the neighbours of i are of[first[i] : first[i + 1]]."""

    first: np.ndarray  # (n + 1,) int64
    of: np.ndarray  # (k,) int32


def neighbours(corners: np.ndarray, n: int) -> Neighbours:
    """Return the neighbours of n receivers; corners (m, 3) int: receivers of each face, of fronts and backs."""
    corners = np.ascontiguousarray(corners, np.int32)
    most = np.concatenate([[0], np.cumsum(2 * np.bincount(corners.reshape(-1), minlength=n))])[: n + 1]
    room = np.empty(most[-1], np.int32)
    count = np.zeros(n, np.int64)
    _join(corners, most, room, count)
    first = np.concatenate([[0], np.cumsum(count)])
    of = np.empty(first[-1], np.int32)
    _pack(most, room, first, of)
    return Neighbours(first, of)


def without(near: Neighbours, edges: np.ndarray) -> Neighbours:
    """Return neighbours less those that edges (k, 2) int join."""
    n = len(near.first) - 1
    row, ends = np.repeat(np.arange(n), np.diff(near.first)), edges.astype(np.int64)
    kept = ~np.isin(row * n + near.of, np.concatenate([ends @ (n, 1), ends @ (1, n)]))
    return _rows(row[kept], near.of[kept], n)


def among(near: Neighbours, rows: np.ndarray) -> Neighbours:
    """Return the neighbours among some receivers, ascending rows (k,) int, numbered by their place there."""
    place = np.full(len(near.first) - 1, -1, np.int32)
    place[rows] = np.arange(len(rows))
    of, ends = np.repeat(place, np.diff(near.first)), place[near.of]
    kept = (of >= 0) & (ends >= 0)
    return _rows(of[kept], ends[kept], len(rows))


def open_sides(corners: np.ndarray, near: Neighbours) -> np.ndarray:
    """Return for each side of faces with an edge that `near` lacks a side without one at each corner, else -1.

    corners (m, 3) int: receivers of each side, -1: none; result (m, 3) int32, the side itself where there is no other.
    """
    n, ends = len(near.first) - 1, corners.astype(np.int64)
    joined = np.isin(ends * n + ends[:, [1, 2, 0]], np.repeat(np.arange(n) * n, np.diff(near.first)) + near.of)
    lit = (corners >= 0).all(axis=1)
    whole, divided = np.flatnonzero(lit & joined.all(axis=1)), np.flatnonzero(lit & ~joined.all(axis=1))
    at, out = np.full(n, -1, np.int32), np.full(corners.shape, -1, np.int32)
    at[corners[whole]] = whole[:, None]
    other = at[corners[divided]]
    out[divided] = np.where(other >= 0, other, divided[:, None])
    return out


def _rows(row: np.ndarray, of: np.ndarray, n: int) -> Neighbours:
    """Return neighbours `of` (k,) of ascending rows (k,) as a record of n rows."""
    return Neighbours(np.concatenate([[0], np.cumsum(np.bincount(row, minlength=n))]), of)


def scattered_neighbours(
    near: Neighbours, positions: np.ndarray, normals: np.ndarray, reach: float, threads: int
) -> Neighbours:
    """Return for each receiver up to SCATTERED others within `reach` [m], connected along the mesh, drawn at random.

    near: along edges; positions [m] and normals (n, 3). Creases end the surrounding, as does a turn of the surface.
    """
    # rounding by 1e-6: on regular meshes many receivers lie at the limit
    n, farthest = len(positions), (reach * (1.0 + 1e-6)) ** 2
    room, count = np.empty((n, SCATTERED), np.int32), np.zeros(n, np.int64)
    # 4096 receivers per thread
    run_ranges(lambda _, a, b: _scatter(*near, positions, normals, farthest, a, b, room, count), n, threads, CHEAP)
    return Neighbours(np.concatenate([[0], np.cumsum(count)]), room[np.arange(SCATTERED) < count[:, None]])


@allocating
def _scatter(first, of, positions, normals, farthest, start, stop, room, count):
    """Visit the surrounding of each receiver breadth first, and draw from it by reservoir sampling (Vitter 1985)."""
    seen, queue = np.full(len(positions), -1, np.int64), np.empty(LOOKED_AT, np.int64)
    for i in range(start, stop):
        seen[i], queue[0], ends, at = i, i, 1, 0
        while at < ends and ends < LOOKED_AT:
            here = queue[at]
            at += 1
            for k in range(first[here], first[here + 1]):
                j = of[k]
                if seen[j] == i or ends == LOOKED_AT:
                    continue
                seen[j] = i
                off = difference(positions[i], positions[j])
                if dot(off, off) > farthest or dot(normals[i], normals[j]) <= SAME_WAY:
                    continue
                queue[ends] = j
                place = ends - 1
                if place >= SCATTERED:
                    place = int(independent(0, i, j, 0) * ends)
                if place < SCATTERED:
                    room[i, place] = j
                ends += 1
        count[i] = min(ends - 1, SCATTERED)


@kernel
def _join(corners, start, room, count):
    """List both ends of every edge as each other's neighbour, once."""
    for f in range(len(corners)):
        for a in range(3):
            i = corners[f, a]
            for b in range(3):
                j = corners[f, b]
                if j == i:
                    continue
                listed = False
                for k in range(start[i], start[i] + count[i]):
                    listed |= room[k] == j
                if not listed:
                    room[start[i] + count[i]] = j
                    count[i] += 1


@kernel
def _pack(start, room, first, of):
    for i in range(len(first) - 1):
        for k in range(first[i + 1] - first[i]):
            of[first[i] + k] = room[start[i] + k]

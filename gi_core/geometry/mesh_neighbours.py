"""Mesh adjacency of receivers: two are neighbours if they share an edge of a face on one smooth side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel


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
                known = False
                for k in range(start[i], start[i] + count[i]):
                    known |= room[k] == j
                if not known:
                    room[start[i] + count[i]] = j
                    count[i] += 1


@kernel
def _pack(start, room, first, of):
    for i in range(len(first) - 1):
        for k in range(first[i + 1] - first[i]):
            of[first[i] + k] = room[start[i] + k]

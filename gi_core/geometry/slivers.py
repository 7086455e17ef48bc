"""Slivers, long thin triangles, are cut across; halving all edges would make 3^n pieces instead of 2^n."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Pieces(NamedTuple):
    """Pieces of slivers."""

    points: np.ndarray  # (n, 3, 3) float64 [m]
    source: np.ndarray  # (n,) int64, index of the sliver
    weights: np.ndarray  # (n, 3, 3) of the sliver's corners, at each corner


def cut_across(corners: np.ndarray, too_long: Callable, most: int) -> Pieces | None:
    """Return the pieces of triangles (F, 3, 3) after cuts between points on their edges; None for more than `most`.

    too_long(a, b): a function of points (n, 3) that returns which edges are halved, again and again, as a neighbour
    halves them. The longest edge of every triangle must be too long.
    """
    stops = _stops(corners, too_long, most)
    if stops is None:
        return None
    face, edge, t = stops
    sides = corners - np.roll(corners, -1, axis=1)
    longest = np.argmax((sides * sides).sum(axis=2), axis=1)
    weights = np.zeros((len(face), 3))
    rows = np.arange(len(face))
    weights[rows, edge] += 1 - t
    weights[rows, (edge + 1) % 3] += t
    # Two paths lead from the start of the longest edge to its end: along it, and past the opposite corner.
    first = longest[face]
    other = edge != first
    start = (edge == first) & (t == 0)
    end = (edge == (first + 1) % 3) & (t == 0)
    s, e = corners[np.arange(len(corners)), longest], corners[np.arange(len(corners)), (longest + 1) % 3]
    d = e - s
    points = (weights[:, :, None] * corners[face]).sum(axis=1)
    along = ((points - s[face]) * d[face]).sum(axis=1) / (d * d).sum(axis=1)[face]
    # Both paths take their first step first: three points on one edge form no triangle.
    order = np.lexsort((along, end, other, face))
    order = order[~(start | end)[order]]
    for way, key in ((False, -2.0), (True, -1.0)):
        of_way = order[other[order] == way]
        along[of_way[np.append(True, face[of_way][1:] != face[of_way][:-1])]] = key
    along[end] = 4.0
    other[end] = False
    rows = np.flatnonzero(~start)
    rows = rows[np.lexsort((along[rows], face[rows]))]
    origin = np.zeros(len(corners), np.int64)
    origin[face[start]] = np.flatnonzero(start)
    here = [_last(rows, face, other == way, origin) for way in (False, True)]
    triangles = np.stack([here[0], rows, here[1]], axis=1)
    triangles = triangles[np.append(False, face[rows][1:] == face[rows][:-1])]  # the first step alone spans nothing
    exact = _exact(corners, face, edge, t)
    return Pieces(exact[triangles], face[triangles[:, 1]], weights[triangles])


def _stops(corners, too_long, most):
    """Return face, edge and position along it (0 to 1) of every start and cut of an edge; None for too many."""
    n = len(corners)
    face, edge = np.repeat(np.arange(n), 3), np.tile(np.arange(3), n)
    low, step = np.zeros(3 * n), np.ones(3 * n)
    a, b = corners.reshape(-1, 3), np.roll(corners, -1, axis=1).reshape(-1, 3)
    done = []
    total = 0
    while len(face):
        split = too_long(a, b)
        done.append((face[~split], edge[~split], low[~split]))
        total += len(done[-1][0])
        face, edge, low, step, a, b = (c[split] for c in (face, edge, low, step, a, b))
        if total + 2 * len(face) > most:
            return None
        middle = 0.5 * (a + b)
        face, edge, step = (np.concatenate([c, c]) for c in (face, edge, step / 2))
        low = np.concatenate([low, low + step[: len(low)]])
        a, b = np.concatenate([a, middle]), np.concatenate([middle, b])
    return tuple(np.concatenate(c) for c in zip(*done, strict=True))


def _exact(corners, face, edge, t) -> np.ndarray:
    """Return the points (n, 3) by the same halvings that a neighbour makes, so that all bits agree."""
    a, b = corners[face, edge], corners[face, (edge + 1) % 3]
    rest = t.copy()
    going = rest > 0
    out = a.copy()
    while going.any():
        middle = 0.5 * (a + b)
        upper = rest >= 0.5
        arrived = going & (rest == 0.5)
        out[arrived] = middle[arrived]
        going &= ~arrived
        a = np.where(upper[:, None], middle, a)
        b = np.where(upper[:, None], b, middle)
        rest = 2 * rest - upper
    return out


def _last(rows, face, mine, origin) -> np.ndarray:
    """Return for each step the previous point of its path."""
    place = np.arange(len(rows))
    first = np.append(True, face[rows][1:] != face[rows][:-1])
    begin = np.maximum.accumulate(np.where(first, place, 0))
    seen = np.maximum.accumulate(np.where(mine[rows], place, -1))
    before = np.append(-1, seen[:-1])
    return np.where(before >= begin, rows[np.maximum(before, 0)], origin[face[rows]])

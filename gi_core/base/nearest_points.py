"""Nearest neighbours and neighbour counts by a sweep along the longest axis.

Made for a few thousand queries; a k-d tree pays only with more.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import allocating


def nearest(points: np.ndarray, queries: np.ndarray, k: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return distance (m,) float64 and index (m,) int64 of the k-th nearest point of each query.

    points: (n, d), n >= k >= 1; queries: (m, d).
    """
    order, axis = _along_longest(points)
    distance, place = _nearest(_contiguous(points[order]), _contiguous(queries), axis, k)
    return distance, order[place]


def count_within(points: np.ndarray, queries: np.ndarray, reach: float) -> np.ndarray:
    """Return the number (m,) int64 of points (n, d) within distance `reach` of each query (m, d)."""
    order, axis = _along_longest(points)
    return _count(_contiguous(points[order]), _contiguous(queries), axis, float(reach))


def _along_longest(points: np.ndarray) -> tuple[np.ndarray, int]:
    axis = int(np.ptp(points, axis=0).argmax()) if len(points) else 0
    return np.argsort(points[:, axis], kind="stable"), axis


def _contiguous(points: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(points, np.float64)


@allocating
def _nearest(points, queries, axis, k):
    n, m = len(points), len(queries)
    distance, place = np.empty(m), np.empty(m, np.int64)
    best, which = np.empty(k), np.empty(k, np.int64)
    for q in range(m):
        best[:] = np.inf
        x = queries[q, axis]
        right = np.searchsorted(points[:, axis], x)
        left = right - 1
        # Go outwards, always to the nearer side along the axis, until that distance alone exceeds the k-th best.
        while left >= 0 or right < n:
            ahead = points[right, axis] - x if right < n else np.inf
            behind = x - points[left, axis] if left >= 0 else np.inf
            if ahead < behind:
                i, gap = right, ahead
                right += 1
            else:
                i, gap = left, behind
                left -= 1
            if gap * gap > best[k - 1]:
                break
            squared = 0.0
            for c in range(queries.shape[1]):
                step = points[i, c] - queries[q, c]
                squared += step * step
            if squared >= best[k - 1]:
                continue
            j = k - 1
            while j > 0 and best[j - 1] > squared:
                best[j], which[j] = best[j - 1], which[j - 1]
                j -= 1
            best[j], which[j] = squared, i
        distance[q], place[q] = math.sqrt(best[k - 1]), which[k - 1]
    return distance, place


@allocating
def _count(points, queries, axis, reach):
    m = len(queries)
    count = np.zeros(m, np.int64)
    for q in range(m):
        first = np.searchsorted(points[:, axis], queries[q, axis] - reach)
        for i in range(first, len(points)):
            if points[i, axis] > queries[q, axis] + reach:
                break
            squared = 0.0
            for c in range(queries.shape[1]):
                step = points[i, c] - queries[q, c]
                squared += step * step
            if squared <= reach * reach:
                count[q] += 1
    return count

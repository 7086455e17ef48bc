"""Neighbours among points: the nearest, their count, and an order in which neighbours in space are neighbours.

Searches sweep along the longest axis, made for a few thousand queries; a k-d tree pays only with more. The order is
that along a Hilbert curve. Mobiles are rigid, so the order of their receivers holds in every frame (report 2.6).
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


BITS = 10  # per axis: a curve through 2^30 cells


def hilbert_order(points: np.ndarray) -> np.ndarray:
    """Return the indices (n,) that sort points (n, 3) along a Hilbert curve through their bounding cube."""
    if not len(points):
        return np.zeros(0, np.int64)
    low = points.min(axis=0).astype(np.float64)
    edge = max(float(np.ptp(points, axis=0).max()), 1e-30)
    cell = ((points - low) * ((1 << BITS) - 1) / edge).astype(np.int64).T
    return np.argsort(_key(_transposed(cell)), kind="stable")


def _transposed(x: np.ndarray) -> np.ndarray:
    """Return cells (3, n) int64 as transposed Hilbert indices (3, n): interleaved index bits (Skilling 2004)."""
    x = x.copy()
    for bit in reversed(range(1, BITS)):
        q = 1 << bit
        for axis in range(3):
            turned = (x[0] ^ x[axis]) & (q - 1)
            flip = (x[axis] & q) != 0
            x[0] ^= np.where(flip, q - 1, turned)
            x[axis] ^= np.where(flip, 0, turned)
    for axis in (1, 2):
        x[axis] ^= x[axis - 1]
    gray = np.zeros_like(x[0])
    for bit in reversed(range(1, BITS)):
        gray ^= np.where(x[2] & (1 << bit), (1 << bit) - 1, 0)
    return x ^ gray


def _key(x: np.ndarray) -> np.ndarray:
    """Interleave the bits of three numbers (3, n) into indices (n,) int64, the first number's highest."""
    key = np.zeros(x.shape[1], np.int64)
    for bit in reversed(range(BITS)):
        for axis in range(3):
            key = key << 1 | x[axis] >> bit & 1
    return key

"""The order of points along a Hilbert curve: neighbours in the list are neighbours in space.

Computed once per object. Mobiles are rigid, so the order of their receivers holds in every frame (report 2.6).
"""

from __future__ import annotations

import numpy as np

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

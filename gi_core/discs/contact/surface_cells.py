"""Coarse occupancy grid of the static surfaces, which selects receivers of mobiles near them.

A mobile in mid-air costs a lookup of the cells that its box covers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.pause import pause
from gi_core.base.vec import cross, difference, dot, rotate
from gi_core.photons.hit_grid import cell_of

FACES_PER_STEP = 4096


class SurfaceCells(NamedTuple):
    """Grid cells, marked if a surface lies within a given distance of any of their points."""

    near: np.ndarray  # (cells,) bool
    low: np.ndarray  # (3,) float64, corner of the grid [m]
    cell: float  # [m]
    shape: np.ndarray  # (3,) int64


def surface_cells(vertices: np.ndarray, faces: np.ndarray, reach: float) -> SurfaceCells:
    """Mark the cells within `reach` [m] of faces (F, 3) of vertices (V, 3)."""
    if not len(faces):
        return SurfaceCells(np.zeros(1, bool), np.full(3, np.inf), 1.0, np.ones(3, np.int64))
    low, high = vertices.min(axis=0) - reach, vertices.max(axis=0) + reach
    cell = max(reach, float((high - low).max()) / 1024)
    while float(np.prod(np.floor((high - low) / cell) + 1)) > 1 << 22:  # 1 << 22 cells, 4 MB; cells grow instead
        cell *= 1.26
    shape = np.floor((high - low) / cell).astype(np.int64) + 1
    near = np.zeros(int(shape.prod()), bool)
    for first in range(0, len(faces), FACES_PER_STEP):
        _mark(vertices, faces[first : first + FACES_PER_STEP], reach, low, cell, shape, near)
        pause()
    return SurfaceCells(near, low, cell, shape)


@kernel
def _range(a, b, low, cell, n):
    """Return the first and last cell that [a, b] covers along an axis; last < first for none."""
    first, last = (a - low) / cell, (b - low) / cell
    if not (last >= 0.0 and first < n):
        return 0, -1
    return max(int(math.floor(max(first, 0.0))), 0), min(int(math.floor(min(last, float(n)))), n - 1)


@kernel
def _mark(vertices, faces, reach, low, cell, shape, near):
    """Mark cells near the box and near the plane of a triangle; tilted floors have large boxes."""
    half = reach + 0.8661 * cell  # half the diagonal of a cell, rounded up
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        nx, ny, nz = cross(difference(b, a), difference(c, a))
        limit = half * math.sqrt(dot((nx, ny, nz), (nx, ny, nz)))
        x0, x1 = _range(min(a[0], b[0], c[0]) - reach, max(a[0], b[0], c[0]) + reach, low[0], cell, shape[0])
        y0, y1 = _range(min(a[1], b[1], c[1]) - reach, max(a[1], b[1], c[1]) + reach, low[1], cell, shape[1])
        z0, z1 = _range(min(a[2], b[2], c[2]) - reach, max(a[2], b[2], c[2]) + reach, low[2], cell, shape[2])
        for x in range(x0, x1 + 1):
            dx = nx * (low[0] + (x + 0.5) * cell - a[0])
            for y in range(y0, y1 + 1):
                dy = dx + ny * (low[1] + (y + 0.5) * cell - a[1])
                for z in range(z0, z1 + 1):
                    if abs(dy + nz * (low[2] + (z + 0.5) * cell - a[2])) <= limit:
                        near[(x * shape[1] + y) * shape[2] + z] = True


@kernel
def box_is_near(near, low, cell, shape, box_low, box_high):
    """Return whether any cell that a box covers is marked."""
    x0, x1 = _range(box_low[0], box_high[0], low[0], cell, shape[0])
    y0, y1 = _range(box_low[1], box_high[1], low[1], cell, shape[1])
    z0, z1 = _range(box_low[2], box_high[2], low[2], cell, shape[2])
    for x in range(x0, x1 + 1):
        for y in range(y0, y1 + 1):
            for z in range(z0, z1 + 1):
                if near[(x * shape[1] + y) * shape[2] + z]:
                    return True
    return False


@kernel
def points_near(near, low, cell, shape, points, R, p, out):
    """List the points (n, 3), moved to the world by R and p, that lie in marked cells; return their number."""
    n = 0
    for k in range(len(points)):
        x, y, z = rotate(R, points[k])
        i, j, m = cell_of(x + p[0], low[0], cell), cell_of(y + p[1], low[1], cell), cell_of(z + p[2], low[2], cell)
        if 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= m < shape[2] and near[(i * shape[1] + j) * shape[2] + m]:
            out[n] = k
            n += 1
    return n

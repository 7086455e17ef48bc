"""Uniform grid with the traversal of Amanatides and Woo 1987, "A fast voxel traversal algorithm for ray tracing".

Departure: the distance of the next plane is computed from the number of the cell, not summed, so that its error does
not grow along the ray.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.rays.cells import Cells, boxes_of, enter_box, visit
from gi_core.rays.triangles import Meshes, touches, triangles_of


class Grid3d(NamedTuple):
    """Equal cells, x fastest."""

    cells: Cells
    count: np.ndarray  # (objects, 3) int64, cells per axis
    step: np.ndarray  # (objects, 3) float64, size of a cell [m]
    start: np.ndarray  # (objects,) int64, first cell


def build(meshes: Meshes, leaf: float = 0.25) -> Grid3d:
    """Return the structure of all objects, with `leaf` triangles per cell on average."""
    triangles = triangles_of(meshes)
    low, high = boxes_of(triangles)
    size = np.maximum(high - low, 1e-30)
    count, first, listed = np.ones((len(meshes), 3), np.int64), [np.zeros(1, np.int64)], []
    for o, (a, b) in enumerate(zip(triangles.first[:-1], triangles.first[1:], strict=True)):
        count[o] = _resolution(size[o], min((b - a) / leaf, 1 << 22))  # 1 << 22 cells per object at most
        ends = np.zeros(count[o].prod() + 1, np.int64)
        arguments = triangles.corners, a, b, triangles.padding[o], low[o], size[o] / count[o], count[o]
        _list(*arguments, ends, np.empty(0, np.int32))
        np.cumsum(ends, out=ends)
        listed.append(np.empty(ends[-1], np.int32))
        _list(*arguments, ends[:-1].copy(), listed[-1])
        first.append(first[-1][-1] + ends[1:])
    cells = Cells(triangles, np.concatenate(first), np.concatenate(listed), low, high)
    starts = np.cumsum([0, *count.prod(axis=1)[:-1]]).astype(np.int64)
    return Grid3d(cells, count, size / count, starts)


def _resolution(size: np.ndarray, cells: float) -> np.ndarray:
    """Return cells per axis (3,) int64: nearly cubes, some `cells` in all; flat boxes have one layer."""
    count = np.ones(3)
    for flat in range(3):  # axes that would get less than one cell leave the others more
        open_ = np.argsort(size)[flat:]
        edge = (size[open_].prod() / max(cells, 1.0)) ** (1 / len(open_))
        if (size[open_] >= edge).all():
            count[open_] = size[open_] / edge
            break
    return np.maximum(count, 1).astype(np.int64)


@kernel
def _list(corners, a, b, padding, low, step, count, ends, listed):
    """Count the triangles of each cell into ends[1:], or, with `listed`, write them there from `ends` on."""
    for k in range(a, b):
        i0, i1 = _span(corners, k, 0, padding, low, step, count)
        j0, j1 = _span(corners, k, 1, padding, low, step, count)
        l0, l1 = _span(corners, k, 2, padding, low, step, count)
        for m in range(l0, l1):
            z = low[2] + m * step[2]
            for j in range(j0, j1):
                y = low[1] + j * step[1]
                for i in range(i0, i1):
                    x = low[0] + i * step[0]
                    if touches(corners, k, padding, x, y, z, x + step[0], y + step[1], z + step[2]):
                        cell = (m * count[1] + j) * count[0] + i
                        if len(listed):
                            listed[ends[cell]] = k
                            ends[cell] += 1
                        else:
                            ends[cell + 1] += 1


@kernel
def _span(corners, k, axis, padding, low, step, count):
    """Return the first cell along an axis that a triangle may touch, and the one after the last."""
    a, b, c = corners[k, axis], corners[k, 3 + axis], corners[k, 6 + axis]
    first = np.int64((min(a, min(b, c)) - padding - low[axis]) / step[axis])
    last = np.int64((max(a, max(b, c)) + padding - low[axis]) / step[axis])
    return max(first - 1, 0), min(last + 2, count[axis])


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    r, enter, leave, best, best_face = enter_box(s.cells, o, ray, ox, oy, oz, dx, dy, dz, limit)
    if enter > leave:
        return np.float32(best), np.int32(best_face)
    low, step, count = s.cells.low, s.step, s.count
    nx, ny, nz = count[o, 0], count[o, 1], count[o, 2]
    lx, ly, lz, ex, ey, ez = low[o, 0] - r.x, low[o, 1] - r.y, low[o, 2] - r.z, step[o, 0], step[o, 1], step[o, 2]
    i = min(max(np.int64((enter * r.dx - lx) / ex), 0), nx - 1)
    j = min(max(np.int64((enter * r.dy - ly) / ey), 0), ny - 1)
    k = min(max(np.int64((enter * r.dz - lz) / ez), 0), nz - 1)
    ux, uy, uz = np.int64(r.ix > 0.0), np.int64(r.iy > 0.0), np.int64(r.iz > 0.0)
    tx, ty, tz = (lx + (i + ux) * ex) * r.ix, (ly + (j + uy) * ey) * r.iy, (lz + (k + uz) * ez) * r.iz
    while True:
        best, best_face = visit(s.cells, o, s.start[o] + (k * ny + j) * nx + i, ray, r, best, best_face)
        t = min(tx, min(ty, tz))
        if t > best or (any_hit and best_face >= 0):
            break
        if t == tx:
            i += 2 * ux - 1
            if i < 0 or i >= nx:
                break
            tx = (lx + (i + ux) * ex) * r.ix
        elif t == ty:
            j += 2 * uy - 1
            if j < 0 or j >= ny:
                break
            ty = (ly + (j + uy) * ey) * r.iy
        else:
            k += 2 * uz - 1
            if k < 0 or k >= nz:
                break
            tz = (lz + (k + uz) * ez) * r.iz
    return np.float32(best), np.int32(best_face)

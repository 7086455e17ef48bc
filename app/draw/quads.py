"""Quadrilaterals of a mesh: two triangles in one plane that share the longest edge of both.

They are convex: both angles of a triangle at its longest edge are acute.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import cross, dot

OFF_PLANE = 1e-4  # of the diagonal: distance of a corner from the plane of the others; the same for texture coordinates


class Quads(NamedTuple):
    """Quadrilaterals of a mesh: triangles (a, b, c) and (d, c, b); with the other diagonal (a, b, d) and (d, c, a)."""

    faces: np.ndarray  # (q, 2) int64, the two triangles
    corners: np.ndarray  # (4, q) int64 vertices a, b, d, c, in this order around the quadrilateral
    beside: np.ndarray | None = None  # (F,) int32, the other triangle of a quad drawn with its other diagonal, or -1


NO_QUADS = Quads(np.zeros((0, 2), np.int64), np.zeros((4, 0), np.int64))


def quads_of(
    positions: np.ndarray, triangles: np.ndarray, uv: np.ndarray | None = None, usable: np.ndarray | None = None
) -> Quads:
    """Return the quadrilaterals of triangles (F, 3) into positions (D, 3).

    uv (D, 2): texture coordinates, which must lie in an affine image of the plane; usable (F,): None for all faces.
    """
    p = positions.astype(np.float64)[triangles]
    edges = p[:, [2, 0, 1]] - p[:, [1, 2, 0]]  # opposite each corner
    apex = dot(edges, edges).argmax(axis=1)
    turned = np.take_along_axis(triangles, (apex[:, None] + np.arange(3)) % 3, axis=1)  # apex, then the longest edge
    rows = np.arange(len(triangles)) if usable is None else np.flatnonzero(usable)
    low, high = np.sort(turned[rows, 1:], axis=1).T
    order = np.lexsort((low, high))
    rows, low, high = rows[order], low[order], high[order]
    same = (low[1:] == low[:-1]) & (high[1:] == high[:-1])
    third = np.r_[False, same] & np.r_[same, False]  # of three triangles at an edge, the middle one
    first = np.flatnonzero(same & ~(third[1:] | third[:-1]))
    one, two = turned[rows[first]], turned[rows[first + 1]]
    facing = one[:, 1] == two[:, 2]  # else the triangles overlap, or their fronts differ
    faces = np.stack([rows[first], rows[first + 1]], axis=1)[facing]
    corners = np.stack([one[:, 0], one[:, 1], two[:, 0], one[:, 2]])[:, facing]
    good = _is_flat(positions, uv, corners)
    return Quads(faces[good], np.ascontiguousarray(corners[:, good], np.int64))  # a picture gathers a row at a time


def _is_flat(positions: np.ndarray, uv: np.ndarray | None, corners: np.ndarray) -> np.ndarray:
    """Return whether quadrilaterals (q,) lie in planes, and their texture coordinates in affine images of these."""
    a, b, d, c = positions.astype(np.float64)[corners]
    u, v, w = b - a, c - a, d - a
    normal = cross(u, v)
    area = np.maximum(dot(normal, normal), 1e-300)
    x, y = (dot(cross(w, v), normal) / area)[:, None], (dot(cross(u, w), normal) / area)[:, None]
    good = np.abs(w - x * u - y * v).max(axis=1) <= OFF_PLANE * np.sqrt(dot(c - b, c - b))
    if uv is not None:
        a, b, d, c = uv.astype(np.float64)[corners]
        off = np.abs(d - a - x * (b - a) - y * (c - a)).max(axis=1)
        good &= off <= OFF_PLANE * np.abs(c - b).max(axis=1) + 1e-12
    return good

"""Diagonals of quadrilaterals, chosen by their light: data-dependent triangulation (Dyn, Levin and Rippa 1990).

Both diagonals of a plane quadrilateral give the same surface. Across a border of light, the wrong one interpolates to
teeth. A picture draws the diagonal whose ends differ less, which lies along the border. Receivers, their light and its
errors do not change. docs/decisions/036-diagonals.md has the measurements.
"""

from __future__ import annotations

import numpy as np

from app.draw.draw_mesh import DrawMesh, with_vertices
from app.draw.quads import Quads
from gi_core.geometry.error import REC709

LUMINANCE = REC709.astype(np.float32)


def other_diagonals(
    mesh: DrawMesh, front: np.ndarray, back: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Return which quadrilaterals (q,) bool are drawn with the diagonal that their triangles do not share.

    front, back (D, 3) float32: colours of draw vertices; weights (D, 2): of interpolation, None: all 1. A quadrilateral
    with an unreached corner keeps its diagonal.
    """
    shared = other = np.float32(0.0)
    for side in (front, back) if (mesh.back >= 0).any() else (front,):
        a, b, d, c = (side @ LUMINANCE)[mesh.quads.corners]
        shared, other = shared + np.abs(b - c), other + np.abs(a - d)
    out = np.less(other, shared)
    if weights is not None:
        out &= ((weights[:, 0] == 1) & (weights[:, 1] == 1))[mesh.quads.corners].all(axis=0)
    return out


def with_diagonals(mesh: DrawMesh, others: np.ndarray) -> DrawMesh:
    """Return the mesh with the other diagonal in some of its quadrilaterals, others (q,) bool."""
    triangles, beside = mesh.triangles.copy(), np.full(len(mesh.triangles), -1, np.int32)
    quads = Quads(mesh.quads.faces[others], mesh.quads.corners[:, others])
    triangles[quads.faces], beside[quads.faces] = quads.others, quads.faces[:, ::-1]
    return mesh._replace(triangles=triangles, beside=beside)


def along_light(mesh: DrawMesh, front: np.ndarray, back: np.ndarray, weights: np.ndarray | None = None) -> DrawMesh:
    """Return the mesh with the diagonals for its colours; arguments as for other_diagonals()."""
    return with_diagonals(mesh, other_diagonals(mesh, front, back, weights))


def quad_around(mesh: DrawMesh, face: int) -> DrawMesh:
    """Return the mesh of a face, as triangle 0, and of its quadrilateral."""
    k, place = np.nonzero(mesh.quads.faces == face)
    if not len(k):
        return with_vertices(mesh, mesh.triangles[face], [[0, 1, 2]])
    corners = mesh.quads.corners[[2, 3, 0, 1] if place[0] else [0, 1, 2, 3], k[0]]
    quad = Quads(np.array([[0, 1]]), np.arange(4)[:, None])
    return with_vertices(mesh, corners, [[0, 1, 3], [2, 3, 1]])._replace(quads=quad)

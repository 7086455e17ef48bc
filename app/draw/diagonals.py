"""Diagonals of quadrilaterals, chosen by their light: data-dependent triangulation (Dyn, Levin and Rippa 1990).

Both diagonals of a plane quadrilateral give the same surface. Across a border of light, the wrong one interpolates to
teeth. A picture draws the diagonal whose ends differ less, which lies along the border. Receivers, their light and its
errors do not change. docs/decisions/drawn-light.md has the measurements.
"""

from __future__ import annotations

import numpy as np

from app.draw.draw_mesh import DrawMesh, Quads, with_vertices
from gi_core.display.vertex_light import follow_light, turn_triangles

NO_WEIGHTS = np.zeros((0, 2), np.float32)


def other_diagonals(
    mesh: DrawMesh, front: np.ndarray, back: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Return which quadrilaterals (q,) bool are drawn with the diagonal that their triangles do not share.

    front, back (D, 3) float32: colours of draw vertices; weights (D, 2): of interpolation, None: all 1. A quadrilateral
    with an unreached corner keeps its diagonal.
    """
    light, out = np.empty((len(front), 2), np.float32), np.empty(len(mesh.quads.faces), bool)
    follow_light(mesh.quads.corners, front, back, NO_WEIGHTS if weights is None else weights, light, out)
    return out


def with_diagonals(mesh: DrawMesh, turned: np.ndarray) -> DrawMesh:
    """Return the mesh with the other diagonal in those of its quadrilaterals that are turned (q,) bool."""
    turning, beside = Turning(mesh), np.full(len(mesh.triangles), -1, np.int32)
    turning.turn(turned)
    faces = mesh.quads.faces[turned]
    beside[faces] = faces[:, ::-1]
    return mesh._replace(triangles=turning.triangles, quads=mesh.quads._replace(beside=beside))


class Turning:
    """Triangles of a mesh whose quadrilaterals take either diagonal, again and again."""

    def __init__(self, mesh: DrawMesh) -> None:
        self.triangles = mesh.triangles.astype(np.int32)  # (F, 3); of one order of corners, however often they turn
        self.triangles[mesh.quads.faces] = mesh.quads.corners.T[:, [[0, 1, 3], [2, 3, 1]]]
        self._quads, self._turned = mesh.quads, np.zeros(len(mesh.quads.faces), bool)

    def turn(self, turned: np.ndarray) -> bool:
        """Set which quadrilaterals (q,) bool have the other diagonal; return whether any triangle changes."""
        changed = turn_triangles(turned, self._turned, self._quads.faces, self._quads.corners, self.triangles)
        self._turned = turned
        return changed > 0


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

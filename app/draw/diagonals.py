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
    quads, light = mesh.quads, front @ LUMINANCE
    if weights is not None:
        light[np.flatnonzero(weights != 1) // 2] = np.nan  # no diagonal differs less than nan
    shared, other = _differences(light.take(quads.corners))
    both = slice(None) if quads.two_sided is None else quads.two_sided
    of_back = _differences(back[quads.corners[:, both]] @ LUMINANCE)
    shared[both] += of_back[0]
    other[both] += of_back[1]
    return np.less(other, shared)


def _differences(light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how much light (4, q) differs along each diagonal (q,): the shared one, then the other."""
    a, b, d, c = light
    return np.abs(b - c), np.abs(a - d)


def with_diagonals(mesh: DrawMesh, others: np.ndarray) -> DrawMesh:
    """Return the mesh with the other diagonal in some of its quadrilaterals, others (q,) bool."""
    turning, beside = Turning(mesh), np.full(len(mesh.triangles), -1, np.int32)
    turning.turn(others)
    faces = mesh.quads.faces[others]
    beside[faces] = faces[:, ::-1]
    return mesh._replace(triangles=turning.triangles, beside=beside)


class Turning:
    """Triangles of a mesh whose quadrilaterals take either diagonal, again and again."""

    def __init__(self, mesh: DrawMesh) -> None:
        self.triangles = mesh.triangles.astype(np.int32)  # (F, 3)
        self._faces, self._others = mesh.quads.faces, np.zeros(len(mesh.quads.faces), bool)
        pairs = np.concatenate([self.triangles[self._faces], mesh.quads.others]).astype(np.int32)
        self._pairs = pairs.reshape(-1, 6)  # (2 q, 6): with the shared diagonals, then with the others

    def turn(self, others: np.ndarray) -> bool:
        """Set which quadrilaterals (q,) bool have the other diagonal; return whether any triangle changes."""
        changed = np.flatnonzero(others != self._others)
        pairs = self._pairs.take(changed + len(others) * others[changed], axis=0)
        rows = self.triangles.view("V12")  # numpy copies a row of 12 bytes four times as fast as three numbers
        rows[self._faces.take(changed, axis=0).reshape(-1)] = pairs.reshape(-1, 3).view("V12")
        self._others = others
        return len(changed) > 0


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

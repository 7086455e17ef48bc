"""Faces that are in the open and have all corners inside other parts: the rails of a chair, a shelf between two walls.

Light is stored at corners. Those inside a leg or a wall are black, so such a face is black too, from end to end. Its
long edges are halved until a corner lies in the open. A place is closed if surfaces block all its directions within the
length of the face. Faces shorter than FINEST of their object stay as they are.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.spiral import DIRECTIONS, directions
from gi_core.base.vectors import greatest, length
from gi_core.files.completion.pilot import Rays
from gi_core.files.completion.refinement import FINEST
from gi_core.geometry.evaluation_points import INWARD
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.tessellation import halved
from gi_core.scene.types import Material, Mesh, Scene

CHUNK = 1 << 13  # faces at a time: 16 directions each take 5 MB
ROUNDS = 3  # of halving at most: a face in the open by an eighth of its length


def with_open_corners(mesh: Mesh, materials: tuple[Material, ...]) -> Mesh:
    """Return the mesh of an object, faces cut that are open between closed corners; the mesh itself if there are none.

    Rays are against this mesh alone.
    """
    if not len(mesh.faces):
        return mesh
    unpainted = mesh._replace(paint=None, finish=None)  # textures take longer than rays
    rays = Rays(Scene(unpainted, materials))
    rows = np.flatnonzero(_longest(mesh) > FINEST * rays.extent)
    has_back = np.array([m.two_sided for m in materials])
    for _ in range(ROUNDS if len(rows) else 0):
        faces, two_sided = _Faces(mesh, rays), has_back[mesh.face_material[rows]]
        found = [
            faces.open_between_closed(some[first : first + CHUNK], side)
            for some, side in ((rows, 1.0), (rows[two_sided], -1.0))
            for first in range(0, len(some), CHUNK)
        ]
        rows = np.unique(np.concatenate(found))
        if not len(rows):
            break
        mesh, rows = halved(mesh, rows)
    return mesh


def _longest(mesh: Mesh) -> np.ndarray:
    """Return the longest edge (F,) of each face [m]."""
    p = mesh.vertices[mesh.faces]
    return greatest(length(p - p[:, [1, 2, 0]]))


class _Faces:
    """Faces of a mesh, and whether rays find their places closed."""

    def __init__(self, mesh: Mesh, rays: Rays):
        self._rays, self._corners = rays, mesh.vertices[mesh.faces]
        self._normals, _ = face_normals(mesh)
        self._middle = self._corners.mean(axis=1)
        self._reach = _longest(mesh).astype(np.float32)

    def open_between_closed(self, rows: np.ndarray, side: float) -> np.ndarray:
        """Return those of the rows (n,) that are closed at all corners and open at their middle or that of an edge.

        side: 1 for the front, -1 for the back.
        """
        for k in range(3):
            rows = rows[self._closed(self._corners[rows, k], rows, side)]
        shut = self._closed(self._middle[rows], rows, side)
        for k in range(3):
            shut &= self._closed((self._corners[rows, k] + self._corners[rows, k - 1]) / 2, rows, side)
        return rows[~shut]

    def _closed(self, points: np.ndarray, rows: np.ndarray, side: float) -> np.ndarray:
        """Return whether surfaces surround points (n, 3), one on each of the faces rows (n,). (n,) bool."""
        normals = side * self._normals[rows]
        inside = points + INWARD * (self._middle[rows] - points) + self._rays.lift * normals
        closed, ways = np.ones(len(rows), bool), directions(normals)
        for k in range(DIRECTIONS):  # most places are open by the first direction
            left = np.flatnonzero(closed)
            at = inside[left].astype(np.float32), ways[left, k], self._reach[rows[left]]
            closed[left] = self._rays.accelerator.occluded(0, *at)
        return closed

"""Edges cut where they enter other parts, so that a contact has light of its own on the side that is seen.

Light is stored at corners and interpolated between them. Where a floor reaches under a platform, its faces have a
corner in the dark below and none at the foot: the picture carries either light too far. The rail of a chair has all
corners inside the legs and is black. So an edge gets a corner where a surface crosses it, in front of that surface.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from gi_core.base.vectors import box, dot, length
from gi_core.files.completion.pilot import Rays
from gi_core.files.completion.refinement import COARSEST
from gi_core.geometry.evaluation_points import EVALUATION_LIFT, INWARD
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.tessellation import Cuts, cut_edges
from gi_core.scene.types import Material, Mesh, Scene

SHORT = 0.6  # of the object's grain: shorter edges stay as they are
FINE = 0.25  # of an object's area has shorter edges than its grain
ROUNDS = 3  # an edge enters a part and leaves it, and an edge between two new corners may cross another
GAP = INWARD  # of the edge, from the surface to the new corner: evaluation points move by less
TOUCH = 1e-3  # of the edge: an end behind a surface by less touches it
BESIDE = 0.05, 0.25  # of the edge, of the shortest: an end in front of a surface by less has the light of the contact
STEPS = 1 << 10  # along an edge: places are the same on machines that round rays differently
CHUNK = 1 << 16  # faces at a time: 20 MB


def with_corners_at_crossings(mesh: Mesh, materials: tuple[Material, ...]) -> Mesh:
    """Return the mesh of an object with edges cut where its own surfaces cross them; the mesh itself if none does."""
    shortest = SHORT * _grain(mesh)
    rows = _with_long_edges(mesh, np.arange(len(mesh.faces)), shortest)
    if not len(rows):
        return mesh
    rays = Rays(Scene(mesh._replace(paint=None, finish=None), materials))  # textures take longer than rays
    has_back = np.array([m.two_sided for m in materials])
    for _ in range(ROUNDS):
        found = []
        for side, some in ((1.0, rows), (-1.0, rows[has_back[mesh.face_material[rows]]])):
            for first in range(0, len(some), CHUNK):
                found += _crossings(mesh, some[first : first + CHUNK], side, rays, shortest)
        cuts = Cuts(*(np.concatenate(column) for column in zip(*found, strict=True)))
        if not len(cuts.face):
            break
        mesh, pieces = cut_edges(mesh, cuts)
        rows = _with_long_edges(mesh, pieces, shortest)
    return mesh


def _grain(mesh: Mesh) -> float:
    """Return a typical length of edges [m]: FINE of the area has shorter ones; at most COARSEST of the longest side."""
    areas = face_normals(mesh)[1]
    if not areas.any():
        return np.inf
    longest = _edges(mesh).max(axis=1)
    order = np.argsort(longest)
    summed = np.cumsum(areas[order])
    low, high = box(mesh.vertices[mesh.faces.reshape(-1)])
    return float(min(longest[order][np.searchsorted(summed, FINE * summed[-1])], COARSEST * (high - low).max()))


def _edges(mesh: Mesh) -> np.ndarray:
    """Return the lengths (F, 3) of all edges [m]."""
    p = mesh.vertices[mesh.faces]
    return length(p - p[:, [1, 2, 0]])


def _with_long_edges(mesh: Mesh, rows: np.ndarray, shortest: float) -> np.ndarray:
    """Return those of the faces rows (n,) that have an area and an edge longer than `shortest` [m]."""
    return rows[(_edges(mesh)[rows] > shortest).any(axis=1) & (face_normals(mesh)[1][rows] > 0)]


def _crossings(mesh: Mesh, rows: np.ndarray, side: float, rays: Rays, shortest: float) -> list[Cuts]:
    """Return the places where a surface crosses an edge of the faces rows (n,); side: 1 for the front, -1 for the back.

    Rays run just above the face, along each edge both ways.
    """
    corners, normals, found = mesh.vertices[mesh.faces[rows]], face_normals(mesh)[0][rows], []
    inward = INWARD * (corners.mean(axis=1, keepdims=True) - corners)
    for start, end in permutations(range(3), 2):
        edge = length(corners[:, end] - corners[:, start])
        long = edge > shortest
        lift = side * (rays.lift + EVALUATION_LIFT * edge[long])[:, None] * normals[long]
        a, b = ((corners + inward)[long, k] + lift for k in (start, end))
        at, place = _in_front_of_surfaces(a, b, rays, BESIDE[1] * shortest)
        found.append(Cuts(rows[long][at], np.full(len(at), start), np.full(len(at), end), place))
    return found


def _in_front_of_surfaces(a: np.ndarray, b: np.ndarray, rays: Rays, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (k,) of the ways a to b (n, 3) that a surface crosses, and the places (k,) of corners in front of it.

    A place is the share of the way before it. least [m]: from there to the end in the open.
    """
    far = length(b - a)
    way = (b - a) / far[:, None]
    distance, face = rays.accelerator.nearest(0, *(column.astype(np.float32) for column in (a, way, far)))
    rows = np.flatnonzero(face >= 0)
    crossing, facing = distance[rows] / far[rows], dot(rays.surfaces.normals[face[rows]], way[rows])
    from_inside = facing > 0  # the open is beyond
    place = crossing + np.where(from_inside, 1, -1) * GAP / np.maximum(np.abs(facing), GAP)
    behind, before = np.where(from_inside, (crossing, 1 - place), (1 - crossing, place))
    kept = (behind > TOUCH) & (before > np.maximum(BESIDE[0], least / far[rows]))
    return rows[kept], np.rint(place[kept] * STEPS) / STEPS

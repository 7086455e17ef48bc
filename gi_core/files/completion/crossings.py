"""Edges cut where they enter other parts, so that a contact has light of its own on the side that is seen.

Light is stored at corners and interpolated between them. A floor that reaches under a platform has
corners in the dark below and none at the foot, so the picture carries either light too far. The rail of a chair has all
corners inside the legs and is black. So an edge gets a corner where a surface crosses it, in front of that surface.
"""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import box, dot, length
from gi_core.files.completion.pilot import Rays, lift_off
from gi_core.files.completion.refinement import COARSEST
from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import INWARD, face_normals
from gi_core.geometry.tessellation import Cuts, cut_edges
from gi_core.scene.types import Material, Mesh, Scene

GAP = INWARD  # of the edge, from the surface to the new corner: evaluation points move by less
IN_FRONT = 0.05, 0.1  # of the edge, of the shortest: an end in front of a surface by less has the light of the contact


class _Hits(NamedTuple):
    """First surfaces that rays along edges hit, each from one corner of a face to another."""

    face: np.ndarray  # (k,) int64, whose edge it is
    start: np.ndarray  # (k,) int64, 0 to 2
    end: np.ndarray  # (k,) int64
    place: np.ndarray  # (k,) share of the edge before the surface, up to 1 + GAP
    facing: np.ndarray  # (k,) cosine between edge and the surface's normal: above 0 the start is inside
    edge: np.ndarray  # (k,) length of the edge [m]


def with_corners_at_crossings(mesh: Mesh, materials: tuple[Material, ...]) -> Mesh:
    """Return the mesh of an object with edges cut where its own surfaces cross them; the mesh itself if none does."""
    faces_at_once = 1 << 16  # faces at a time: 20 MB
    shortest = 0.7 * _grain(mesh)  # faces whose edges are all shorter than 0.7 of the object's grain stay as they are
    rows = _with_long_edges(mesh, np.arange(len(mesh.faces)), shortest)
    if not len(rows):
        return mesh
    rays = Rays(Scene(mesh._replace(paint=None, finish=None), materials))  # textures take longer than rays
    has_back = np.array([m.two_sided for m in materials])
    for _ in range(3):  # 3 rounds: an edge enters and leaves a part, and an edge between new corners may cross another
        corners, of_sides = weld(mesh.vertices)[mesh.faces], []
        for side, side_rows in ((1.0, rows), (-1.0, rows[has_back[mesh.face_material[rows]]])):
            chunks = np.split(side_rows, range(faces_at_once, len(side_rows), faces_at_once))
            hits = _joined([h for chunk in chunks for h in _hits(mesh, chunk, side, rays, shortest)])
            of_sides.append(_in_front(hits, corners, IN_FRONT[1] * shortest, side > 0))
        cuts = _joined(of_sides)
        if not len(cuts.face):
            break
        mesh, pieces = cut_edges(mesh, cuts)
        rows = _with_long_edges(mesh, pieces, shortest)
    return mesh


def _joined(parts: list) -> NamedTuple:
    return type(parts[0])(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _grain(mesh: Mesh) -> float:
    """Return a typical length of edges [m]: a quarter of the area has shorter ones; at most COARSEST of the side."""
    areas = face_normals(mesh)[1]
    if not areas.any():
        return np.inf
    longest = _edges(mesh).max(axis=1)
    order = np.argsort(longest)
    summed = np.cumsum(areas[order])
    low, high = box(mesh.vertices[mesh.faces.reshape(-1)])
    return float(min(longest[order][np.searchsorted(summed, 0.25 * summed[-1])], COARSEST * (high - low).max()))


def _edges(mesh: Mesh) -> np.ndarray:
    """Return the lengths (F, 3) of all edges [m]."""
    p = mesh.vertices[mesh.faces]
    return length(p - p[:, [1, 2, 0]])


def _with_long_edges(mesh: Mesh, rows: np.ndarray, shortest: float) -> np.ndarray:
    """Return those of the faces rows (n,) that have an area and an edge longer than `shortest` [m]."""
    return rows[(_edges(mesh)[rows] > shortest).any(axis=1) & (face_normals(mesh)[1][rows] > 0)]


def _hits(mesh: Mesh, rows: np.ndarray, side: float, rays: Rays, shortest: float) -> list[_Hits]:
    """Return the hits of rays just above the faces rows (n,), along each edge both ways; side: -1 for the back."""
    aside = 1e-3  # of the edge: how far rays are above the face, and of the way to its middle
    corners, normals, hits = mesh.vertices[mesh.faces[rows]], face_normals(mesh)[0][rows], []
    for start, end in permutations(range(3), 2):
        edge = length(corners[:, end] - corners[:, start])
        long = np.flatnonzero(edge > 0.1 * shortest)  # edges shorter than 0.1 of that stay
        edge, p, n = edge[long], corners[long], normals[long]
        way = (p[:, end] - p[:, start]) / edge[:, None]
        inward = aside * (p.mean(axis=1) - p[:, start])
        origin = p[:, start] + inward + side * (lift_off(p) + aside * edge[:, None]) * n
        ray = (a.astype(np.float32) for a in (origin, way, (1 + GAP) * edge))
        distance, face = rays.accelerator.nearest(0, *ray)
        at = np.flatnonzero(face >= 0)
        facing = dot(rays.surfaces.normals[face[at]], way[at])
        ends = (np.full(len(at), k) for k in (start, end))
        hits.append(_Hits(rows[long[at]], *ends, distance[at] / edge[at], facing, edge[at]))
    return hits


def _in_front(hits: _Hits, corners: np.ndarray, least: float, at_ends: bool) -> Cuts:
    """Return the cuts of edges in front of the surfaces that cross them.

    corners (F, 3) int: the welded vertex at each corner. least [m]: the shortest distance from a cut to the end of its
    edge in front of the surface. at_ends: an edge that ends on a surface is cut too, if faces continue behind that
    surface. It is not cut on their side, because the floor and the bottom of a cupboard would then meet at its foot.
    """
    steps_along_edge = 1 << 10  # along an edge: places are the same on machines that round rays differently
    inside, end = hits.facing > 0, corners[hits.face, hits.end]
    nearly = np.abs(1 - hits.place) < GAP
    either = np.isin(end, end[inside & nearly]) & nearly & at_ends  # the end may have the light of either side
    # From inside, the open is beyond.
    place = hits.place + np.where(inside, 1, -1) * GAP / np.maximum(np.abs(hits.facing), GAP)
    behind, before = np.where(inside, (hits.place, 1 - place), (1 - hits.place, place))
    # an end behind a surface by less than 2e-3 of the edge touches it
    kept = ((behind > 2e-3) | (either & ~inside)) & (before > np.maximum(IN_FRONT[0], least / hits.edge))
    steps = np.rint(place[kept] * steps_along_edge) / steps_along_edge
    return Cuts(hits.face[kept], hits.start[kept], hits.end[kept], steps)

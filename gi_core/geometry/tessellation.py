"""Tessellation: long edges are halved, so that irradiance at vertices can follow the light.

An edge is halved by a rule of that edge alone, in a fixed order of its two ends. All faces around it agree, across
materials too, so there are no T-junctions and no cracks.

Slivers, long thin triangles, are cut across; halving all edges would make 3^n pieces instead of 2^n.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import cross, dot, every, greatest, length
from gi_core.geometry.mesh_parts import each_layer
from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import face_normals
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Mesh, Paint


class Pieces(NamedTuple):
    """Pieces of slivers."""

    points: np.ndarray  # (n, 3, 3) float64 [m]
    source: np.ndarray  # (n,) int64, index of the sliver
    weights: np.ndarray  # (n, 3, 3) of the sliver's corners, at each corner


def cut_across(corners: np.ndarray, too_long: Callable, most: int) -> Pieces | None:
    """Return the pieces of triangles (F, 3, 3) after cuts between points on their edges; None for more than `most`.

    too_long(a, b): a function of points (n, 3) that returns which edges are halved, again and again, as a neighbour
    halves them. The longest edge of every triangle must be too long.
    """
    stops = _stops(corners, too_long, most)
    if stops is None:
        return None
    face, edge, t = stops
    sides = corners - np.roll(corners, -1, axis=1)
    longest = np.argmax((sides * sides).sum(axis=2), axis=1)
    weights = np.zeros((len(face), 3))
    rows = np.arange(len(face))
    weights[rows, edge] += 1 - t
    weights[rows, (edge + 1) % 3] += t
    # Two paths lead from the start of the longest edge to its end: along it, and past the opposite corner.
    first = longest[face]
    other = edge != first
    start = (edge == first) & (t == 0)
    end = (edge == (first + 1) % 3) & (t == 0)
    s, e = corners[np.arange(len(corners)), longest], corners[np.arange(len(corners)), (longest + 1) % 3]
    d = e - s
    points = (weights[:, :, None] * corners[face]).sum(axis=1)
    along = ((points - s[face]) * d[face]).sum(axis=1) / (d * d).sum(axis=1)[face]
    # Both paths take their first step first: three points on one edge form no triangle.
    order = np.lexsort((along, end, other, face))
    order = order[~(start | end)[order]]
    for way, key in ((False, -2.0), (True, -1.0)):
        of_way = order[other[order] == way]
        along[of_way[np.append(True, face[of_way][1:] != face[of_way][:-1])]] = key
    along[end] = 4.0
    other[end] = False
    rows = np.flatnonzero(~start)
    rows = rows[np.lexsort((along[rows], face[rows]))]
    origin = np.zeros(len(corners), np.int64)
    origin[face[start]] = np.flatnonzero(start)
    here = [_last(rows, face, other == way, origin) for way in (False, True)]
    triangles = np.stack([here[0], rows, here[1]], axis=1)
    triangles = triangles[np.append(False, face[rows][1:] == face[rows][:-1])]  # the first step alone spans nothing
    exact = _exact(corners, face, edge, t)
    return Pieces(exact[triangles], face[triangles[:, 1]], weights[triangles])


def _stops(corners, too_long, most):
    """Return face, edge and position along it (0 to 1) of every start and cut of an edge; None for too many."""
    n = len(corners)
    face, edge = np.repeat(np.arange(n), 3), np.tile(np.arange(3), n)
    low, step = np.zeros(3 * n), np.ones(3 * n)
    a, b = corners.reshape(-1, 3), np.roll(corners, -1, axis=1).reshape(-1, 3)
    done = []
    total = 0
    while len(face):
        split = too_long(a, b)
        done.append((face[~split], edge[~split], low[~split]))
        total += len(done[-1][0])
        face, edge, low, step, a, b = (c[split] for c in (face, edge, low, step, a, b))
        if total + 2 * len(face) > most:
            return None
        middle = 0.5 * (a + b)
        face, edge, step = (np.concatenate([c, c]) for c in (face, edge, step / 2))
        low = np.concatenate([low, low + step[: len(low)]])
        a, b = np.concatenate([a, middle]), np.concatenate([middle, b])
    return tuple(np.concatenate(c) for c in zip(*done, strict=True))


def _exact(corners, face, edge, t) -> np.ndarray:
    """Return the points (n, 3) by the same halvings that a neighbour makes, so that all bits agree."""
    a, b = corners[face, edge], corners[face, (edge + 1) % 3]
    rest = t.copy()
    going = rest > 0
    out = a.copy()
    while going.any():
        middle = 0.5 * (a + b)
        upper = rest >= 0.5
        arrived = going & (rest == 0.5)
        out[arrived] = middle[arrived]
        going &= ~arrived
        a = np.where(upper[:, None], middle, a)
        b = np.where(upper[:, None], b, middle)
        rest = 2 * rest - upper
    return out


def _last(rows, face, mine, origin) -> np.ndarray:
    """Return for each step the previous point of its path."""
    place = np.arange(len(rows))
    first = np.append(True, face[rows][1:] != face[rows][:-1])
    begin = np.maximum.accumulate(np.where(first, place, 0))
    seen = np.maximum.accumulate(np.where(mine[rows], place, -1))
    before = np.append(-1, seen[:-1])
    return np.where(before >= begin, rows[np.maximum(before, 0)], origin[face[rows]])


MOST_FACES = 4_000_000  # a misplaced decimal point must not fill the memory


class Cuts(NamedTuple):
    """New corners on edges of faces."""

    face: np.ndarray  # (k,) int64
    start: np.ndarray  # (k,) int64, 0 to 2, corner of the face where the edge starts
    end: np.ndarray  # (k,) int64
    place: np.ndarray  # (k,) share of the edge before the new corner


class Faces(NamedTuple):
    """Faces, each a piece of a face of the mesh; or faces with the middles of their edges as three more corners."""

    source: np.ndarray  # (n,) int64, face of the mesh
    corners: np.ndarray  # (n, 3) int64, vertices
    normals: np.ndarray | None  # (n, 3, 3) at corners
    weights: np.ndarray | None  # (n, 3, 3) of the source's corners, sums of powers of two: exact
    ids: np.ndarray | None = None  # (n, 3, k) int64, of corners, for each of k uses

    def rows(self, rows) -> Faces:
        return Faces(*(None if c is None else c[rows] for c in self))

    def triangle(self, slots) -> Faces:
        return Faces(self.source, *(None if c is None else c[:, slots] for c in self[1:]))


def tessellate(mesh: Mesh, max_edge: float, longest: Callable | None = None, thinnest: float = 0.0) -> Mesh:
    """Return the mesh with every edge longer than `max_edge` [m] halved, again and again.

    `longest`: a function of middles (n, 3) and lengths (n,) of edges that returns the length [m] allowed there,
    `max_edge` or more. `thinnest` [m]: faces of less height ask for no split, their neighbours do; mouldings would
    use up the receivers that walls need. With neither, slivers are cut across.
    Vertices at the same place become one. Corner normals, paint and finish are interpolated; materials and face
    reflectances are kept.

    Raises SceneError if that makes more than MOST_FACES triangles.
    """
    if not max_edge > 0:
        raise SceneError(f"max_edge must be a length > 0, got {max_edge}")
    uniform = longest is None and thinnest == 0
    if uniform:
        check_edge(mesh, max_edge)
    points, faces = _welded(mesh)
    sliver = _slivers(points[faces.corners], max_edge) if uniform else np.zeros(len(faces.source), bool)
    # The height is that of the source: an edge keeps its answer while its faces are cut.
    asks = heights(mesh.vertices[mesh.faces]) >= thinnest if thinnest > 0 else None
    slivers = faces.rows(sliver)
    ends = points[slivers.corners]
    points, faces = _halved(points, faces.rows(~sliver), asks, max_edge, longest)
    if len(ends):
        points, faces = _with_slivers(points, faces, slivers, ends, max_edge)
    return _as_mesh(mesh, points, faces)


def check_edge(mesh: Mesh, max_edge: float) -> None:
    """Raise SceneError before the work if edges up to max_edge [m] must make more than MOST_FACES triangles."""
    # No triangle is larger than half the square of its longest edge.
    if face_normals(mesh)[1].sum() > MOST_FACES * max_edge * max_edge / 2:
        raise _too_many(max_edge)


def cut_edges(mesh: Mesh, cuts: Cuts) -> tuple[Mesh, np.ndarray]:
    """Return the mesh with new corners on edges, and the rows (k,) int64 of the pieces among its faces.

    All faces at an edge are cut. An edge gets one corner, the first where several are asked for.
    """
    points, faces = _welded(mesh)
    low, high = edge_ends(faces)
    key = low * len(points) + high
    row = np.full(len(mesh.faces), -1)
    row[faces.source] = np.arange(len(faces.source))
    asked = Cuts(*(column[row[cuts.face] >= 0] for column in cuts))
    a, b = (faces.corners[row[asked.face], k] for k in (asked.start, asked.end))
    edges, first = np.unique(np.minimum(a, b) * len(points) + np.maximum(a, b), return_index=True)
    shares = np.where(a < b, asked.place, 1 - asked.place)[first]
    points, whole, cut = split_edges(points, faces, key, np.isin(key, edges), shares)
    pieces = np.arange(len(whole.source), len(whole.source) + len(cut.source))
    return _as_mesh(mesh, points, join_faces([whole, cut])), pieces


def _welded(mesh: Mesh) -> tuple[np.ndarray, Faces]:
    """Return the vertices (V, 3), none twice at a place, and the faces; a face smaller than the weld is dropped."""
    place = weld(mesh.vertices)
    points = mesh.vertices[np.unique(place, return_index=True)[1]]
    corners = place[mesh.faces]
    weights = None if mesh.paint is None and mesh.finish is None else np.broadcast_to(np.eye(3), (len(corners), 3, 3))
    faces = Faces(np.arange(len(corners)), corners, mesh.corner_normals, weights)
    return points, faces.rows(every(corners != corners[:, [2, 0, 1]]))


def _as_mesh(mesh: Mesh, points: np.ndarray, faces: Faces) -> Mesh:
    """Return the mesh of pieces of the faces of a mesh."""
    source = faces.source
    return Mesh(
        points,
        faces.corners.astype(np.int32),
        mesh.face_material[source],
        faces.normals,
        None if mesh.face_reflectance is None else mesh.face_reflectance[source],
        None if mesh.paint is None else _painted(mesh.paint, source, faces.weights),
        each_layer(mesh.finish, lambda paint: _painted(paint, source, faces.weights)),
    )


def _slivers(p: np.ndarray, max_edge: float) -> np.ndarray:
    """Return which triangles (F, 3, 3) are low and have a long edge. (F,) bool."""
    # Lower faces than 0.6 of the longest edge are cut across, not into triangles of their own shape.
    return (heights(p) < 0.6 * max_edge) & _too_long(p, np.roll(p, -1, axis=1), max_edge, None).any(axis=1)


def _halved(points, faces: Faces, asks, max_edge: float, longest) -> tuple[np.ndarray, Faces]:
    """Return vertices and faces after all long edges are halved; asks (F,): sources whose edges count; None: all."""
    done = []
    while True:
        low, high = edge_ends(faces)
        long = _too_long(points[low], points[high], max_edge, longest)
        key = low * len(points) + high
        if asks is not None:
            long[long] = np.isin(key[long], key[long & asks[faces.source][:, None]])
        if not long.any():
            return points, join_faces([*done, faces])
        # An edge that is short now stays: a face without a long edge is finished for good.
        points, whole, faces = split_edges(points, faces, key, long)
        done.append(whole)
        if sum(len(d.source) for d in done) + len(faces.source) > MOST_FACES:
            raise _too_many(max_edge)


def edge_ends(faces: Faces) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices low and high (n, 3) of the edges; edge k runs from corner k to corner k + 1."""
    following = faces.corners[:, [1, 2, 0]]
    return np.minimum(faces.corners, following), np.maximum(faces.corners, following)


def split_edges(
    points, faces: Faces, key: np.ndarray, long: np.ndarray, shares=0.5, ids: np.ndarray | None = None
) -> tuple[np.ndarray, Faces, Faces]:
    """Cut the edges long (n, 3) bool: return vertices, faces without such an edge, and the pieces of the others.

    key (n, 3): low * V + high of the ends of each edge. shares: 0.5, or (k,) by ascending key: the share of the edge
    from its lower end to the cut. ids (n, 3, k): of the new corners of faces that have ids, by edge.
    """
    pattern = long @ np.array([1, 2, 4])
    unique, index = np.unique(key[long], return_inverse=True)
    index, shares = index.reshape(-1), np.broadcast_to(shares, unique.shape)[:, None]
    low, high = unique // len(points), unique % len(points)
    middle, share = np.full(key.shape, -1), np.full(key.shape, 0.5)
    middle[long] = len(points) + index
    share[long] = np.where(faces.corners[long] == low[index], shares[index, 0], 1 - shares[index, 0])
    points = np.concatenate([points, (1 - shares) * points[low] + shares * points[high]])
    split = np.flatnonzero(pattern)
    slots = _with_middles(faces.rows(split), middle[split], share[split])
    if ids is not None:
        slots = slots._replace(ids=np.concatenate([slots.ids, ids[split]], axis=1))
    cut = _cut(slots, pattern[split], points)
    return points, faces.rows(pattern == 0), cut


def _with_slivers(points, faces: Faces, slivers: Faces, ends, max_edge: float) -> tuple[np.ndarray, Faces]:
    """Return vertices and faces with the slivers, corners at ends (S, 3, 3), cut across and added."""
    cut = cut_across(ends, lambda a, b: _too_long(a, b, max_edge, None), MOST_FACES - len(faces.source))
    if cut is None:
        raise _too_many(max_edge)
    n, normals = len(cut.source), None
    if slivers.normals is not None:
        mixed = (cut.weights[..., None] * slivers.normals[cut.source][:, None]).sum(axis=2)
        normals = mixed / np.maximum(length(mixed)[..., None], 1e-12)
    corners = len(points) + np.arange(3 * n).reshape(n, 3)
    weights = None if slivers.weights is None else cut.weights
    faces = join_faces([faces, Faces(slivers.source[cut.source], corners, normals, weights)])
    # Neighbours cut the same edges at places that are equal to the bit.
    points, same = np.unique(np.concatenate([points, cut.points.reshape(-1, 3)]), axis=0, return_inverse=True)
    return points, faces._replace(corners=same.reshape(-1)[faces.corners])


def join_faces(parts: list[Faces]) -> Faces:
    return Faces(*(None if c[0] is None else np.concatenate(c) for c in zip(*parts, strict=True)))


def _painted(paint: Paint, source: np.ndarray, weights: np.ndarray) -> Paint:
    """Return the paint of pieces of faces `source` (n,); weights (n, 3, 3): of the source's corners, per corner."""
    columns = []
    for column in (paint.corner_uv, paint.corner_colour):
        at = column[source].astype(np.float64)
        # Term by term: a matrix product may round otherwise from one machine to the next.
        columns.append(sum(weights[:, :, k, None] * at[:, k, None] for k in range(3)).astype(np.float32))
    return Paint(paint.textures, paint.face_texture[source], *columns)


def _too_many(max_edge: float) -> SceneError:
    return SceneError(
        f"max_edge {max_edge:g} makes more than {MOST_FACES:,} triangles; write a larger one or check the units"
    )


def heights(p: np.ndarray) -> np.ndarray:
    """Return the least height [m] of triangles (F, 3, 3). (F,)."""
    d = p - p[:, [2, 0, 1]]
    longest = greatest(length(d))
    return length(cross(d[:, 1], d[:, 2])) / np.where(longest > 0, longest, 1)


def _too_long(a, b, max_edge, longest) -> np.ndarray:
    d = b - a
    edge = length(d)
    long = edge > max_edge
    if longest is not None and long.any():
        long[long] = edge[long] > longest(0.5 * (a[long] + b[long]), edge[long])
    return long


def _with_middles(faces: Faces, middle: np.ndarray, share: np.ndarray) -> Faces:
    """Return faces with six slots: their corners, then a place on each edge, vertices middle (F, 3).

    share (F, 3): of the edge up to that place.
    """
    n, w, share = faces.normals, faces.weights, share[..., None]
    if n is not None:
        between = (1 - share) * n + share * n[:, [1, 2, 0]]
        size = length(between)[..., None]
        between = np.where(size > 1e-6, between / np.where(size > 0, size, 1), n)  # opposed: keep the first
        n = np.concatenate([n, between], axis=1)
    if w is not None:
        w = np.concatenate([w, (1 - share) * w + share * np.roll(w, -1, axis=1)], axis=1)
    return Faces(faces.source, np.concatenate([faces.corners, middle], axis=1), n, w, faces.ids)


def _rotated(triangles, turns: int):
    return [tuple((i + turns) % 3 + 3 * (i >= 3) for i in t) for t in triangles]


# Slots 0 1 2 are the corners, 3 4 5 the middles of edges 01, 12, 20. Pattern: bit k = edge k is split.
TEMPLATES = {
    0b001: [(0, 3, 2), (3, 1, 2)],
    0b010: _rotated([(0, 3, 2), (3, 1, 2)], 1),
    0b100: _rotated([(0, 3, 2), (3, 1, 2)], 2),
    0b111: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)],
}
# Two edges split: a corner triangle and a quad, cut along the shorter of its diagonals (03 and 15 turned).
TWO = {0b110: 0, 0b101: 1, 0b011: 2}  # pattern -> turns that bring the unsplit edge to slot 01
DIAGONALS = ([(0, 1, 4), (0, 4, 5)], [(0, 1, 5), (1, 4, 5)])


def _cut(slots: Faces, pattern: np.ndarray, points: np.ndarray) -> Faces:
    """Return the pieces of faces with six slots, by the pattern (F,) of their long edges."""
    parts = []

    def emit(rows, triangles):
        faces = slots.rows(rows)
        parts.extend(faces.triangle(t) for t in triangles)

    for bits, triangles in TEMPLATES.items():
        emit(np.flatnonzero(pattern == bits), triangles)
    for bits, turns in TWO.items():
        rows = np.flatnonzero(pattern == bits)
        corner = slots.corners[rows]
        (a, d), (b, e) = _rotated([(0, 4), (1, 5)], turns)
        first = points[corner[:, a]] - points[corner[:, d]]
        second = points[corner[:, b]] - points[corner[:, e]]
        shorter = dot(first, first) <= dot(second, second)
        emit(rows, _rotated([(4, 2, 5)], turns))
        emit(rows[shorter], _rotated(DIAGONALS[0], turns))
        emit(rows[~shorter], _rotated(DIAGONALS[1], turns))
    return join_faces(parts)

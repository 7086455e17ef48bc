"""Splitting long edges, so that irradiance at vertices can follow the light.

Whether an edge is split, and where, depends on that edge alone, in a fixed order of its two ends:
all faces around it agree, across materials too, so neither T-junctions nor cracks can arise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gi_core.base.vectors import cross, dot, every, greatest, length
from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.thin_faces import cut_across
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Mesh, Paint

ACROSS = 0.6  # of the longest edge: lower faces are cut across, not into triangles of their own shape
MOST_FACES = 4_000_000  # a misplaced decimal point must not fill the memory


def tessellate(mesh: Mesh, max_edge: float, longest: Callable | None = None, thinnest: float = 0.0) -> Mesh:
    """Split every edge longer than `max_edge` [m] at its middle, again and again.

    `longest`: a function of middles (n, 3) and lengths (n,) of edges that returns the length [m] allowed
    there, `max_edge` or more. `thinnest` [m]: faces lower than that ask for no split (they
    are split where a neighbour asks): mouldings would use up the receivers that walls need.
    Vertices of one place become one. Corner normals and paint are interpolated, materials and face
    reflectances carried along.

    Raises SceneError if that makes more than MOST_FACES triangles.
    """
    if not max_edge > 0:
        raise SceneError(f"max_edge must be a length > 0, got {max_edge}")
    place = weld(mesh.vertices)
    points = mesh.vertices[np.unique(place, return_index=True)[1]]
    faces = place[mesh.faces]
    whole = every(faces != faces[:, [2, 0, 1]])  # a face smaller than the weld is none
    faces, source, normals = faces[whole], np.flatnonzero(whole), mesh.corner_normals
    normals = None if normals is None else normals[whole]
    # No triangle is larger than half the square of its longest edge: refuse before the work, not after it.
    if longest is None and thinnest == 0 and face_normals(mesh)[1].sum() > MOST_FACES * max_edge * max_edge / 2:
        raise _too_many(max_edge)
    # Asked of the whole face, so that an edge never changes its mind while its faces are cut.
    asks = _heights(points, place[mesh.faces]) >= thinnest
    # Where the corners lie in the face of the file: halves of halves, without any rounding.
    inside = None if mesh.paint is None else np.broadcast_to(np.eye(3), (len(faces), 3, 3))
    done, done_source, done_normals, done_inside = [], [], [], []
    total = 0
    across = np.zeros(len(faces), bool)
    if longest is None and thinnest == 0:
        p = points[faces]
        across = (_heights(points, faces) < ACROSS * max_edge) & _too_long(
            p, np.roll(p, -1, axis=1), max_edge, None
        ).any(axis=1)
    thin, whole_points = faces[across], points
    thin_source, thin_normals = source[across], None if normals is None else normals[across]
    faces, source = faces[~across], source[~across]
    normals, inside = (None if c is None else c[~across] for c in (normals, inside))
    while len(faces):
        # Mark the long edges: edge k runs from corner k to corner k + 1.
        following = faces[:, [1, 2, 0]]
        low, high = np.minimum(faces, following), np.maximum(faces, following)
        long = _too_long(points[low], points[high], max_edge, longest)
        if thinnest > 0:
            key = low[long] * len(points) + high[long]
            asking = np.repeat(asks[source], 3)[long.reshape(-1)]
            long[long] = np.isin(key, key[asking])
        # An edge that is short now stays: a face without a long edge is finished for good.
        pattern = long @ np.array([1, 2, 4])
        rest = pattern == 0
        done.append(faces[rest])
        done_source.append(source[rest])
        done_normals.append(None if normals is None else normals[rest])
        done_inside.append(None if inside is None else inside[rest])
        total += int(rest.sum())
        split = ~rest
        faces, source, pattern, long = faces[split], source[split], pattern[split], long[split]
        low, high = low[split], high[split]
        if not len(faces):
            break
        # Give each long edge its one midpoint.
        key = low[long] * len(points) + high[long]
        unique, index = np.unique(key, return_inverse=True)
        middle = np.full(faces.shape, -1)
        middle[long] = len(points) + index.reshape(-1)
        a, b = unique // len(points), unique % len(points)
        points = np.concatenate([points, 0.5 * (points[a] + points[b])])
        # Cut each face by the template of its marks.
        slots = np.concatenate([faces, middle], axis=1)
        slot_normals = None if normals is None else _with_middles(normals[split])
        slot_inside = None
        if inside is not None:
            inside = inside[split]
            slot_inside = np.concatenate([inside, 0.5 * (inside + np.roll(inside, -1, axis=1))], axis=1)
        faces, source, normals, inside = _cut(slots, source, slot_normals, slot_inside, pattern, points)
        if total + len(faces) > MOST_FACES:
            raise _too_many(max_edge)
    if len(thin):
        cut = cut_across(whole_points[thin], lambda a, b: _too_long(a, b, max_edge, None), MOST_FACES - total)
        if cut is None:
            raise _too_many(max_edge)
        n = len(cut.source)
        done.append(len(points) + np.arange(3 * n).reshape(n, 3))
        done_source.append(thin_source[cut.source])
        done_inside.append(cut.inside)
        if normals is not None:
            mixed = (cut.inside[..., None] * thin_normals[cut.source][:, None]).sum(axis=2)
            done_normals.append(mixed / np.maximum(length(mixed)[..., None], 1e-12))
        # What neighbours made of the same edges is the same to the bit.
        points, same = np.unique(np.concatenate([points, cut.points.reshape(-1, 3)]), axis=0, return_inverse=True)
        done = [same.reshape(-1)[f] for f in done]
    source = np.concatenate(done_source)
    return Mesh(
        points,
        np.concatenate(done).astype(np.int32),
        mesh.face_material[source],
        None if mesh.corner_normals is None else np.concatenate(done_normals),
        None if mesh.face_reflectance is None else mesh.face_reflectance[source],
        None if mesh.paint is None else _painted(mesh.paint, source, np.concatenate(done_inside)),
    )


def _painted(paint: Paint, source: np.ndarray, inside: np.ndarray) -> Paint:
    """Return the paint of pieces of faces `source`, whose corners have weights (n, 3, 3) of the corners there."""
    columns = []
    for column in (paint.corner_uv, paint.corner_colour):
        at = column[source].astype(np.float64)
        # Term by term: a matrix product may round otherwise from one machine to the next.
        columns.append(sum(inside[:, :, k, None] * at[:, k, None] for k in range(3)).astype(np.float32))
    return Paint(paint.textures, paint.face_texture[source], *columns)


def _too_many(max_edge: float) -> SceneError:
    return SceneError(
        f"max_edge {max_edge:g} makes more than {MOST_FACES:,} triangles; write a larger one or check the units"
    )


def _heights(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the least height (F,) of each triangle [m]."""
    p = points[faces]
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


def _with_middles(n: np.ndarray) -> np.ndarray:
    """Return normals (F, 6, 3) of the corners and of the middles of the edges."""
    middle = n + n[:, [1, 2, 0]]
    size = length(middle)[..., None]
    middle = np.where(size > 1e-6, middle / np.where(size > 0, size, 1), n)  # opposed: keep the first
    return np.concatenate([n, middle], axis=1)


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
TIP = [(4, 2, 5)]
DIAGONALS = ([(0, 1, 4), (0, 4, 5)], [(0, 1, 5), (1, 4, 5)])


def _cut(slots, source, normals, inside, pattern, points):
    faces_out, source_out, normals_out, inside_out = [], [], [], []

    def emit(rows, triangles):
        for t in triangles:
            faces_out.append(slots[rows][:, t])
            source_out.append(source[rows])
            if normals is not None:
                normals_out.append(normals[rows][:, t])
            if inside is not None:
                inside_out.append(inside[rows][:, t])

    for bits, triangles in TEMPLATES.items():
        emit(np.flatnonzero(pattern == bits), triangles)
    for bits, turns in TWO.items():
        rows = np.flatnonzero(pattern == bits)
        corner = slots[rows]
        (a, d), (b, e) = ([i for i in _rotated([pair], turns)[0]] for pair in ((0, 4), (1, 5)))
        first = points[corner[:, a]] - points[corner[:, d]]
        second = points[corner[:, b]] - points[corner[:, e]]
        shorter = dot(first, first) <= dot(second, second)
        emit(rows, _rotated(TIP, turns))
        emit(rows[shorter], _rotated(DIAGONALS[0], turns))
        emit(rows[~shorter], _rotated(DIAGONALS[1], turns))
    return (
        np.concatenate(faces_out),
        np.concatenate(source_out),
        None if normals is None else np.concatenate(normals_out),
        None if inside is None else np.concatenate(inside_out),
    )

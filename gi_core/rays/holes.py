"""Holes of textures: rays pass a face where its texture is transparent, texel by texel.

`Pierced` is a structure of rays: it holds faces with holes apart, and goes on behind a hole. So light, regions and
pictures see the same leaves. A hole is where the interpolated cover is below HALF.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import barycentric
from gi_core.geometry.surfaces import Surfaces
from gi_core.geometry.texture_filter import WRAPS, wrapped
from gi_core.rays.structures import any_hit as hits_any
from gi_core.rays.structures import nearest_hit
from gi_core.rays.triangles import Meshes
from gi_core.scene.types import HALF

BEYOND = 4e-6  # of the largest coordinate and the distance: where rays go on behind a face; float32 rounds by 6e-8


class Covers(NamedTuple):
    """Covers of T textures, one after the other."""

    texels: np.ndarray  # (n,) uint8, see Texture.cover
    first: np.ndarray  # (T,) int64
    shape: np.ndarray  # (T, 2) int64, rows and columns
    wrap: np.ndarray  # (T, 2) int64 of WRAPS, along u and along v
    nearest: np.ndarray  # (T,) bool


class Pierced(NamedTuple):
    """Structures of whole faces and of faces with holes; `whole` has a point in place of each of these."""

    whole: Any  # as any structure builds it
    holed: Any
    first: np.ndarray  # (objects + 1,) int64, faces with holes before those of each object
    face: np.ndarray  # (H,) int64, face within its object
    corners: np.ndarray  # (H, 3, 3) float64 [m], object space
    uv: np.ndarray  # (H, 3, 2) float64
    texture: np.ndarray  # (H,) int64 into `covers`
    reach: np.ndarray  # (objects,) float64 [m], largest coordinate
    covers: Covers


def holed_faces(surfaces: Surfaces) -> list[np.ndarray]:
    """Return the faces (k,) int64 with holes of each object, in its own numbers; panes have none."""
    out = []
    for o, paint in enumerate(surfaces.paint):
        rows = np.zeros(0, np.int64)
        if paint is not None:
            pierced = np.array([t.cover is not None for t in paint.textures] + [False])
            opaque = surfaces.pane[surfaces.face_range(o)] < 0
            rows = np.flatnonzero(pierced[paint.face_texture] & opaque)
        out.append(rows)
    return out


def build(structure: ModuleType, meshes: Meshes, surfaces: Surfaces) -> Any:
    """Return the structure of objects, a Pierced one where textures have holes; structure: of `STRUCTURES`."""
    faces = holed_faces(surfaces)
    if not any(map(len, faces)):
        return structure.build(meshes)
    textures, numbers, whole, holed, corners, uv = [], [], [], [], [], []
    for rows, paint, (vertices, of) in zip(faces, surfaces.paint, meshes, strict=True):
        apart = np.zeros((len(of), 1), bool)
        apart[rows] = True
        whole.append((vertices, np.where(apart, of[:1, :1], of) if len(of) else of))
        holed.append((vertices, np.ascontiguousarray(of[rows])))
        if paint is not None and len(rows):
            numbers.append(len(textures) + paint.face_texture[rows])
            textures += paint.textures
            corners.append(vertices[of[rows]])
            uv.append(np.nan_to_num(paint.corner_uv[rows].astype(np.float64)))
    first, reach = np.cumsum([0, *map(len, faces)]), np.array([np.abs(v[f]).max(initial=0.0) for v, f in holed])
    places = np.concatenate(corners), np.concatenate(uv), np.concatenate(numbers).astype(np.int64)
    structures = structure.build(whole), structure.build(holed)
    return Pierced(*structures, first, np.concatenate(faces), *places, reach, _covers(textures))


def _covers(textures) -> Covers:
    covers = [np.full((1, 1), 255, np.uint8) if t.cover is None else t.cover for t in textures]
    first = np.cumsum([0, *(c.size for c in covers[:-1])])
    wrap = np.array([[WRAPS[way] for way in t.wrap] for t in textures])
    texels = np.concatenate([np.ascontiguousarray(c).reshape(-1) for c in covers])
    return Covers(texels, first, np.array([c.shape for c in covers]), wrap, np.array([t.nearest for t in textures]))


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    if any_hit and hits_any(s.whole, o, ray, ox, oy, oz, dx, dy, dz, limit):
        return np.float32(0.0), np.int32(0)
    distance, face = np.float32(limit), np.int32(-1)
    if not any_hit:
        t, f = nearest_hit(s.whole, o, ray, ox, oy, oz, dx, dy, dz, limit)
        distance, face = np.float32(t), np.int32(f)
    if s.first[o + 1] == s.first[o]:
        return distance, face
    x, y, z, before = ox, oy, oz, np.float32(0.0)
    for _ in range(256):  # along a ray: leaves of a whole crown
        t, k = nearest_hit(s.holed, o, ray, x, y, z, dx, dy, dz, distance - before)
        if k < 0:
            break
        k += s.first[o]
        place = float(x) + float(t) * dx, float(y) + float(t) * dy, float(z) + float(t) * dz
        if _is_solid(s, k, place):
            return before + t, np.int32(s.face[k])
        past = np.float32(t + BEYOND * (t + s.reach[o]))
        x, y, z, before = x + past * dx, y + past * dy, z + past * dz, before + past
        if before >= distance:
            break
    return distance, face


@kernel
def _is_solid(s, k, place):
    """Return whether the cover of face k is there at a place."""
    a, b, c = s.corners[k, 0], s.corners[k, 1], s.corners[k, 2]
    share = barycentric((a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2]), place)
    uv, of, m = s.uv[k], s.covers, s.texture[k]
    h, w = of.shape[m, 0], of.shape[m, 1]
    u = min(max(share[0] * uv[0, 0] + share[1] * uv[1, 0] + share[2] * uv[2, 0], -1e6), 1e6) * w
    v = min(max(share[0] * uv[0, 1] + share[1] * uv[1, 1] + share[2] * uv[2, 1], -1e6), 1e6) * h
    if of.nearest[m]:
        return _texel(of, m, np.int64(np.floor(u)), np.int64(np.floor(v))) >= HALF
    i, j = np.int64(np.floor(u - 0.5)), np.int64(np.floor(v - 0.5))
    p, q = u - 0.5 - i, v - 0.5 - j
    upper = (1.0 - p) * _texel(of, m, i, j) + p * _texel(of, m, i + 1, j)
    lower = (1.0 - p) * _texel(of, m, i, j + 1) + p * _texel(of, m, i + 1, j + 1)
    return (1.0 - q) * upper + q * lower >= HALF - 0.5


@inlined
def _texel(of, m, column, line):
    h, w = of.shape[m, 0], of.shape[m, 1]
    return np.float64(of.texels[of.first[m] + wrapped(line, h, of.wrap[m, 1]) * w + wrapped(column, w, of.wrap[m, 0])])

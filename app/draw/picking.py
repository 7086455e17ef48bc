"""Picking: one ray against the drawn triangles, mobiles at their poses.

Embree would be faster but ignores culling: a mobile behind a culled wall must be pickable.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gi_core.geometry.cutouts import covered
from gi_core.scene import Pose
from gi_core.scene.pose import rotation

if TYPE_CHECKING:
    from gi_core.geometry.surfaces import Surfaces
    from gi_core.scene.types import Paint

FACES_PER_BLOCK = 256  # 80k faces have 320 boxes, of which a ray enters few


class Hit(NamedTuple):
    object: int  # 0 static, i + 1 the scene's mobile i
    face: int  # within the object
    distance: float  # [m]
    point: np.ndarray  # (3,) float64, world


class _FaceBlocks(NamedTuple):
    """Faces of one object in blocks along a Morton curve."""

    order: np.ndarray  # (F,) int, face ids block after block
    corners: np.ndarray  # (F, 3, 3) float64 in that order
    two_sided: np.ndarray  # (F,) bool in that order
    low: np.ndarray  # (B, 3) boxes
    high: np.ndarray  # (B, 3)
    paint: Paint | None  # None unless a texture has holes


class Picker:
    def __init__(self, surfaces: Surfaces, origins: np.ndarray | None = None) -> None:
        """origins (objects, 3) [m]: of the coordinates of each object's vertices, see Model; None: zeros."""
        self._origins = np.zeros((surfaces.objects, 3)) if origins is None else origins
        self._objects = [
            _blocks(
                surfaces.vertices[o][surfaces.faces[o]], surfaces.two_sided[surfaces.face_range(o)], surfaces.paint[o]
            )
            for o in range(surfaces.objects)
        ]

    def pick(self, origin, direction, poses: list[Pose], cull: bool) -> Hit | None:
        """Return the nearest hit of a ray; `poses` are the mobiles', in the scene's order.

        Holes of cutouts do not count, nor, with `cull`, backs of one-sided faces.
        """
        nearest: Hit | None = None
        for o, blocks in enumerate(self._objects):
            p, d = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
            if o:  # into object space
                R = rotation(poses[o - 1])
                p, d = R.T @ (p - np.array(poses[o - 1].position)), R.T @ d
            t, face = _nearest(blocks, p - self._origins[o], d, cull)
            if face >= 0 and (nearest is None or t < nearest.distance):
                nearest = Hit(o, face, t, np.asarray(origin) + t * np.asarray(direction))
        return nearest

    def on(self, o: int, point, normal, reach: float) -> int:
        """Return the face of object o below a point of its space (3,), along -normal (3,) from `reach` above it [m].

        -1 if none is there within twice that distance.
        """
        d = -np.asarray(normal, np.float64)
        t, face = _nearest(self._objects[o], np.asarray(point, np.float64) - self._origins[o] - reach * d, d, False)
        return face if t <= 2 * reach else -1


def _blocks(corners: np.ndarray, two_sided: np.ndarray, paint: Paint | None) -> _FaceBlocks:
    if paint is not None and all(t.cover is None for t in paint.textures):
        paint = None
    order = _along_a_curve(corners.mean(axis=1)) if len(corners) else np.zeros(0, np.int64)
    corners, starts = corners[order], np.arange(0, len(corners), FACES_PER_BLOCK)
    if not len(starts):
        return _FaceBlocks(order, corners, two_sided, np.zeros((0, 3)), np.zeros((0, 3)), paint)
    low = np.minimum.reduceat(corners.min(axis=1), starts)
    high = np.maximum.reduceat(corners.max(axis=1), starts)
    pad = 1e-9 * max(float(np.abs(corners).max()), 1.0)
    return _FaceBlocks(order, corners, two_sided[order], low - pad, high + pad, paint)


def _along_a_curve(points: np.ndarray) -> np.ndarray:
    """Return the order (n,) of points (n, 3) along a Morton curve."""
    low, high = points.min(axis=0), points.max(axis=0)
    cell = ((points - low) / np.maximum(high - low, 1e-30) * 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def _nearest(blocks: _FaceBlocks, p: np.ndarray, d: np.ndarray, cull: bool) -> tuple[float, int]:
    """Return distance [m] and face of the nearest hit, or (inf, -1)."""
    with np.errstate(divide="ignore", invalid="ignore"):  # intended: a ray along an axis divides by 0
        a, b = (blocks.low - p) / d, (blocks.high - p) / d
    entry = np.fmax.reduce(np.fmin(a, b), axis=1)
    leave = np.fmin.reduce(np.fmax(a, b), axis=1)
    opened = np.flatnonzero(leave >= np.maximum(entry, 0))
    best, face = np.inf, -1
    for k in opened[np.argsort(entry[opened])]:
        if entry[k] > best:
            break
        of = slice(k * FACES_PER_BLOCK, (k + 1) * FACES_PER_BLOCK)
        t, u, v = _distances(blocks.corners[of], p, d, cull, blocks.two_sided[of])
        if blocks.paint is not None:
            hit = np.flatnonzero(t < best)
            opaque = _is_opaque(blocks.paint, blocks.order[of][hit], u[hit], v[hit])
            t[hit[~opaque]] = np.inf
        j = int(np.argmin(t))
        if t[j] < best:
            best, face = float(t[j]), int(blocks.order[k * FACES_PER_BLOCK + j])
    return best, face


def _is_opaque(paint: Paint, faces: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return whether faces (n,) are opaque (n,) bool at barycentric weights u, v (n,) of corners 1 and 2."""
    opaque = np.ones(len(faces), bool)
    at = paint.corner_uv[faces].astype(np.float64)
    at = at[:, 0] + u[:, None] * (at[:, 1] - at[:, 0]) + v[:, None] * (at[:, 2] - at[:, 0])
    for k in np.unique(paint.face_texture[faces]):
        if k >= 0 and paint.textures[k].cover is not None:
            rows = paint.face_texture[faces] == k
            opaque[rows] = covered(paint.textures[k], at[rows])
    return opaque


def _distances(corners: np.ndarray, p: np.ndarray, d: np.ndarray, cull: bool, two_sided: np.ndarray):
    """Return distances (n,) to triangles, inf for a miss, and barycentric weights (n,), (n,) of corners 1 and 2
    (Moeller and Trumbore 1997)."""
    barycentric_slack = 1e-9  # no ray passes between two adjacent triangles
    e1, e2, s = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], p - corners[:, 0]
    h, q = np.cross(d, e2), np.cross(s, e1)
    det = (e1 * h).sum(axis=1)  # > 0: the ray meets the front
    seen = det != 0
    if cull:
        seen &= (det > 0) | two_sided
    inverse = 1.0 / np.where(seen, det, 1.0)
    u, v, t = (s * h).sum(axis=1) * inverse, (q @ d) * inverse, (e2 * q).sum(axis=1) * inverse
    hit = seen & (u >= -barycentric_slack) & (v >= -barycentric_slack) & (u + v <= 1 + barycentric_slack) & (t > 0)
    return np.where(hit, t, np.inf), u, v

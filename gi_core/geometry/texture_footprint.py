"""Texture footprint of a pixel: rays of neighbouring pixels, intersected with the plane of the visible face."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel

GRAZING = 1e-30  # parallel rays do not intersect the plane


class Footprints(NamedTuple):
    """In texture coordinates, float64."""

    place: np.ndarray  # (n, 2)
    across: np.ndarray  # (n, 2), offset to the pixel on the right
    along: np.ndarray  # (n, 2), offset to the pixel below


def footprints(corners, uv, face, u, v, eye, directions, steps) -> Footprints:
    """Return the texture footprints of pixels.

    corners (F, 3, 3) float32 [m] and uv (F, 3, 2) float32 of all faces; face (n,), weights u, v (n,) of its
    corners 1 and 2, and unit directions (n, 3) float32 of the rays from eye (3,) that hit it. Rows of steps (3, 3):
    movement of a ray at unit distance along the view per pixel to the right, per pixel down, and the view direction.
    """
    out = Footprints(*(np.empty((len(face), 2)) for _ in range(3)))
    u, v = (np.ascontiguousarray(w, np.float64).reshape(-1) for w in (u, v))
    _footprints(corners, uv, face.astype(np.int64), u, v, np.asarray(eye, np.float64), directions, steps, *out)
    return out


@allocating
def _footprints(corners, uv, face, u, v, eye, directions, steps, place, across, along):
    n, g, h = np.empty(3), np.empty(3), np.empty(3)
    e1, e2, q, d, moved = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(face)):
        f = face[i]
        for k in range(3):
            e1[k] = np.float64(corners[f, 1, k]) - np.float64(corners[f, 0, k])
            e2[k] = np.float64(corners[f, 2, k]) - np.float64(corners[f, 0, k])
            q[k] = corners[f, 0, k] - eye[k] + u[i] * e1[k] + v[i] * e2[k]
        _cross(e1, e2, n)
        square = max(_dot(n, n), 1e-60)
        _cross(e2, n, g)  # the gradient of u, times square
        _cross(n, e1, h)  # the gradient of v
        forward = 0.0
        for k in range(3):
            forward += directions[i, k] * steps[2, k]
        for k in range(3):
            d[k] = directions[i, k] / forward
        depth, steepness = _dot(q, steps[2]), _dot(n, d)
        if abs(steepness) < GRAZING:
            steepness = GRAZING
        for s in range(2):
            # Offset to the intersection of the neighbouring ray.
            slant = _dot(n, steps[s]) / steepness
            for k in range(3):
                moved[k] = depth * (steps[s, k] - slant * d[k])
            du, dv = _dot(moved, g) / square, _dot(moved, h) / square
            for c in range(2):
                a, b = uv[f, 1, c] - uv[f, 0, c], uv[f, 2, c] - uv[f, 0, c]
                if s == 0:
                    across[i, c] = du * a + dv * b
                    place[i, c] = uv[f, 0, c] + u[i] * a + v[i] * b
                else:
                    along[i, c] = du * a + dv * b


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]

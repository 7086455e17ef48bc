"""How much of a texture a pixel covers: the rays of neighbouring pixels met with the plane of the face it shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel

GRAZING = 1e-30  # a ray in the plane of a face meets it nowhere


class Footprints(NamedTuple):
    """In texture coordinates, float64."""

    place: np.ndarray  # (n, 2)
    across: np.ndarray  # (n, 2) from the pixel to the one on its right
    along: np.ndarray  # (n, 2) to the one below


def footprints(corners, uv, face, u, v, eye, directions, steps) -> Footprints:
    """Return what pixels show of the textures of faces.

    corners (F, 3, 3) float32 [m] and uv (F, 3, 2) float32 of all faces; face (n,), weights u, v (n,) of its
    corners 1 and 2, and unit directions (n, 3) float32 of the rays from eye (3,) that meet it. The rows of
    steps (3, 3): how far a ray at unit distance along the view moves for a pixel to the right, and for one
    down; the view direction.
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
            # The neighbouring ray meets the plane that far from here.
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

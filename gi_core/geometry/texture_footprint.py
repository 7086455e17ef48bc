"""Texture footprint of a pixel: rays of neighbouring pixels, intersected with the plane of the visible face."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import cross, difference, dot, weighted

PARALLEL = 1e-30  # parallel rays do not intersect the plane


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
    Reflected rays have an eye (n, 3) and steps (n, 3, 3) each.
    """
    out = Footprints(*(np.empty((len(face), 2)) for _ in range(3)))
    eye = np.array(np.broadcast_to(eye, (len(face), 3)), np.float64)
    steps = np.array(np.broadcast_to(steps, (len(face), 3, 3)), np.float64)
    u, v = (np.ascontiguousarray(w, np.float64).reshape(-1) for w in (u, v))
    _footprints(corners, uv, face.astype(np.int64), u, v, eye, directions, steps, *out)
    return out


@kernel
def _footprints(corners, uv, face, u, v, eye, directions, steps, place, across, along):
    for i in range(len(face)):
        f = face[i]
        p = _double(corners[f, 0])
        e1, e2 = difference(_double(corners[f, 1]), p), difference(_double(corners[f, 2]), p)
        q = weighted((1.0, u[i], v[i]), difference(p, eye[i]), e1, e2)
        n = cross(e1, e2)
        square = max(dot(n, n), 1e-60)
        g, h = cross(e2, n), cross(n, e1)  # the gradients of u and v, times square
        forward = dot(directions[i], steps[i, 2])
        d = directions[i, 0] / forward, directions[i, 1] / forward, directions[i, 2] / forward
        depth, steepness = dot(q, steps[i, 2]), dot(n, d)
        if abs(steepness) < PARALLEL:
            steepness = PARALLEL
        for s in range(2):
            # Offset to the intersection of the neighbouring ray.
            slant = dot(n, steps[i, s]) / steepness
            sideways = difference(steps[i, s], (slant * d[0], slant * d[1], slant * d[2]))
            moved = depth * sideways[0], depth * sideways[1], depth * sideways[2]
            du, dv = dot(moved, g) / square, dot(moved, h) / square
            for c in range(2):
                a, b = uv[f, 1, c] - uv[f, 0, c], uv[f, 2, c] - uv[f, 0, c]
                if s == 0:
                    across[i, c] = du * a + dv * b
                    place[i, c] = uv[f, 0, c] + u[i] * a + v[i] * b
                else:
                    along[i, c] = du * a + dv * b


@inlined
def _double(a):
    return np.float64(a[0]), np.float64(a[1]), np.float64(a[2])

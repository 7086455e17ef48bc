"""Vectors of three in kernels: tuples or rows of arrays in, tuples out. Sums run from left to right.

A tuple is indexed by constants alone: numba checks a running index at run time.
"""

from __future__ import annotations

import math

from gi_core.base.jit import inlined, kernel


@inlined
def row(array, k):
    """Return row k of an array (n, 3) as a tuple: it stays in registers where a loop writes to memory."""
    return array[k, 0], array[k, 1], array[k, 2]


@inlined
def dot(a, b):
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def largest(a):
    """Return the largest absolute coordinate."""
    return max(abs(a[0]), max(abs(a[1]), abs(a[2])))


@inlined
def difference(a, b):
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def cross(a, b):
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def rotate(R, a):
    """Return R a: from object space to the world."""
    return (
        R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
        R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
        R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2],
    )


@inlined
def rotate_back(R, a):
    """Return R^T a: from the world to object space."""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )


@inlined
def weighted(share, a, b, c):
    """Return share[0] a + share[1] b + share[2] c: of barycentric coordinates, or to the world from a frame a, b, c."""
    return (
        share[0] * a[0] + share[1] * b[0] + share[2] * c[0],
        share[0] * a[1] + share[1] * b[1] + share[2] * c[1],
        share[0] * a[2] + share[1] * b[2] + share[2] * c[2],
    )


@inlined
def barycentric(a, b, c, p):
    """Return the barycentric coordinates of p in the plane of triangle abc, clamped to the triangle."""
    u, v, w = difference(b, a), difference(c, a), difference(p, a)
    uu, uv, vv, wu, wv = dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)
    area2 = uu * vv - uv * uv
    s = t = 0.0
    if area2 > 0.0:
        s = min(max((vv * wu - uv * wv) / area2, 0.0), 1.0)
        t = min(max((uu * wv - uv * wu) / area2, 0.0), 1.0 - s)
    return 1.0 - s - t, s, t


@kernel
def cell_of(x, low, cell):
    """Return the index of a grid's cell along one axis, not clamped."""
    return int(math.floor((x - low) / cell))

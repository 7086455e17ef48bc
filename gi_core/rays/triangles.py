"""The triangle test that all structures of our own share, so that their hits agree bit for bit; and no structure.

The edge functions are those of Woop, Benthin and Wald 2013 ("Watertight ray/triangle intersection"), computed in
float64 from float32 corners: a ray between two triangles hits one of them. Edges belong to both triangles. The nearest
hit is the least (distance, face). A hit counts only where the ray's point lies within the padding of its triangle.
A structure that lists each triangle in every cell that the padded triangle touches therefore misses none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel

LEAST_DIRECTION = 1e-20  # replaces smaller components, so that no inverse is infinite: 1e-14 m off after 1e6 m
# Words of 4 bytes of a ray's buffer; Embree's own ray has the first 24.
CELLS, TESTS = 24, 25  # int32 counters: cells entered and triangles tested, since they were last set to 0
MAILBOX, MAILBOX_SIZE = 32, 64  # int32: triangles tested last
STACK, WORDS = 96, 1024  # entries of a structure's own; all words

Meshes = Sequence[tuple[np.ndarray, np.ndarray]]  # vertices (V, 3) and faces (F, 3) per object


class Triangles(NamedTuple):
    """Triangles of all objects, one object after the other."""

    corners: np.ndarray  # (T, 9) float32, object space
    first: np.ndarray  # (objects + 1,) int64
    padding: np.ndarray  # (objects,) float64 [m]


def triangles_of(meshes: Meshes) -> Triangles:
    """Return the triangles of meshes, with corners rounded to float32."""
    corners = [np.asarray(v, np.float32)[f].reshape(-1, 9) for v, f in meshes]
    largest = [float(np.abs(c).max(initial=1e-30)) for c in corners]
    first = np.cumsum([0, *map(len, corners)]).astype(np.int64)
    # triangles grow by 1e-6 of the largest coordinate; float32 rounds by 6e-8, float64 by 1e-16
    return Triangles(np.concatenate(corners), first, 1e-6 * np.array(largest, np.float64))


class TestRay(NamedTuple):
    """A ray as the triangle test reads it: float64, with its axes in an order that ends with the largest component."""

    x: float  # origin [m]
    y: float
    z: float
    dx: float  # direction
    dy: float
    dz: float
    axis0: int
    axis1: int
    axis2: int
    o0: float  # origin along these axes
    o1: float
    o2: float
    s0: float  # shear that turns the ray into axis2
    s1: float
    s2: float
    ix: float  # 1 / direction, finite
    iy: float
    iz: float
    padding: float  # half of the object's [m], along each axis


@inlined
def _inverse(d):
    return 1.0 / (d if abs(d) >= LEAST_DIRECTION else math.copysign(LEAST_DIRECTION, d))


@inlined
def test_ray(triangles, o, ox, oy, oz, dx, dy, dz):
    """Return the TestRay of a ray against object o."""
    x, y, z, u, v, w = np.float64(ox), np.float64(oy), np.float64(oz), np.float64(dx), np.float64(dy), np.float64(dz)
    i, j, k, padding = _inverse(u), _inverse(v), _inverse(w), 0.5 * triangles.padding[o]
    if abs(w) >= abs(u) and abs(w) >= abs(v):
        r = TestRay(x, y, z, u, v, w, 0, 1, 2, x, y, z, u / w, v / w, 1.0 / w, i, j, k, padding)
    elif abs(v) >= abs(u):
        r = TestRay(x, y, z, u, v, w, 2, 0, 1, z, x, y, w / v, u / v, 1.0 / v, i, j, k, padding)
    else:
        r = TestRay(x, y, z, u, v, w, 1, 2, 0, y, z, x, v / u, w / u, 1.0 / u, i, j, k, padding)
    return r


@inlined
def nearer(corners, k, face, r, best, best_face):
    """Return distance and face of the nearer one of triangle k, whose number is `face`, and of the best found yet.

    best: float64, at first the limit; best_face: -1 for none.
    """
    a, b, c = r.axis0, r.axis1, r.axis2
    az, bz, cz = corners[k, c] - r.o2, corners[k, 3 + c] - r.o2, corners[k, 6 + c] - r.o2
    ax, ay = corners[k, a] - r.o0 - r.s0 * az, corners[k, b] - r.o1 - r.s1 * az
    bx, by = corners[k, 3 + a] - r.o0 - r.s0 * bz, corners[k, 3 + b] - r.o1 - r.s1 * bz
    cx, cy = corners[k, 6 + a] - r.o0 - r.s0 * cz, corners[k, 6 + b] - r.o1 - r.s1 * cz
    u, v, w = cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax
    if (u >= 0.0 and v >= 0.0 and w >= 0.0) or (u <= 0.0 and v <= 0.0 and w <= 0.0):
        det = u + v + w
        if det != 0.0:
            t = r.s2 * (u * az + v * bz + w * cz) / det
            # a face nearer than 1e-6 of the padding holds the ray's origin, and is hit at distance 0 as by Embree
            t = 0.0 if abs(t) <= 1e-6 * r.padding else t
            if (
                t >= 0.0
                and (t < best or (t == best and (best_face < 0 or face < best_face)))
                and _near(corners, k, r, u, v, w, t)
            ):
                best, best_face = t, np.int64(face)
    return best, best_face


@inlined
def _near(corners, k, r, u, v, w, t):
    """Return whether the ray's point at distance t is that of triangle k with the barycentric weights u, v, w."""
    d = 1.0 / (u + v + w)
    return (
        abs((u * corners[k, 0] + v * corners[k, 3] + w * corners[k, 6]) * d - (r.x + t * r.dx)) <= r.padding
        and abs((u * corners[k, 1] + v * corners[k, 4] + w * corners[k, 7]) * d - (r.y + t * r.dy)) <= r.padding
        and abs((u * corners[k, 2] + v * corners[k, 5] + w * corners[k, 8]) * d - (r.z + t * r.dz)) <= r.padding
    )


@kernel
def touches(corners, k, padding, lx, ly, lz, hx, hy, hz):
    """Return whether the box l .. h overlaps triangle k, grown by the padding: Akenine-Moeller 2001.

    "Fast 3D triangle-box overlap testing": no axis of the box, normal or cross product of an edge with an axis of the
    box separates them.
    """
    mx, my, mz = 0.5 * (lx + hx), 0.5 * (ly + hy), 0.5 * (lz + hz)
    sx, sy, sz = 0.5 * (hx - lx) + padding, 0.5 * (hy - ly) + padding, 0.5 * (hz - lz) + padding
    ax, ay, az = corners[k, 0] - mx, corners[k, 1] - my, corners[k, 2] - mz
    bx, by, bz = corners[k, 3] - mx, corners[k, 4] - my, corners[k, 5] - mz
    cx, cy, cz = corners[k, 6] - mx, corners[k, 7] - my, corners[k, 8] - mz
    if (
        min(ax, min(bx, cx)) > sx
        or max(ax, max(bx, cx)) < -sx
        or min(ay, min(by, cy)) > sy
        or max(ay, max(by, cy)) < -sy
        or min(az, min(bz, cz)) > sz
        or max(az, max(bz, cz)) < -sz
    ):
        return False
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    if abs(nx * ax + ny * ay + nz * az) > abs(nx) * sx + abs(ny) * sy + abs(nz) * sz:
        return False
    return not (
        _apart(ax, ay, az, bx, by, bz, cx, cy, cz, sx, sy, sz)
        or _apart(bx, by, bz, cx, cy, cz, ax, ay, az, sx, sy, sz)
        or _apart(cx, cy, cz, ax, ay, az, bx, by, bz, sx, sy, sz)
    )


@inlined
def _apart(ax, ay, az, bx, by, bz, cx, cy, cz, sx, sy, sz):
    """Return whether edge a-b crossed with an axis of the box -s .. s separates triangle a, b, c from it."""
    ex, ey, ez = bx - ax, by - ay, bz - az
    fx, fy, fz = abs(ex), abs(ey), abs(ez)
    px, py, pz = ey * az - ez * ay, ez * ax - ex * az, ex * ay - ey * ax
    qx, qy, qz = ey * cz - ez * cy, ez * cx - ex * cz, ex * cy - ey * cx
    rx, ry, rz = fy * sz + fz * sy, fz * sx + fx * sz, fx * sy + fy * sx
    return (
        min(px, qx) > rx
        or max(px, qx) < -rx
        or min(py, qy) > ry
        or max(py, qy) < -ry
        or min(pz, qz) > rz
        or max(pz, qz) < -rz
    )


# No structure: every ray is tested against every triangle. The other structures are compared with this one.


def build(meshes: Meshes) -> Triangles:
    """Return the triangles of all objects."""
    return triangles_of(meshes)


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    r, best, best_face, k = test_ray(s, o, ox, oy, oz, dx, dy, dz), np.float64(limit), -1, s.first[o]
    while k < s.first[o + 1] and not (any_hit and best_face >= 0):
        best, best_face = nearer(s.corners, k, k - s.first[o], r, best, best_face)
        k += 1
    ray.view(np.int32)[TESTS] += k - s.first[o]
    return np.float32(best), np.int32(best_face)

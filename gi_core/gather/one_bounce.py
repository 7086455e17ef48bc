"""Hits of single bounces (final gathering, Reichert 1992; Jensen 2001): rho E, interpolated, on diffuse surfaces."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.gather.path_tracer import turned
from gi_core.lights.next_event import share_of_bounce


class Exchange(NamedTuple):
    """Bounces from mobiles that hit mobiles. Receivers are indices among those of mobiles."""

    row: np.ndarray  # (n,) int64, receiver of the bounce
    corners: np.ndarray  # (n, 3) int64, receivers at the corners of the hit face
    share: np.ndarray  # (n, 3) float64, interpolation weights
    reflectance: np.ndarray  # (n, 3) float64


@kernel
def meet(
    paths, positions, normals_here, R_here, directions, distance, face, normals, reflectance, two_sided, rotation,
    position, face_object, lamp, radiance, density, sky, points, corner_front, corner_back, static, first, base,
    total, out,
):  # fmt: skip
    """Add what rays meet on lamps, in the sky and on the static part; write down those that meet mobiles, return how
    many. With pdf cos / pi the mean of pi L is the irradiance, and pi L off a diffuse surface is rho E.
    """
    n = 0
    for k in range(len(face)):
        row, f = k // paths, face[k]
        d = turned(R_here, directions[k])
        if f < 0:
            if d[0] * sky.up[0] + d[1] * sky.up[1] + d[2] * sky.up[2] > 0.0:
                for c in range(3):
                    total[row, c] += math.pi * sky.radiance[c]
            continue
        o = face_object[f]
        R, t = rotation[o], distance[k]
        nx, ny, nz = turned(R, normals[f])
        facing = -(d[0] * nx + d[1] * ny + d[2] * nz)
        if facing > 0.0:
            e = lamp[f]
            if e >= 0:
                share = share_of_bounce(d, normals_here[row], facing, t, density[e])
                for c in range(3):
                    total[row, c] += math.pi * radiance[e, c] * share
        elif not two_sided[f]:
            continue  # the back of a one-sided face is black
        corners = corner_front[f] if facing > 0.0 else corner_back[f]
        x = positions[row, 0] + t * d[0] - position[o, 0]
        y = positions[row, 1] + t * d[1] - position[o, 1]
        z = positions[row, 2] + t * d[2] - position[o, 2]
        u, v, w = _shares(
            points[corners[0]], points[corners[1]], points[corners[2]],
            R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
            R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
            R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
        )  # fmt: skip
        if o == 0:
            for c in range(3):
                E = u * static[corners[0], c] + v * static[corners[1], c] + w * static[corners[2], c]
                total[row, c] += reflectance[f, c] * E
            continue
        out.row[n] = base + row
        out.share[n, 0], out.share[n, 1], out.share[n, 2] = u, v, w
        for c in range(3):
            out.corners[n, c] = corners[c] - first
            out.reflectance[n, c] = reflectance[f, c]
        n += 1
    return n


@kernel
def _shares(a, b, c, x, y, z):
    """Return the barycentric coordinates of a point in a triangle's plane; rounding may not leave the triangle."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = x - a[0], y - a[1], z - a[2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    area2 = uu * vv - uv * uv
    if area2 <= 0.0:
        return 1.0, 0.0, 0.0
    s = min(max((vv * wu - uv * wv) / area2, 0.0), 1.0)
    t = min(max((uu * wv - uv * wu) / area2, 0.0), 1.0 - s)
    return 1.0 - s - t, s, t

"""Hits of single bounces (final gathering, Reichert 1992; Jensen 2001): rho E, interpolated.

Glossy surfaces reflect here as diffuse ones of the same hemispherical albedo.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vec import barycentric, dot, rotate, rotate_back
from gi_core.bsdf import lambertian
from gi_core.lights.next_event import share_of_bounce


class Bounces(NamedTuple):
    """P bounce rays from each of n receivers, and their hits."""

    paths: int  # P
    positions: np.ndarray  # (n, 3) float64, of the receivers, in the world [m]
    normals: np.ndarray  # (n, 3) float64, there
    rotation: np.ndarray  # (3, 3) float64, of directions to the world
    directions: np.ndarray  # (n P, 3) float32 unit
    distance: np.ndarray  # (n P,) float32 [m]
    face: np.ndarray  # (n P,) int32, global; -1: none


class Field(NamedTuple):
    """Irradiance of the static part's receivers, interpolated over faces."""

    points: np.ndarray  # (R, 3) float64, of all receivers, in object space [m]
    corner_front: np.ndarray  # (F, 3) int32, receivers at the corners of a face, on its front
    corner_back: np.ndarray  # (F, 3) int32, on its back
    irradiance: np.ndarray  # (>= receivers of the static part, 3 G) float64 [W/m2], per lamp


class Exchange(NamedTuple):
    """Bounces from mobiles that hit mobiles. Receivers are indices among those of mobiles."""

    row: np.ndarray  # (n,) int64, receiver of the bounce
    corners: np.ndarray  # (n, 3) int64, receivers at the corners of the hit face
    share: np.ndarray  # (n, 3) float64, interpolation weights
    reflectance: np.ndarray  # (n, 3) float64


@kernel
def meet(world, at, lights, sky, field, rays, first, base, total, out):
    """Add to `total` (n, 3 G) the light of rays that hit lamps, the sky and the static part.

    With pdf cos / pi the mean of pi L is the irradiance, and pi L off a diffuse surface is rho E. Hits on mobiles
    are written to `out`, an Exchange: its corners are counted from receiver `first`, its rows from `base`. Returns
    their number. The loop is in one piece: helpers for sky, lamp and corners made it a third slower.
    """
    n, known = 0, field.irradiance
    for k in range(len(rays.face)):
        row, f = k // rays.paths, rays.face[k]
        d = rotate(rays.rotation, rays.directions[k])
        if f < 0:
            if dot(d, sky.up) > 0.0:
                for c in range(3):
                    total[row, 3 * sky.lamp + c] += math.pi * sky.radiance[c]
            continue
        o = world.face_object[f]
        R, p, t = at.rotation[o], at.position[o], rays.distance[k]
        facing = -dot(d, rotate(R, world.normals[f]))
        if facing > 0.0:
            e = lights.of_face[f]
            if e >= 0:
                p_bounce = lambertian.pdf(max(dot(d, rays.normals[row]), 0.0))
                share = share_of_bounce(p_bounce, facing, t, lights.density[e])
                for c in range(3):
                    total[row, 3 * lights.lamp[e] + c] += math.pi * lights.radiance[e, c] * share
        elif not world.two_sided[f]:
            continue  # the back of a one-sided face is black
        corners = field.corner_front[f] if facing > 0.0 else field.corner_back[f]
        start = rays.positions[row]
        there = rotate_back(R, (start[0] + t * d[0] - p[0], start[1] + t * d[1] - p[1], start[2] + t * d[2] - p[2]))
        u, v, w = barycentric(field.points[corners[0]], field.points[corners[1]], field.points[corners[2]], there)
        if o == 0:
            for g in range(0, known.shape[1], 3):
                for c in range(3):
                    E = u * known[corners[0], g + c] + v * known[corners[1], g + c] + w * known[corners[2], g + c]
                    total[row, g + c] += world.bsdfs.albedo[f, c] * E
            continue
        out.row[n] = base + row
        out.share[n, 0], out.share[n, 1], out.share[n, 2] = u, v, w
        for c in range(3):
            out.corners[n, c] = corners[c] - first
            out.reflectance[n, c] = world.bsdfs.albedo[f, c]
        n += 1
    return n

"""Hits of single bounces (final gathering, Reichert 1992; Jensen 2001): rho times the mean E of the face's corners.

Many hits have the mean of interpolated light, which takes more time: it reads the corners' positions. Glossy surfaces
reflect here as diffuse ones of the same hemispherical albedo.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import dot, rotate, row
from gi_core.bsdf import lambertian
from gi_core.lights.next_event import share_of_bounce

# Of the light of the brightest corner or neighbour; above 0, since one photon in a million slips through where edges
# meet. A receiver with less may lie inside another part, see `display/dilation.py`.
BLACK = 0.02
NO_RAYS = np.empty((0, 3, 1), np.float32)  # of meet(): the light of single rays is not wanted


class Bright(NamedTuple):
    """Static faces that have rays of their own, see `bright_faces.py`; empty: none."""

    of_face: np.ndarray  # (F,) int32, index of a face among them, -1: none
    density: np.ndarray  # (A,) float64 [1/m2], probability density of a point on the face


NOTHING_BRIGHT = Bright(np.empty(0, np.int32), np.empty(0))


class Bounces(NamedTuple):
    """Bounce rays from n receivers, and their hits: first[i] to first[i + 1] are those of receiver i."""

    paths: int  # P: sums are P times a mean
    first: np.ndarray  # (n + 1,) int64
    normals: np.ndarray  # (n, 3) float64, of the receivers, in the world
    rotation: np.ndarray  # (3, 3) float64, of directions to the world
    directions: np.ndarray  # (k, 3) float32 unit
    distance: np.ndarray  # (k,) float32 [m]
    face: np.ndarray  # (k,) int32, global; -1: none


class Field(NamedTuple):
    """Irradiance of the static part's receivers, at the corners of faces."""

    corner_front: np.ndarray  # (F, 3) int32, receivers at the corners of a face, on its front
    corner_back: np.ndarray  # (F, 3) int32, on its back
    irradiance: np.ndarray  # (>= receivers of the static part, 3 G) float64 [W/m2], per lamp


class Exchange(NamedTuple):
    """Bounces from mobiles that hit mobiles. Receivers are indices among those of mobiles."""

    row: np.ndarray  # (n,) int64, receiver that the bounce leaves
    path: np.ndarray  # (n,) int64, number of the bounce; -1: the light of single rays is not wanted
    corners: np.ndarray  # (n, 3) int64, receivers at the corners of the hit face
    reflectance: np.ndarray  # (n, 3) float64, times P over the bounces of the receiver
    share: np.ndarray  # (n, 3) float64, weights of the corners, see reached_corners()


@kernel
def meet(world, at, lights, sky, bright, field, rays, first, base, total, by_ray, out):
    """Add to total (n, 3 G) P times the mean light of rays that hit lamps, the sky and the static part.

    With pdf cos / pi the mean of pi L is the irradiance, and pi L off a diffuse surface is rho E. Hits on bright faces
    count with the balance weight of a bounce. by_ray (n, 3, P) float32 gets the whole light of each of P rays, over all
    lamps, or is NO_RAYS. Noise makes light negative, which counts as none in by_ray. Hits on mobiles are written to
    `out`, an Exchange: its corners are counted from receiver `first`, its rows from `base`. Returns their number. The
    loop is in one piece: helpers for sky, lamp and corners made it a third slower.
    """
    n, row, known, static_faces, each = 0, 0, field.irradiance, world.first_face[1], len(by_ray) > 0
    by_ray[:] = np.float32(0.0)
    for k in range(len(rays.face)):
        while k >= rays.first[row + 1]:
            row += 1
        path, part, f = k - rays.first[row], rays.paths / (rays.first[row + 1] - rays.first[row]), rays.face[k]
        d = rotate(rays.rotation, rays.directions[k])
        if f < 0:
            if dot(d, sky.up) > 0.0:
                for c in range(3):
                    light = math.pi * sky.radiance[c]
                    total[row, 3 * sky.lamp + c] += part * light
                    if each:
                        by_ray[row, c, path] += light
            continue
        R = at.rotation[0] if f < static_faces else at.rotation[world.face_object[f]]
        facing = -dot(d, rotate(R, world.normals[f]))
        if facing > 0.0:
            corners, e = field.corner_front[f], lights.of_face[f]
            if e >= 0:
                p_bounce = lambertian.pdf(max(dot(d, rays.normals[row]), 0.0))
                share = share_of_bounce(p_bounce, facing, rays.distance[k], lights.density[e])
                for c in range(3):
                    light = math.pi * lights.radiance[e, c] * share
                    total[row, 3 * lights.lamp[e] + c] += part * light
                    if each:
                        by_ray[row, c, path] += light
        elif world.two_sided[f]:
            corners = field.corner_back[f]
        else:
            continue  # the back of a one-sided face is black
        if f < static_faces:
            u, v, w, share = corners[0], corners[1], corners[2], 1.0
            if facing > 0.0 and len(bright.density) > 0 and bright.of_face[f] >= 0:
                p_bounce = lambertian.pdf(max(dot(d, rays.normals[row]), 0.0))
                share = share_of_bounce(p_bounce, facing, rays.distance[k], bright.density[bright.of_face[f]])
            for g in range(0, known.shape[1], 3):
                for c in range(3):
                    E = (known[u, g + c] + known[v, g + c] + known[w, g + c]) / 3.0
                    light = world.bsdfs.albedo[f, c] * E
                    total[row, g + c] += part * light * share
                    if each:
                        by_ray[row, c, path] += max(light, 0.0)
            continue
        out.row[n], out.path[n] = base + row, path if each else -1
        for c in range(3):
            out.corners[n, c] = corners[c] - first
            out.reflectance[n, c] = part * world.bsdfs.albedo[f, c]
        n += 1
    return n


@kernel
def reached_corners(corners, E, share):
    """Write shares (n, 3) of the corners (n, 3) of faces that bounces hit: equal ones, but 0 for dark corners.

    A corner inside another part has at most BLACK of the light of the brightest one; E (m, 3) of the receivers.
    """
    for k in range(len(corners)):
        brightest, lit = 0.0, 0.0
        for c in corners[k]:
            brightest = max(brightest, E[c, 0] + E[c, 1] + E[c, 2])
        for j, c in enumerate(corners[k]):
            share[k, j] = 1.0 if E[c, 0] + E[c, 1] + E[c, 2] > BLACK * brightest else 0.0
            lit += share[k, j]
        for j in range(3):
            share[k, j] = share[k, j] / lit if lit > 0.0 else 1.0 / 3.0


@inlined
def reflected(exchange, k, E):
    """Return the light (3,) that hit k on a mobile reflects, as a bounce counts it; E (m, 3) of the receivers."""
    (u, v, w), (a, b, c), rho = row(exchange.corners, k), row(exchange.share, k), row(exchange.reflectance, k)
    return (
        rho[0] * (a * E[u, 0] + b * E[v, 0] + c * E[w, 0]),
        rho[1] * (a * E[u, 1] + b * E[v, 1] + c * E[w, 1]),
        rho[2] * (a * E[u, 2] + b * E[v, 2] + c * E[w, 2]),
    )

"""Bright static faces, such as sunlit floor, as lamps of a mobile.

Few of a mobile's bounces meet such a place, so these make most of the noise. Points on bright faces get shadow rays, as
points on lamps do, weighted against bounces that hit the same faces (balance heuristic, Veach 1997). Faces are chosen
by their light at rest, and rays bring their light in the frame, so the mean is that of bounces alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.base.nearest_points import hilbert_order
from gi_core.base.vec import difference, dot, row
from gi_core.geometry.error import REC709
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights.area import AreaLights, largest_cosine

BRIGHT = 4.0  # times the mean light of faces that face a mobile
LEAST_BRIGHT = 0.2  # of their light, from bright ones
BOUNCES_PER_BRIGHT = 8  # bounces per ray to a bright face
RED, GREEN, BLUE = REC709


class BrightFaces(NamedTuple):
    """Bright faces as lamps: each a lamp of its own, of its luminance at rest in all channels."""

    lights: AreaLights
    face: np.ndarray  # (A,) int64


class StaticFaces(NamedTuple):
    """Fronts of the static part's faces, in the order of a Hilbert curve."""

    face: np.ndarray  # (n,) int64
    corners: np.ndarray  # (n, 9) float64 [m]
    middle: np.ndarray  # (n, 3) float64 [m]
    normal: np.ndarray  # (n, 3) float64 unit
    area: np.ndarray  # (n,) float64 [m2]
    receiver: np.ndarray  # (n, 3) int32, at the corners

    @classmethod
    def of(cls, s: Surfaces) -> StaticFaces:
        """Return those of surfaces."""
        corners = s.vertices[0][s.faces[0]]
        middle = corners.mean(axis=1)
        order = hilbert_order(middle)
        ordered = (a[order] for a in (corners.reshape(-1, 9), middle, s.normals, s.areas, s.corner_front))
        return cls(order, *ordered)

    def luminance(self, E: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
        """Return the luminance (n,) [W/m2] that faces reflect; E (receivers, 3) [W/m2], reflectance (F, 3)."""
        out = np.empty(len(self.face))
        _reflect(self.face, self.receiver, E, reflectance, out)
        return out

    def view(self, centre: np.ndarray, radius: float) -> np.ndarray:
        """Return the parts (n,) that faces take of a mobile's view, whether something hides them or not.

        centre (3,) and radius [m]: sphere around the mobile, in the world.
        """
        out = np.empty(len(self.face))
        _look(self.middle, self.normal, self.area, centre, radius, out)
        return out

    def bright(self, luminance: np.ndarray, view: np.ndarray, faces: int) -> BrightFaces:
        """Return the faces that are bright in a view (n,), by their luminance (n,); faces: of all objects."""
        brought = np.empty(len(self.face))
        total, seen = _bring(luminance, view, brought)
        rows = np.flatnonzero((luminance * seen > BRIGHT * total) & (brought > 0.0))
        share = brought[rows]
        if share.sum() < LEAST_BRIGHT * total:
            rows, share = rows[:0], share[:0]
        share /= max(share.sum(), 1e-300)
        cdf = np.cumsum(share)
        cdf[-1:] = 1.0
        n, of_face = len(rows), np.full(faces, -1, np.int32)
        of_face[self.face[rows]] = np.arange(n)
        radiance = np.repeat(luminance[rows, None] / math.pi, 3, axis=1)
        lights = AreaLights(
            self.corners[rows], self.normal[rows], radiance, cdf, share / self.area[rows], of_face, np.arange(n),
            np.full(n, -1), np.zeros((n, 3)), np.zeros(0),
        )  # fmt: skip
        return BrightFaces(lights, self.face[rows])


@kernel
def _reflect(face, receiver, E, reflectance, out):
    for k in range(len(face)):
        rho, (u, v, w) = row(reflectance, face[k]), row(receiver, k)
        red, green, blue = E[u, 0] + E[v, 0] + E[w, 0], E[u, 1] + E[v, 1] + E[w, 1], E[u, 2] + E[v, 2] + E[w, 2]
        out[k] = max((RED * rho[0] * red + GREEN * rho[1] * green + BLUE * rho[2] * blue) / 3.0, 0.0)


@kernel
def _look(middle, normal, area, centre, radius, out):
    for k in range(len(out)):
        way = difference((centre[0], centre[1], centre[2]), row(middle, k))
        d2 = dot(way, way)
        out[k] = area[k] * largest_cosine(dot(way, row(normal, k)), d2, radius) / (d2 + radius * radius + area[k])


@kernel
def _bring(luminance, view, brought):
    """Write the light that faces bring to a mobile; return its sum, and the sum of what lit faces take of its view."""
    total = seen = 0.0
    for k in range(len(brought)):
        brought[k] = luminance[k] * view[k]
        total += brought[k]
        seen += view[k] if luminance[k] > 0.0 else 0.0
    return total, seen


@allocating
def relative_light(face, radiance, corner_front, reflectance, E):
    """Return the radiance (A, 3) of bright faces over that at rest, radiance (A, 3); E (receivers, 3) [W/m2]."""
    out = np.empty((len(face), 3))
    for k, f in enumerate(face):
        u, v, w = row(corner_front, f)
        for c in range(3):
            out[k, c] = reflectance[f, c] * (E[u, c] + E[v, c] + E[w, c]) / (3.0 * math.pi * radiance[k, c])
    return out


@kernel
def add_reflected(rays, blocked, relative, total):
    """Add the light that unblocked rays to bright faces bring, times relative (A, 3 G), to total (n, 3 G)."""
    for j in range(len(blocked)):
        if not blocked[j]:
            for c in range(total.shape[1]):
                total[rays.row[j], c] += rays.value[j, c % 3] * relative[rays.lamp[j], c]

"""Thin panes of glass: rays pass them straight on, or are reflected as by a mirror.

A pane reflects and transmits with all reflections between its two faces (Born and Wolf, Principles of Optics, 1.6.4,
without interference): R = F + (1 - F)^2 F t^2 / (1 - F^2 t^2), T = (1 - F)^2 t / (1 - F^2 t^2). F is Fresnel's
reflectance of unpolarised light, t the internal transmittance along the refracted way.

Rays for light to a point, such as shadow rays, count each pane on the way by T. Rays of paths pass by chance. `Glazed`
is a structure of rays: it holds panes apart from opaque faces, so scenes without panes run the same code as ever.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gi_core.base.jit import by_type, inlined, kernel
from gi_core.base.vec import dot, row
from gi_core.geometry.surfaces import Surfaces
from gi_core.rays import holes
from gi_core.rays.structures import any_hit, nearest_hit
from gi_core.rays.triangles import Meshes

MOST_PANES = 32  # along a ray of a path: light between two panes that face each other fades within a few


class Panes(NamedTuple):
    """Panes among F faces."""

    of_face: np.ndarray  # (F,) int32 into `kinds`, -1: opaque
    kinds: np.ndarray  # (K, 4) float64: internal transmittance red, green, blue; index of refraction


class NoPanes(NamedTuple):
    """A scene without panes: kernels for it have no code for them."""

    of_face: np.ndarray  # (0,) int32
    kinds: np.ndarray  # (0, 4) float64


def panes_of(surfaces: Surfaces) -> Panes | NoPanes:
    """Return the panes of a scene."""
    return (
        Panes(surfaces.pane, surfaces.panes)
        if (surfaces.pane >= 0).any()
        else NoPanes(surfaces.pane[:0], surfaces.panes[:0])
    )


@inlined
def shares(kinds, k, cosine):
    """Return the reflected and the transmitted shares, both (red, green, blue), at the cosine of incidence >= 0."""
    n = kinds[k, 3]
    # with an index of 1 it is the cosine itself, which may be 0
    inside = max(math.sqrt(max(1.0 - (1.0 - cosine * cosine) / (n * n), 0.0)), 1e-9)
    s, p = (cosine - n * inside) / (cosine + n * inside), (n * cosine - inside) / (n * cosine + inside)
    F = 0.5 * (s * s + p * p)
    t, u, v = kinds[k, 0] ** (1.0 / inside), kinds[k, 1] ** (1.0 / inside), kinds[k, 2] ** (1.0 / inside)
    r0, t0 = _slab(F, t)
    r1, t1 = _slab(F, u)
    r2, t2 = _slab(F, v)
    return (r0, r1, r2), (t0, t1, t2)


@inlined
def _slab(F, t):
    inner = (1.0 - F) * (1.0 - F) / max(1.0 - F * F * t * t, 1e-12)
    return F + inner * F * t * t, inner * t


@inlined
def chosen(kinds, k, cosine, u):
    """Return whether a ray passes a pane by chance, u in [0, 1), else is reflected; and its factors, each at most 1."""
    back, on = shares(kinds, k, cosine)
    mirrored = max(back[0], max(back[1], back[2]))
    if u < mirrored:
        return False, (back[0] / mirrored, back[1] / mirrored, back[2] / mirrored)
    rest = 1.0 / (1.0 - mirrored)
    return True, (on[0] * rest, on[1] * rest, on[2] * rest)


def shares_of(kinds: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Return reflected and transmitted shares (2, n, 3) of panes (n, 4), see Panes, at cosines (n,) of incidence."""
    out = np.empty((2, len(cosine), 3))
    _shares_of(np.ascontiguousarray(kinds, np.float64), cosine, out)
    return out


@kernel
def _shares_of(kinds, cosine, out):
    for k in range(len(cosine)):
        out[0, k], out[1, k] = shares(kinds, k, cosine[k])


# pane_at(panes, f): kind of pane of face f, -1: opaque. For kernels only.
pane_at = by_type({NoPanes: lambda panes, f: -1, Panes: lambda panes, f: panes.of_face[f]})


# The structure ------------------------------------------------------------------------------------------------


class Glazed(NamedTuple):
    """Structures of opaque faces and of panes. `opaque` has a point in place of each pane: faces keep their numbers."""

    opaque: Any  # as any structure builds it
    glass: Any  # of the panes alone
    first: np.ndarray  # (objects + 1,) int64, panes before those of each object
    face: np.ndarray  # (P,) int64, face within its object
    kind: np.ndarray  # (P,) int64 into `kinds`
    normal: np.ndarray  # (P, 3) float64 unit, object space
    reach: np.ndarray  # (objects,) float64 [m], largest coordinate of the panes
    kinds: np.ndarray  # (K, 4) float64, see Panes


def build(structure, meshes: Meshes, surfaces: Surfaces) -> Glazed:
    """Return the structure of objects with panes; structure: a module of `structures.STRUCTURES`."""
    opaque, glass, face = [], [], []
    for o, (vertices, faces) in enumerate(meshes):
        own = surfaces.pane[surfaces.face_range(o)] >= 0
        rows = np.flatnonzero(own)
        opaque.append((vertices, np.where(own[:, None], faces[:1, :1], faces) if len(faces) else faces))
        glass.append((vertices, np.ascontiguousarray(faces[rows])))
        face.append(rows)
    first = np.cumsum([0, *map(len, face)])
    every = np.concatenate([rows + surfaces.first_face[o] for o, rows in enumerate(face)])
    reach = np.array([np.abs(v[f]).max(initial=0.0) for v, f in glass])
    kind = surfaces.pane[every].astype(np.int64)
    of_glass = first, np.concatenate(face), kind, surfaces.normals[every], reach, surfaces.panes
    return Glazed(holes.build(structure, opaque, surfaces), structure.build(glass), *of_glass)


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, a pane or not; limit and -1 for none."""
    distance, face = nearest_hit(s.opaque, o, ray, ox, oy, oz, dx, dy, dz, limit)
    if s.first[o + 1] > s.first[o]:
        t, k = nearest_hit(s.glass, o, ray, ox, oy, oz, dx, dy, dz, distance)
        # An opaque face in the plane of a pane is hit first: past the pane, a photon would start behind it.
        if k >= 0 and (face < 0 or t + holes.BEYOND * (t + s.reach[o]) < distance):
            return t, np.int32(s.face[s.first[o] + k])
    return distance, np.int32(face)


def _all_or_nothing(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit):
    share = 0.0 if any_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit) else 1.0
    return share, share, share


def _product(s, o, ray, ox, oy, oz, dx, dy, dz, limit):
    if any_hit(s.opaque, o, ray, ox, oy, oz, dx, dy, dz, limit):
        return 0.0, 0.0, 0.0
    if s.first[o + 1] == s.first[o]:
        return 1.0, 1.0, 1.0
    return _through_glass(s, o, ray, ox, oy, oz, dx, dy, dz, limit)


@kernel
def _through_glass(s, o, ray, ox, oy, oz, dx, dy, dz, limit):
    red, green, blue = 1.0, 1.0, 1.0
    x, y, z, left = ox, oy, oz, limit
    for _ in range(MOST_PANES):
        t, k = nearest_hit(s.glass, o, ray, x, y, z, dx, dy, dz, left)
        if k < 0:
            break
        k += s.first[o]
        cosine = min(abs(dot((float(dx), float(dy), float(dz)), row(s.normal, k))), 1.0)
        _, on = shares(s.kinds, s.kind[k], cosine)
        red, green, blue = red * on[0], green * on[1], blue * on[2]
        past = np.float32(t + holes.BEYOND * (t + s.reach[o]))
        x, y, z, left = x + past * dx, y + past * dy, z + past * dz, left - past
        if left <= np.float32(0.0):
            break
    return red, green, blue


# transmitted(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit): shares (red, green, blue) of light that object o lets pass
# along a ray, all 0 where it blocks it; arguments as for `structures.any_hit`. For kernels only.
transmitted = by_type({Glazed: _product}, _all_or_nothing, inline=True)


@inlined
def left_side(panes, side, towards):
    """Return the side that a ray leaves; towards: cosine of its direction at the front's normal, > 0 on the front."""
    if pane_at(panes, side >> 1) >= 0:
        side = 2 * (side >> 1) + (0 if towards > 0.0 else 1)
    return side

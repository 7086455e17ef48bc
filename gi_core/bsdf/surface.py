"""Reflection by faces of any kind: the one place where kernels choose a model.

Diffuse faces keep a branch of their own in every caller, so a scene without gloss pays nothing. Directions are unit
and in the world; i points to where light comes from, or where a path came from, o to where it goes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import basis
from gi_core.base.vec import dot, weighted
from gi_core.bsdf import ggx

DIFFUSE, GGX = range(2)  # kinds
GRAZING = 1e-6  # least cosine of i: a ray that is float32 may arrive from just below the plane of its face


class Bsdfs(NamedTuple):
    """Reflection of F faces."""

    kind: np.ndarray  # (F,) uint8
    reflectance: np.ndarray  # (F, 3) float64, hemispherical albedo of the diffuse part
    albedo: np.ndarray  # (F, 3) float64, hemispherical albedo of all parts
    lobe: np.ndarray  # (F, 5) float64: F0 red, green, blue, F90, alpha of GGX; (0, 5) in a diffuse scene
    mean_fresnel: np.ndarray  # see ggx.mean_fresnel()


def build_bsdfs(reflectance: np.ndarray, lobe: np.ndarray | None) -> Bsdfs:
    """Return the reflection of faces of `reflectance` (F, 3) under lobes (F, 5); nan: diffuse; None: all diffuse."""
    count = len(reflectance)
    if lobe is None or np.isnan(lobe[:, 4]).all():
        return Bsdfs(np.zeros(count, np.uint8), reflectance, reflectance, np.empty((0, 5)), np.empty((0, 0)))
    glossy = ~np.isnan(lobe[:, 4])
    kind = np.where(glossy, GGX, DIFFUSE).astype(np.uint8)
    return Bsdfs(kind, reflectance, reflectance + ggx.gloss_albedo(lobe), lobe, ggx.mean_fresnel())


@kernel
def _local(d, n):
    """Return a direction in the frame of a normal."""
    ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
    return dot(d, (ax, ay, az)), dot(d, (bx, by, bz)), dot(d, n)


@kernel
def _arriving(d, n):
    """Return i in the frame of a normal, above the surface."""
    x, y, z = _local(d, n)
    z = max(z, GRAZING)
    size = math.sqrt(x * x + y * y + z * z)
    return x / size, y / size, z / size


@kernel
def _in_world(x, y, z, n):
    ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
    return weighted((x, y, z), (ax, ay, az), (bx, by, bz), n)


@kernel
def scattered(bsdfs, f, i, n, u, v, s, t):
    """Scatter a photon at a glossy side of normal n: return o and its factors, (x, y, z), (red, green, blue).

    Factors lie in [0, 1]; the photon is absorbed where all are 0.
    """
    ix, iy, iz = _arriving(i, n)
    x, y, z, r, g, b = ggx.scattered(bsdfs.mean_fresnel, bsdfs.lobe[f], bsdfs.reflectance[f], ix, iy, iz, u, v, s, t)
    return _in_world(x, y, z, n), (r, g, b)


@kernel
def value(bsdfs, f, i, o, n):
    """Return f (red, green, blue) [1/sr] of a glossy side of normal n, without a mirror's part."""
    ix, iy, iz = _arriving(i, n)
    ox, oy, oz = _local(o, n)
    return ggx.value(bsdfs.mean_fresnel, bsdfs.lobe[f], bsdfs.reflectance[f], ix, iy, iz, ox, oy, oz)


@kernel
def pdf(bsdfs, f, i, o, n):
    """Return the density [1/sr] of sampled(), without a mirror's part."""
    ix, iy, iz = _arriving(i, n)
    ox, oy, oz = _local(o, n)
    return ggx.pdf(bsdfs.mean_fresnel, bsdfs.lobe[f], bsdfs.reflectance[f], ix, iy, iz, ox, oy, oz)


@kernel
def sampled(bsdfs, f, i, n, u, v, s):
    """Sample a direction for a path at a glossy side of normal n: return o, f cos / pdf and pdf [1/sr].

    pdf < 0: a mirror's direction, which no other sampler finds. f cos / pdf may exceed 1.
    """
    ix, iy, iz = _arriving(i, n)
    lobe, rho, table = bsdfs.lobe[f], bsdfs.reflectance[f], bsdfs.mean_fresnel
    x, y, z = ggx.sample(table, lobe, rho, ix, iy, iz, u, v, s)
    r, g, b, p = 0.0, 0.0, 0.0, 0.0
    share = ggx.gloss_share(table, lobe, rho, iz)
    if lobe[4] < ggx.SMOOTH and s < share:
        r, g, b = ggx.fresnels(lobe, iz)
        r, g, b, p = r / share, g / share, b / share, -1.0
    elif z > 0.0:
        r, g, b = ggx.value(table, lobe, rho, ix, iy, iz, x, y, z)
        p = ggx.pdf(table, lobe, rho, ix, iy, iz, x, y, z)
        r, g, b = r * z / p, g * z / p, b * z / p
    return _in_world(x, y, z, n), (r, g, b), p

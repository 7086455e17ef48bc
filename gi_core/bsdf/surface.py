"""Reflection by faces of any kind: the one place where kernels choose a model.

Diffuse faces keep a branch of their own in every caller, so a scene without gloss pays nothing. Directions are unit
and in the world; i points to where light comes from, or where a path came from, o to where it goes. n is the normal of
the side, t a tangent that only tables use.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import basis, cosine_hemisphere
from gi_core.base.vec import cross, dot, rotate, weighted
from gi_core.bsdf import ggx, table
from gi_core.bsdf.table import Tables, join

DIFFUSE, GGX, TABLE = range(3)  # kinds
GRAZING = 1e-6  # least cosine of i: a ray that is float32 may arrive from just below the plane of its face
DRAWS = 2048  # directions drawn for the hemispherical albedo of a table


class Bsdfs(NamedTuple):
    """Reflection of F faces."""

    kind: np.ndarray  # (F,) uint8
    reflectance: np.ndarray  # (F, 3) float64, hemispherical albedo of the diffuse part
    albedo: np.ndarray  # (F, 3) float64, hemispherical albedo of all parts
    lobe: np.ndarray  # (F, 5) float64: F0 red, green, blue, F90, alpha; alpha -1 - k: table k; (0, 5): diffuse
    mean_fresnel: np.ndarray  # see ggx.mean_fresnel()
    tables: Tables
    tangent: np.ndarray  # (F, 3) float64 unit, in the object's space; (0, 3) without tables


def build_bsdfs(
    reflectance: np.ndarray, lobe: np.ndarray, tables: Tables | None = None, tangent: np.ndarray | None = None
) -> Bsdfs:
    """Return the reflection of faces of `reflectance` (F, 3) with lobes (F, 5); nan: diffuse."""
    tables = join([]) if tables is None else tables
    tangent = np.empty((0, 3)) if tangent is None else tangent
    kind = np.select([lobe[:, 4] >= 0, lobe[:, 4] < 0], [GGX, TABLE], DIFFUSE).astype(np.uint8)
    if not kind.any():
        return Bsdfs(kind, reflectance, reflectance, np.empty((0, 5)), np.empty((0, 0)), tables, tangent)
    albedo = reflectance + ggx.gloss_albedo(lobe)
    for k in range(len(tables.head)):
        albedo[lobe[:, 4] == -1 - k] += table_albedo(tables, k)
    return Bsdfs(kind, reflectance, albedo, lobe, ggx.mean_fresnel(), tables, tangent)


def table_albedo(tables: Tables, k: int) -> np.ndarray:
    """Return the hemispherical albedo (3,) of a table, by DRAWS directions: within 1 %."""
    total = np.zeros(3)
    for u, v, *draw in np.random.default_rng(0).random((DRAWS, 5)):
        i = cosine_hemisphere(u, v)
        total += table.albedo(tables, k, *i) * np.array(table.sample(tables, k, *i, *draw)[3:])
    return total / DRAWS


@kernel
def tangent_of(bsdfs, R, f):
    """Return the tangent of face f in the world, R (3, 3): rotation of its object; any vector without tables."""
    if len(bsdfs.tangent) == 0:
        return 1.0, 0.0, 0.0
    return rotate(R, bsdfs.tangent[f])


@kernel
def _axes(bsdfs, f, n, t):
    """Return two unit vectors that complete n to the frame of face f."""
    if bsdfs.kind[f] == TABLE:
        return t, cross(n, t)
    ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
    return (ax, ay, az), (bx, by, bz)


@kernel
def _arriving(d, a, b, n):
    """Return i in a frame, above the surface."""
    x, y, z = dot(d, a), dot(d, b), max(dot(d, n), GRAZING)
    size = math.sqrt(x * x + y * y + z * z)
    return x / size, y / size, z / size


@kernel
def _number(bsdfs, f):
    """Return the table of face f."""
    return -1 - int(bsdfs.lobe[f, 4])


@kernel
def scattered(bsdfs, f, i, n, t, u, v, s, w):
    """Scatter a photon at a glossy side by four numbers in [0, 1): return o and its factors (red, green, blue).

    Factors lie in [0, 1]; the photon is absorbed where all are 0.
    """
    a, b = _axes(bsdfs, f, n, t)
    ix, iy, iz = _arriving(i, a, b, n)
    rho = bsdfs.reflectance[f]
    if bsdfs.kind[f] == GGX:
        x, y, z, red, green, blue = ggx.scattered(bsdfs.mean_fresnel, bsdfs.lobe[f], rho, ix, iy, iz, u, v, s, w)
    else:
        x, y, z, red, green, blue = _from_table(bsdfs.tables, _number(bsdfs, f), rho, ix, iy, iz, u, v, s, w)
    return weighted((x, y, z), a, b, n), (red, green, blue)


@kernel
def _from_table(tables, k, rho, ix, iy, iz, u, v, s, w):
    """Choose the table with the probability of its albedo, else the diffuse part with that of the largest rho."""
    share, base = table.albedo(tables, k, ix, iy, iz), max(rho[0], max(rho[1], rho[2]))
    if u < share:
        x, y, z, red, green, blue = table.sample(tables, k, ix, iy, iz, s, w, v)
        if z <= 0.0:
            return 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
        return x, y, z, min(red, 1.0), min(green, 1.0), min(blue, 1.0)
    rest = u - share
    if not rest < base:
        return 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    x, y, z = cosine_hemisphere(rest / base, v)
    return x, y, z, rho[0] / base, rho[1] / base, rho[2] / base


@kernel
def value(bsdfs, f, i, o, n, t):
    """Return f (red, green, blue) [1/sr] of a glossy side, without a mirror's part."""
    a, b = _axes(bsdfs, f, n, t)
    ix, iy, iz = _arriving(i, a, b, n)
    ox, oy, oz = dot(o, a), dot(o, b), dot(o, n)
    rho = bsdfs.reflectance[f]
    if bsdfs.kind[f] == GGX:
        return ggx.value(bsdfs.mean_fresnel, bsdfs.lobe[f], rho, ix, iy, iz, ox, oy, oz)
    if oz <= 0.0:
        return 0.0, 0.0, 0.0
    red, green, blue = table.value(bsdfs.tables, _number(bsdfs, f), ix, iy, iz, ox, oy, oz)
    return red + rho[0] / math.pi, green + rho[1] / math.pi, blue + rho[2] / math.pi


@kernel
def pdf(bsdfs, f, i, o, n, t):
    """Return the density [1/sr] of sampled(), without a mirror's part."""
    a, b = _axes(bsdfs, f, n, t)
    ix, iy, iz = _arriving(i, a, b, n)
    ox, oy, oz = dot(o, a), dot(o, b), dot(o, n)
    rho = bsdfs.reflectance[f]
    if bsdfs.kind[f] == GGX:
        return ggx.pdf(bsdfs.mean_fresnel, bsdfs.lobe[f], rho, ix, iy, iz, ox, oy, oz)
    if oz <= 0.0:
        return 0.0
    k = _number(bsdfs, f)
    share = _table_share(bsdfs.tables, k, rho, ix, iy, iz)
    return share * table.pdf(bsdfs.tables, k, ix, iy, iz, ox, oy, oz) + (1.0 - share) * oz / math.pi


@kernel
def _table_share(tables, k, rho, ix, iy, iz):
    """Return the probability with which a path draws from a table, not from the diffuse part."""
    share, base = table.albedo(tables, k, ix, iy, iz), max(rho[0], max(rho[1], rho[2]))
    return share / max(share + base, 1e-12)


@kernel
def sampled(bsdfs, f, i, n, t, u, v, s):
    """Sample a direction for a path at a glossy side: return o, f cos / pdf and pdf [1/sr].

    pdf < 0: a mirror's direction, which no other sampler finds. f cos / pdf may exceed 1.
    """
    a, b = _axes(bsdfs, f, n, t)
    ix, iy, iz = _arriving(i, a, b, n)
    rho = bsdfs.reflectance[f]
    if bsdfs.kind[f] == GGX:
        (x, y, z), weight, p = _sampled_ggx(bsdfs.mean_fresnel, bsdfs.lobe[f], rho, ix, iy, iz, u, v, s)
    else:
        (x, y, z), weight, p = _sampled_table(bsdfs.tables, _number(bsdfs, f), rho, ix, iy, iz, u, v, s)
    return weighted((x, y, z), a, b, n), weight, p


@kernel
def _sampled_ggx(means, lobe, rho, ix, iy, iz, u, v, s):
    x, y, z = ggx.sample(means, lobe, rho, ix, iy, iz, u, v, s)
    r, g, b, p = 0.0, 0.0, 0.0, 0.0
    share = ggx.gloss_share(means, lobe, rho, iz)
    if lobe[4] < ggx.SMOOTH and s < share:
        r, g, b = ggx.fresnels(lobe, iz)
        r, g, b, p = r / share, g / share, b / share, -1.0
    elif z > 0.0:
        r, g, b = ggx.value(means, lobe, rho, ix, iy, iz, x, y, z)
        p = ggx.pdf(means, lobe, rho, ix, iy, iz, x, y, z)
        r, g, b = r * z / p, g * z / p, b * z / p
    return (x, y, z), (r, g, b), p


@kernel
def _sampled_table(tables, k, rho, ix, iy, iz, u, v, s):
    share, albedo = _table_share(tables, k, rho, ix, iy, iz), table.albedo(tables, k, ix, iy, iz)
    r, g, b, p = 0.0, 0.0, 0.0, 0.0
    if s < share:
        w = s / share
        x, y, z, red, green, blue = table.sample(tables, k, ix, iy, iz, u, v, w)
        if w >= 1.0 - table.mirror_share(tables, k, ix, iy, iz):
            return (x, y, z), (albedo * red / share, albedo * green / share, albedo * blue / share), -1.0
    else:
        x, y, z = cosine_hemisphere(u, v)
    if z > 0.0:
        r, g, b = table.value(tables, k, ix, iy, iz, x, y, z)
        p = share * table.pdf(tables, k, ix, iy, iz, x, y, z) + (1.0 - share) * z / math.pi
        r, g, b = r + rho[0] / math.pi, g + rho[1] / math.pi, b + rho[2] / math.pi
        if p > 0.0:
            r, g, b = r * z / p, g * z / p, b * z / p
    return (x, y, z), (r, g, b), p

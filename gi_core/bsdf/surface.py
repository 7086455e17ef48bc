"""Reflection by faces of any kind: the one place where kernels choose a model.

A scene's faces are described by Diffuse, Glossy or Tabulated. numba compiles kernels for the type that it is given, so
a diffuse scene compiles no gloss, and only one with models of reflection compiles tables.

Directions are unit and in the world; i points to where light comes from, or where a path came from, o to where it goes.
n is the normal of the side, t a tangent that only tables use.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.base.jit import by_type, kernel
from gi_core.base.random_numbers import basis, cosine_hemisphere
from gi_core.base.vec import cross, dot, rotate, weighted
from gi_core.bsdf import ggx, table
from gi_core.bsdf.table import Tables

ALBEDO_DRAWS = 2048  # directions drawn for the hemispherical albedo of a table


class Diffuse(NamedTuple):
    """Reflection of F diffuse faces."""

    reflectance: np.ndarray  # (F, 3) float64, hemispherical albedo
    albedo: np.ndarray  # the same


class Glossy(NamedTuple):
    """Reflection of F faces, some with gloss."""

    reflectance: np.ndarray  # (F, 3) float64, hemispherical albedo of the diffuse part
    albedo: np.ndarray  # (F, 3) float64, hemispherical albedo of all parts
    kind: np.ndarray  # (F,) int32 into `lobes`: few are distinct, and stay in the processor's cache; -1: diffuse
    lobes: np.ndarray  # (K, 5) float64: F0 red, green, blue, F90, alpha
    once: np.ndarray  # see ggx.albedos()


class Tabulated(NamedTuple):
    """Reflection of F faces, some by tables: the first five fields as Glossy."""

    reflectance: np.ndarray
    albedo: np.ndarray
    kind: np.ndarray
    lobes: np.ndarray  # alpha -1 - k: table k
    once: np.ndarray
    tables: Tables
    tangent: np.ndarray  # (F, 3) float64 unit, in the object's space


Bsdfs = Diffuse | Glossy | Tabulated


def build_bsdfs(reflectance: np.ndarray, lobe: np.ndarray, tables: Tables, tangent: np.ndarray) -> Bsdfs:
    """Return the reflection of faces of `reflectance` (F, 3) with lobes (F, 5), tables and tangents of `Surfaces`."""
    if np.isnan(lobe).all():
        return Diffuse(reflectance, reflectance)
    albedo = reflectance + ggx.gloss_albedo(lobe)
    for k in range(len(tables.head)):
        albedo[lobe[:, 4] == -1 - k] += table_albedo(tables, k)
    kind, faces = np.full(len(lobe), -1, np.int32), np.flatnonzero(~np.isnan(lobe[:, 4]))
    kind[faces] = group_of(list(lobe[faces].T.copy().view(np.int64)))
    lobes = np.empty((kind.max() + 1, 5))
    lobes[kind[faces]] = lobe[faces]
    glossy = Glossy(reflectance, albedo, kind, lobes, ggx.albedos())
    return Tabulated(*glossy, tables, tangent) if len(tables.head) else glossy


def table_albedo(tables: Tables, k: int) -> np.ndarray:
    """Return the hemispherical albedo (3,) of a table, by ALBEDO_DRAWS directions: within 1 %."""
    total = np.zeros(3)
    for u, v, *draw in np.random.default_rng(0).random((ALBEDO_DRAWS, 5)):
        i = cosine_hemisphere(u, v)
        total += table.albedo(tables, k, *i) * np.array(table.sample(tables, k, *i, *draw)[3:])
    return total / ALBEDO_DRAWS


# GGX ----------------------------------------------------------------------------------------------------------


@kernel
def _has_lobe(bsdfs, f):
    return bsdfs.kind[f] >= 0


@kernel
def _basis_of(n):
    ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
    return (ax, ay, az), (bx, by, bz)


@kernel
def _arriving(d, a, b, n):
    """Return i in a frame, above the surface."""
    # a float32 ray may arrive from just below the plane of its face
    x, y, z = dot(d, a), dot(d, b), max(dot(d, n), 1e-6)
    size = math.sqrt(x * x + y * y + z * z)
    return x / size, y / size, z / size


@kernel
def _ggx_scattered(bsdfs, f, i, n, t, u, v, s, w):
    a, b = _basis_of(n)
    ix, iy, iz = _arriving(i, a, b, n)
    lobe, rho = bsdfs.lobes[bsdfs.kind[f]], bsdfs.reflectance[f]
    x, y, z, red, green, blue = ggx.scattered(bsdfs.once, lobe, rho, ix, iy, iz, u, v, s, w)
    return weighted((x, y, z), a, b, n), (red, green, blue)


@kernel
def _ggx_value(bsdfs, f, i, o, n, t):
    a, b = _basis_of(n)
    ix, iy, iz = _arriving(i, a, b, n)
    lobe, rho = bsdfs.lobes[bsdfs.kind[f]], bsdfs.reflectance[f]
    return ggx.value(bsdfs.once, lobe, rho, ix, iy, iz, dot(o, a), dot(o, b), dot(o, n))


@kernel
def _ggx_pdf(bsdfs, f, i, o, n, t):
    a, b = _basis_of(n)
    ix, iy, iz = _arriving(i, a, b, n)
    lobe, rho = bsdfs.lobes[bsdfs.kind[f]], bsdfs.reflectance[f]
    return ggx.pdf(bsdfs.once, lobe, rho, ix, iy, iz, dot(o, a), dot(o, b), dot(o, n))


@kernel
def _ggx_sampled(bsdfs, f, i, n, t, u, v, s):
    a, b = _basis_of(n)
    ix, iy, iz = _arriving(i, a, b, n)
    means, lobe, rho = bsdfs.once, bsdfs.lobes[bsdfs.kind[f]], bsdfs.reflectance[f]
    x, y, z = ggx.sample(means, lobe, rho, ix, iy, iz, u, v, s)
    red, green, blue, p = 0.0, 0.0, 0.0, 0.0
    share = ggx.gloss_share(means, lobe, rho, iz)
    if lobe[4] < ggx.SMOOTH and s < share:
        red, green, blue = ggx.fresnels(lobe, iz)
        red, green, blue, p = red / share, green / share, blue / share, -1.0
    elif z > 0.0:
        red, green, blue = ggx.value(means, lobe, rho, ix, iy, iz, x, y, z)
        p = ggx.pdf(means, lobe, rho, ix, iy, iz, x, y, z)
        red, green, blue = red * z / p, green * z / p, blue * z / p
    return weighted((x, y, z), a, b, n), (red, green, blue), p


# Tables -------------------------------------------------------------------------------------------------------


@kernel
def _along(bsdfs, R, f):
    return rotate(R, bsdfs.tangent[f])


@kernel
def _number(bsdfs, f):
    """Return the table of face f, < 0: it has GGX."""
    alpha = bsdfs.lobes[bsdfs.kind[f], 4]
    return -1 - int(alpha) if alpha < 0.0 else -1


@kernel
def _table_scattered(bsdfs, f, i, n, t, u, v, s, w):
    """Choose the table with the probability of its albedo, else the diffuse part with that of the largest rho."""
    k = _number(bsdfs, f)
    if k < 0:
        return _ggx_scattered(bsdfs, f, i, n, t, u, v, s, w)
    b, rho, tables = cross(n, t), bsdfs.reflectance[f], bsdfs.tables
    ix, iy, iz = _arriving(i, t, b, n)
    share, base = table.albedo(tables, k, ix, iy, iz), max(rho[0], max(rho[1], rho[2]))
    x, y, z, red, green, blue = 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    if u < share:
        x, y, z, red, green, blue = table.sample(tables, k, ix, iy, iz, s, w, v)
        inside = 1.0 if z > 0.0 else 0.0
        red, green, blue = inside * min(red, 1.0), inside * min(green, 1.0), inside * min(blue, 1.0)
    elif u - share < base:
        x, y, z = cosine_hemisphere((u - share) / base, v)
        red, green, blue = rho[0] / base, rho[1] / base, rho[2] / base
    return weighted((x, y, z), t, b, n), (red, green, blue)


@kernel
def _table_value(bsdfs, f, i, o, n, t):
    k = _number(bsdfs, f)
    if k < 0:
        return _ggx_value(bsdfs, f, i, o, n, t)
    b, rho = cross(n, t), bsdfs.reflectance[f]
    ix, iy, iz = _arriving(i, t, b, n)
    if dot(o, n) <= 0.0:
        return 0.0, 0.0, 0.0
    red, green, blue = table.value(bsdfs.tables, k, ix, iy, iz, dot(o, t), dot(o, b), dot(o, n))
    return red + rho[0] / math.pi, green + rho[1] / math.pi, blue + rho[2] / math.pi


@kernel
def _table_share(tables, k, rho, ix, iy, iz):
    """Return the probability with which a path draws from a table, not from the diffuse part."""
    share, base = table.albedo(tables, k, ix, iy, iz), max(rho[0], max(rho[1], rho[2]))
    return share / max(share + base, 1e-12)


@kernel
def _table_pdf(bsdfs, f, i, o, n, t):
    k = _number(bsdfs, f)
    if k < 0:
        return _ggx_pdf(bsdfs, f, i, o, n, t)
    b, z = cross(n, t), dot(o, n)
    ix, iy, iz = _arriving(i, t, b, n)
    if z <= 0.0:
        return 0.0
    share = _table_share(bsdfs.tables, k, bsdfs.reflectance[f], ix, iy, iz)
    return share * table.pdf(bsdfs.tables, k, ix, iy, iz, dot(o, t), dot(o, b), z) + (1.0 - share) * z / math.pi


@kernel
def _table_sampled(bsdfs, f, i, n, t, u, v, s):
    k = _number(bsdfs, f)
    if k < 0:
        return _ggx_sampled(bsdfs, f, i, n, t, u, v, s)
    b, rho, tables = cross(n, t), bsdfs.reflectance[f], bsdfs.tables
    ix, iy, iz = _arriving(i, t, b, n)
    share, albedo = _table_share(tables, k, rho, ix, iy, iz), table.albedo(tables, k, ix, iy, iz)
    red, green, blue, p = 0.0, 0.0, 0.0, 0.0
    if s < share:
        w = s / share
        x, y, z, red, green, blue = table.sample(tables, k, ix, iy, iz, u, v, w)
        if w >= 1.0 - table.mirror_share(tables, k, ix, iy, iz):
            factor = albedo / share
            return weighted((x, y, z), t, b, n), (factor * red, factor * green, factor * blue), -1.0
    else:
        x, y, z = cosine_hemisphere(u, v)
    red, green, blue = 0.0, 0.0, 0.0
    if z > 0.0:
        red, green, blue = table.value(tables, k, ix, iy, iz, x, y, z)
        p = share * table.pdf(tables, k, ix, iy, iz, x, y, z) + (1.0 - share) * z / math.pi
        red, green, blue = red + rho[0] / math.pi, green + rho[1] / math.pi, blue + rho[2] / math.pi
        if p > 0.0:
            red, green, blue = red * z / p, green * z / p, blue * z / p
    return weighted((x, y, z), t, b, n), (red, green, blue), p


# Queries of kernels: numba chooses by the type of `bsdfs` -----------------------------------------------------

# is_glossy(bsdfs, f): whether face f is anything but diffuse.
is_glossy = by_type({Diffuse: lambda bsdfs, f: False, Glossy: _has_lobe, Tabulated: _has_lobe})

# tangent_of(bsdfs, R, f): of face f in the world; R (3, 3): rotation of its object. Any vector without tables.
tangent_of = by_type({
    Diffuse: lambda bsdfs, R, f: (1.0, 0.0, 0.0), Glossy: lambda bsdfs, R, f: (1.0, 0.0, 0.0), Tabulated: _along
})  # fmt: skip

# scattered(bsdfs, f, i, n, t, u, v, s, w): a photon at a glossy side, by four numbers in [0, 1): o and its factors
# (red, green, blue) in [0, 1]; it is absorbed where all are 0.
scattered = by_type({
    Diffuse: lambda bsdfs, f, i, n, t, u, v, s, w: ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    Glossy: _ggx_scattered, Tabulated: _table_scattered
})  # fmt: skip

# value(bsdfs, f, i, o, n, t): f (red, green, blue) [1/sr] of a glossy side, without a mirror's part.
value = by_type({
    Diffuse: lambda bsdfs, f, i, o, n, t: (0.0, 0.0, 0.0), Glossy: _ggx_value, Tabulated: _table_value
})  # fmt: skip

# pdf(bsdfs, f, i, o, n, t): the density [1/sr] of sampled(), without a mirror's part.
pdf = by_type({Diffuse: lambda bsdfs, f, i, o, n, t: 0.0, Glossy: _ggx_pdf, Tabulated: _table_pdf})

# sampled(bsdfs, f, i, n, t, u, v, s): a direction for a path at a glossy side: o, f cos / pdf, which may exceed 1, and
# pdf [1/sr]; pdf < 0: a mirror's direction, which no other sampler finds.
sampled = by_type({
    Diffuse: lambda bsdfs, f, i, n, t, u, v, s: ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0),
    Glossy: _ggx_sampled, Tabulated: _table_sampled
})  # fmt: skip

"""GGX microfacets over a diffuse base: metal, varnish, plastic; below SMOOTH a perfect mirror.

Distribution and masking: Walter et al. 2007, with Smith's height-correlated G2 (Heitz 2014). Fresnel: Schlick 1994,
from F0 to F90. Half vectors are drawn from those visible (Dupuy and Benyoub 2023), so a draw weighs F G2 / G1 <= 1.

Fresnel's factor chooses between gloss and base, so throughput never grows. The base couples as
f = rho' / pi (1 - E(i)) (1 - E(o)) / (1 - E_mean)^2, with E(i) the mean of F over visible half vectors and E_mean its
cosine-weighted mean (Kelemen and Szirmay-Kalos 2001): reciprocal, and rho' is the base's hemispherical albedo. One
reflection between facets is modelled; rough metal loses the light of further ones.

Directions i (towards the light's start) and o are unit, in the local frame, z along the normal.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import cosine_hemisphere

SMOOTH = 1e-3  # alpha below it: a perfect mirror
NODES = 33  # of the table of mean Fresnel factors, in alpha and in cos
MOST_COUPLING = 1.05  # of (1 - E(o)) / (1 - E_mean): its bound 1 / (1 - 1 / 21) for smooth surfaces seen from above
MOST_BASE = 0.95  # base reflectance rho' / (1 - E_mean), so that MOST_COUPLING times it stays below 1


@cache
def mean_fresnel() -> np.ndarray:
    """Return the mean of (1 - i.h)^5 over visible half vectors, (NODES, NODES + 1) float64.

    Rows: alpha = k / (NODES - 1). Columns: cos of i = k / (NODES - 1), then the cosine-weighted mean over i.
    """
    steps, count = np.arange(NODES) / (NODES - 1), 48
    u, v = ((a + 0.5).reshape(-1) / count for a in np.meshgrid(np.arange(count), np.arange(count)))
    out = np.empty((NODES, NODES + 1))
    for k, alpha in enumerate(np.maximum(steps, SMOOTH)):
        for j, cos in enumerate(np.maximum(steps, 1e-3)):
            x, y, z = _visible_half(alpha, math.sqrt(1 - cos * cos), 0.0, cos, u, v)
            out[k, j] = np.mean((1 - np.clip(math.sqrt(1 - cos * cos) * x + cos * z, 0, 1)) ** 5)
        middles = (np.arange(256) + 0.5) / 256
        out[k, NODES] = np.mean(2 * middles * np.interp(middles, steps, out[k, :NODES]))
    return out


def _visible_half(alpha, ix, iy, iz, u, v):
    """Return half vectors (x, y, z) for numbers (n,): the arithmetic of visible_half() on arrays."""
    wx, wy, wz = alpha * ix, alpha * iy, iz
    size = math.sqrt(wx * wx + wy * wy + wz * wz)
    wx, wy, wz = wx / size, wy / size, wz / size
    phi, z = 2 * math.pi * u, (1 - v) * (1 + wz) - wz
    s = np.sqrt(np.clip(1 - z * z, 0, 1))
    x, y, z = alpha * (s * np.cos(phi) + wx), alpha * (s * np.sin(phi) + wy), np.maximum(z + wz, 0)
    size = np.sqrt(x * x + y * y + z * z)
    return x / size, y / size, z / size


@kernel
def visible_half(alpha, ix, iy, iz, u, v):
    """Return a half vector (x, y, z), distributed as those seen from i."""
    wx, wy, wz = alpha * ix, alpha * iy, iz
    size = math.sqrt(wx * wx + wy * wy + wz * wz)
    wx, wy, wz = wx / size, wy / size, wz / size
    phi, z = 2.0 * math.pi * u, (1.0 - v) * (1.0 + wz) - wz
    s = math.sqrt(max(0.0, 1.0 - z * z))
    x, y, z = alpha * (s * math.cos(phi) + wx), alpha * (s * math.sin(phi) + wy), max(z + wz, 1e-12)
    size = math.sqrt(x * x + y * y + z * z)
    return x / size, y / size, z / size


@kernel
def fresnel(f0, f90, cos):
    """Return Schlick's reflected share at an angle of i.h = cos."""
    return f0 + (f90 - f0) * max(0.0, 1.0 - cos) ** 5


@kernel
def fresnels(lobe, cos):
    """Return fresnel() of the three channels of a lobe."""
    return fresnel(lobe[0], lobe[3], cos), fresnel(lobe[1], lobe[3], cos), fresnel(lobe[2], lobe[3], cos)


@kernel
def interpolated_mean(table, alpha, cos):
    """Return mean_fresnel() at alpha and cos in [0, 1], bilinear; cos < 0: its mean over directions."""
    a = min(max(alpha, 0.0), 1.0) * (NODES - 1)
    k = min(int(a), NODES - 2)
    s = a - k
    if cos < 0.0:
        return (1.0 - s) * table[k, NODES] + s * table[k + 1, NODES]
    c = min(cos, 1.0) * (NODES - 1)
    j = min(int(c), NODES - 2)
    t = c - j
    below = (1.0 - t) * table[k, j] + t * table[k, j + 1]
    return (1.0 - s) * below + s * ((1.0 - t) * table[k + 1, j] + t * table[k + 1, j + 1])


@kernel
def largest(lobe):
    """Return the largest F0 of a lobe (F0 red, green, blue, F90, alpha)."""
    return max(lobe[0], max(lobe[1], lobe[2]))


@kernel
def passed(table, lobe, cos):
    """Return 1 - E(cos), the share that passes to the base; cos < 0: 1 - E_mean."""
    mean, f0 = interpolated_mean(table, lobe[4], cos), largest(lobe)
    return 1.0 - f0 - (lobe[3] - f0) * mean


@kernel
def _lambda(alpha, cos):
    """Return Smith's Lambda of a direction."""
    tan2 = max(0.0, 1.0 - cos * cos) / (cos * cos)
    return 0.5 * (math.sqrt(1.0 + alpha * alpha * tan2) - 1.0)


@kernel
def masking(alpha, cos_i, cos_o):
    """Return G2 / G1: the share of the facets seen from i that are also seen from o."""
    a = _lambda(alpha, cos_i)
    return (1.0 + a) / (1.0 + a + _lambda(alpha, cos_o))


@kernel
def distribution(alpha, cos_h):
    """Return the density [1/sr] of facets with normals at that angle, times their area."""
    c2, a2 = cos_h * cos_h, alpha * alpha
    t = c2 * (a2 - 1.0) + 1.0
    return a2 / (math.pi * t * t)


@kernel
def scattered(table, lobe, rho, ix, iy, iz, u, v, s, t):
    """Draw a direction by four numbers in [0, 1): return (x, y, z) and factors of red, green, blue, each in [0, 1].

    The photon is absorbed where all factors are 0.
    """
    alpha = lobe[4]
    hx, hy, hz = 0.0, 0.0, 1.0
    if alpha >= SMOOTH:
        hx, hy, hz = visible_half(alpha, ix, iy, iz, s, t)
    c = ix * hx + iy * hy + iz * hz
    most = fresnel(largest(lobe), lobe[3], c)
    if u < most:
        x, y, z = 2.0 * c * hx - ix, 2.0 * c * hy - iy, 2.0 * c * hz - iz
        if z <= 0.0:
            return 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
        g = (masking(alpha, iz, z) if alpha >= SMOOTH else 1.0) / most
        red, green, blue = fresnels(lobe, c)
        return x, y, z, g * red, g * green, g * blue
    mean = passed(table, lobe, -1.0)
    base = max(rho[0], max(rho[1], rho[2]))
    survival = MOST_COUPLING * base / max(mean, 1e-9)
    rest = (u - most) / (1.0 - most)
    if not rest < survival:
        return 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    x, y, z = cosine_hemisphere(rest / survival, v)
    w = min(1.0, passed(table, lobe, z) / mean / MOST_COUPLING) / base
    return x, y, z, w * rho[0], w * rho[1], w * rho[2]


@kernel
def value(table, lobe, rho, ix, iy, iz, ox, oy, oz):
    """Return f (red, green, blue) [1/sr], without a mirror's part; 0 below the surface."""
    if iz <= 0.0 or oz <= 0.0:
        return 0.0, 0.0, 0.0
    mean = max(passed(table, lobe, -1.0), 1e-9)
    base = passed(table, lobe, iz) * passed(table, lobe, oz) / (math.pi * mean * mean)
    r, g, b = base * rho[0], base * rho[1], base * rho[2]
    alpha = lobe[4]
    if alpha >= SMOOTH:
        k, c = gloss(alpha, ix, iy, iz, ox, oy, oz)
        red, green, blue = fresnels(lobe, c)
        r, g, b = r + k * red, g + k * green, b + k * blue
    return r, g, b


@kernel
def gloss(alpha, ix, iy, iz, ox, oy, oz):
    """Return D G2 / (4 cos cos) [1/sr], the gloss of F = 1, and i.h; both directions above the surface."""
    hx, hy, hz = ix + ox, iy + oy, iz + oz
    size = max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-12)
    a, b = _lambda(alpha, iz), _lambda(alpha, oz)
    k = distribution(alpha, hz / size) / (4.0 * iz * oz * (1.0 + a + b))
    return k, min(1.0, (ix * hx + iy * hy + iz * hz) / size)


@kernel
def gloss_share(table, lobe, rho, iz):
    """Return the probability with which sample() draws gloss, from the albedos of both parts."""
    base = max(rho[0], max(rho[1], rho[2]))
    if base <= 0.0:
        return 1.0
    through = passed(table, lobe, iz)
    top = max(1.0 - through, 0.0)
    return min(0.9, max(0.1, top / max(top + base * through, 1e-12)))


@kernel
def sample(table, lobe, rho, ix, iy, iz, u, v, s):
    """Draw a direction (x, y, z) by three numbers in [0, 1) for paths, whose weights may grow; s chooses the part."""
    if s < gloss_share(table, lobe, rho, iz):
        if lobe[4] < SMOOTH:
            return -ix, -iy, iz
        hx, hy, hz = visible_half(lobe[4], ix, iy, iz, u, v)
        c = ix * hx + iy * hy + iz * hz
        return 2.0 * c * hx - ix, 2.0 * c * hy - iy, 2.0 * c * hz - iz
    return cosine_hemisphere(u, v)


@kernel
def pdf(table, lobe, rho, ix, iy, iz, ox, oy, oz):
    """Return the density [1/sr] of sample(), without a mirror's part."""
    if iz <= 0.0 or oz <= 0.0:
        return 0.0
    share = gloss_share(table, lobe, rho, iz)
    out = (1.0 - share) * oz / math.pi
    alpha = lobe[4]
    if alpha >= SMOOTH:
        hx, hy, hz = ix + ox, iy + oy, iz + oz
        size = max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-12)
        out += share * distribution(alpha, hz / size) / (4.0 * iz * (1.0 + _lambda(alpha, iz)))
    return out


def under_gloss(lobe: np.ndarray) -> np.ndarray:
    """Return 1 - E_mean of lobes (F, 5): the share of a base's reflectance that is left under gloss; 1 without."""
    top = lobe[:, :3].max(axis=1)
    passed = np.maximum(1 - top - (lobe[:, 3] - top) * _mean_over_directions(lobe[:, 4]), 0.0)
    return np.where(lobe[:, 4] >= 0, passed, 1.0)


def gloss_albedo(lobe: np.ndarray) -> np.ndarray:
    """Return the hemispherical albedo (F, 3) of lobes (F, 5), without the loss by masking; 0 without gloss."""
    albedo = lobe[:, :3] + (lobe[:, 3:4] - lobe[:, :3]) * _mean_over_directions(lobe[:, 4])[:, None]
    return np.where(lobe[:, 4:5] >= 0, albedo, 0.0)


def _mean_over_directions(alpha: np.ndarray) -> np.ndarray:
    return np.interp(np.nan_to_num(alpha), np.arange(NODES) / (NODES - 1), mean_fresnel()[:, NODES])

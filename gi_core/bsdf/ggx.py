"""GGX microfacets over a diffuse base: metal, varnish, plastic; below SMOOTH a perfect mirror.

Distribution and masking: Walter et al. 2007, with Smith's height-correlated G2 (Heitz 2014). Fresnel: Schlick 1994,
from F0 to F90. Half vectors are drawn from those visible (Dupuy and Benyoub 2023), so a draw weighs F G2 / G1 <= 1.

Facets that reflect once have the albedo E(i): the mean of F G2 / G1 over visible half vectors. The base takes the rest,
f = rho' / pi (1 - E(i)) (1 - E(o)) / (1 - E_mean)^2, with E_mean the cosine-weighted mean (Kelemen and Szirmay-Kalos
2001): reciprocal, and rho' is its hemispherical albedo. Facets that reflect more than once are part of it, as light
that they scatter evenly (Kulla and Conty 2017), so rough metal has a base too. Fresnel's factor and masking choose
between gloss and base, so throughput never grows.

Directions i (towards the light's start) and o are unit, in the local frame, z along the normal.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import cosine_hemisphere

SMOOTH = 1e-3  # alpha below it: a perfect mirror
ENTRIES = 33  # of the table of albedos, in alpha and in cos; 2^k + 1


@cache
def albedos() -> np.ndarray:
    """Return the albedos of facets that reflect once, (4, ENTRIES, ENTRIES) float64.

    Rows: alpha = k / (ENTRIES - 1). Columns: cos of i = k / (ENTRIES - 1). Plane 0: the mean A of G2 / G1 over visible
    half vectors, the albedo for F = 1; plane 1: the mean B of (1 - i.h)^5 G2 / G1, so that E = F0 A + (F90 - F0) B.
    Planes 2, 3: integrals of 2 cos A and 2 cos B from 0 to that cosine; the last column is the mean over directions.
    """
    steps, count = np.arange(ENTRIES) / (ENTRIES - 1), 64
    u, v = ((a + 0.5).reshape(-1) / count for a in np.meshgrid(np.arange(count), np.arange(count)))
    out = np.zeros((4, ENTRIES, ENTRIES))
    for k, alpha in enumerate(np.maximum(steps, SMOOTH)):
        for j, cos in enumerate(np.maximum(steps, 1e-3)):
            sine = math.sqrt(1 - cos * cos)
            x, _, z = _visible_half(alpha, sine, 0.0, cos, u, v)
            c = np.clip(sine * x + cos * z, 0, 1)
            seen = _shared(alpha, cos, 2 * c * z - cos)
            out[:2, k, j] = seen.mean(), (seen * (1 - c) ** 5).mean()
    # Values are linear between nodes, and so are the integrals exact.
    low, high, first, last = out[:2, :, :-1], out[:2, :, 1:], steps[:-1], steps[1:]
    slope = (high - low) / (last - first)
    parts = (low - slope * first) * (last**2 - first**2) + slope * 2 / 3 * (last**3 - first**3)
    out[2:, :, 1:] = np.cumsum(parts, axis=2)
    return out


def _shared(alpha: float, cos_i: float, cos_o: np.ndarray) -> np.ndarray:
    """Return masking() for an array of cosines, 0 below the surface."""
    a, b = (0.5 * (np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) - 1) for c in (cos_i, np.maximum(cos_o, 1e-9)))
    return np.where(cos_o > 0, (1 + a) / (1 + a + b), 0.0)


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
def largest(lobe):
    """Return the largest F0 of a lobe (F0 red, green, blue, F90, alpha)."""
    return max(lobe[0], max(lobe[1], lobe[2]))


@kernel
def _once(table, plane, lobe, j):
    """Return E of the largest channel at node j of the cosine: of planes `plane` and `plane` + 1 of albedos()."""
    a = min(max(lobe[4], 0.0), 1.0) * (ENTRIES - 1)
    k = min(int(a), ENTRIES - 2)
    s, f0 = a - k, largest(lobe)
    straight = (1.0 - s) * table[plane, k, j] + s * table[plane, k + 1, j]
    grazing = (1.0 - s) * table[plane + 1, k, j] + s * table[plane + 1, k + 1, j]
    return f0 * straight + (lobe[3] - f0) * grazing


@kernel
def passed(table, lobe, cos):
    """Return 1 - E(cos), the share that passes to the base; cos < 0: 1 - E_mean."""
    if cos < 0.0:
        return 1.0 - _once(table, 2, lobe, ENTRIES - 1)
    c = min(cos, 1.0) * (ENTRIES - 1)
    j = min(int(c), ENTRIES - 2)
    t = c - j
    return 1.0 - (1.0 - t) * _once(table, 0, lobe, j) - t * _once(table, 0, lobe, j + 1)


@kernel
def _base_cosine(table, lobe, mean, u):
    """Return a cosine of density 2 cos (1 - E(cos)) / mean for u in [0, 1); mean: 1 - E_mean."""
    wanted, j, step = u * mean, 0, (ENTRIES - 1) // 2
    while step > 0:
        c = (j + step) / (ENTRIES - 1)
        if c * c - _once(table, 2, lobe, j + step) <= wanted:
            j += step
        step //= 2
    low, high = j / (ENTRIES - 1), (j + 1) / (ENTRIES - 1)
    wanted -= low * low - _once(table, 2, lobe, j)
    p = 1.0 - _once(table, 0, lobe, j)
    slope = (1.0 - _once(table, 0, lobe, j + 1) - p) / (high - low)
    whole = high * high - _once(table, 2, lobe, j + 1) - low * low + _once(table, 2, lobe, j)
    c = math.sqrt(low * low + (high * high - low * low) * min(max(wanted / max(whole, 1e-300), 0.0), 1.0))
    for _ in range(4):  # 4 steps of Newton's method to a cosine: its error is below 1e-6
        more = c * c - low * low
        off = (p - slope * low) * more + slope * 2.0 / 3.0 * (c * c * c - low * low * low) - wanted
        c = min(max(c - off / max(2.0 * c * (p + slope * (c - low)), 1e-12), low), high)
    return c


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
    x, y, z = 2.0 * c * hx - ix, 2.0 * c * hy - iy, 2.0 * c * hz - iz
    most, seen = fresnel(largest(lobe), lobe[3], c), 1.0
    if alpha >= SMOOTH:
        seen = masking(alpha, iz, z) if z > 0.0 else 0.0
    if u < most * seen:
        red, green, blue = fresnels(lobe, c)
        return x, y, z, red / most, green / most, blue / most
    mean, base = passed(table, lobe, -1.0), max(rho[0], max(rho[1], rho[2]))
    survival, rest = min(base / max(mean, 1e-9), 1.0), (u - most * seen) / (1.0 - most * seen)
    if not rest < survival:
        return 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    z = _base_cosine(table, lobe, mean, rest / survival)
    across, turn = math.sqrt(max(0.0, 1.0 - z * z)), 2.0 * math.pi * v
    return across * math.cos(turn), across * math.sin(turn), z, rho[0] / base, rho[1] / base, rho[2] / base


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
    """Return 1 - E_mean of lobes (F, 5): the share of light that passes to a base; 1 without gloss."""
    return np.where(lobe[:, 4] >= 0, np.maximum(1 - gloss_albedo(lobe).max(axis=1), 0.0), 1.0)


def gloss_albedo(lobe: np.ndarray) -> np.ndarray:
    """Return the hemispherical albedo (F, 3) of facets that reflect once, for lobes (F, 5); 0 without gloss."""
    straight, grazing = (_mean(plane, lobe)[:, None] for plane in (2, 3))
    albedo = lobe[:, :3] * straight + (lobe[:, 3:4] - lobe[:, :3]) * grazing
    return np.where(lobe[:, 4:5] >= 0, albedo, 0.0)


def further_albedo(lobe: np.ndarray) -> np.ndarray:
    """Return the hemispherical albedo (F, 3) of facets that reflect more than once (Kulla and Conty 2017)."""
    lost = 1 - _mean(2, lobe)[:, None]
    mean = lobe[:, :3] + (lobe[:, 3:4] - lobe[:, :3]) / 21  # of Schlick's F over directions
    return np.where(lobe[:, 4:5] >= SMOOTH, mean * mean * (1 - lost) * lost / (1 - mean * lost), 0.0)


def base_albedo(lobe: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
    """Return rho' (F, 3) of faces of `reflectance` (F, 3) under lobes (F, 5): all but facets that reflect once."""
    further = further_albedo(lobe)
    return further + np.maximum(under_gloss(lobe)[:, None] - further, 0.0) * reflectance


def _mean(plane: int, lobe: np.ndarray) -> np.ndarray:
    return np.interp(np.nan_to_num(lobe[:, 4]), np.arange(ENTRIES) / (ENTRIES - 1), albedos()[plane, :, -1])

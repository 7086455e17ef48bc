"""Tables of reflection models, sampled, evaluated and integrated without error of their own.

The table is the surface that a scene uses: `sample`, `value`, `pdf` and `albedo` belong to one f, which differs from
the model by the interpolation alone (docs/decisions/reflection-tables.md). `tabulate.py` builds it.

Half vectors h have the slopes rho (sx cos psi, sy sin psi), with widths sx, sy of the lobe by theta_i. The horizon of o
cuts rho at R(psi, i): y in [0, 1] is defined by 1 / rho^2 = (1 - y) / y + 1 / R^2, so every (y, psi) is a direction o
above the surface. Stored is D = max over channels of f cos(theta_o) dw_o / (dy dpsi) at nodes (y, psi), for rows of
incidence (theta_i, phi_i), bilinear in between, linear in theta_i and phi_i. Isotropic materials have psi relative to
i, from 0 to pi. Anisotropic ones have i in one quadrant and psi from 0 to 2 pi. A lobe that returns towards the light
is stored turned by 180 degrees about the normal, so that it too is centred on h = normal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import interval

# Columns of Tables.head: numbers of rows theta_i, of rows phi_i, of cells of y, of cells of psi, of stored channels; -1
# if o is stored turned by 180 degrees, else 1 ...
_THETAS, _PHIS, _RINGS, _SECTORS, _PLANES, _TURN = range(6)
# ... and where sections of Tables.data begin.
_THETA, _WIDTH, _TINT, _NODE, _MASS, _MIRROR, _MARGINAL, _DENSITY, _CUMULATIVE, _END = range(6, 16)


class Tables(NamedTuple):
    """All tabulated materials of a scene, as kernels read them."""

    head: np.ndarray  # (materials, 16) int64
    data: np.ndarray  # (n,) float32


class Table(NamedTuple):
    """One material's table, before `join`."""

    head: np.ndarray  # (16,) int64, offsets from the start of data
    data: np.ndarray  # (n,) float32
    diffuse: np.ndarray  # (3,) float64, the Lambertian albedo kd that is split off
    limited: str  # "", or a sentence: by how much and where the albedo was lowered


def join(tables: Sequence[Table]) -> Tables:
    """Return the tables of materials 0, 1, ... in one record; empty arrays for none."""
    if not tables:
        return Tables(np.zeros((0, _END + 1), np.int64), np.zeros(0, np.float32))
    starts = np.cumsum([0] + [len(table.data) for table in tables])
    head = np.array([table.head for table in tables])
    head[:, _THETA:] += starts[:-1, None]
    return Tables(head, np.concatenate([table.data for table in tables]))


@kernel
def _frame(tables, m, ix, iy):
    """Return (a, b, c, d): x' = a x + b y, y' = c x + d y turns i to azimuth 0, or into the first quadrant."""
    if tables.head[m, _PHIS] > 1:
        return math.copysign(1.0, ix), 0.0, 0.0, math.copysign(1.0, iy)
    sine = math.sqrt(ix * ix + iy * iy)
    if sine < 1e-12:
        return 1.0, 0.0, 0.0, 1.0
    return ix / sine, iy / sine, -iy / sine, ix / sine


@kernel
def _row(tables, m, ix, iy, iz):
    """Return the first row of the interpolation and its two weights, of the next theta_i and of the next phi_i."""
    data, start, last = tables.data, tables.head[m, _THETA], tables.head[m, _THETAS] - 1
    theta = min(math.acos(min(1.0, iz)), data[start + last])
    low = interval(data, start, start, 0.0, last + 1, theta)
    t = (theta - data[start + low]) / (data[start + low + 1] - data[start + low])
    phis = tables.head[m, _PHIS]
    if phis == 1:
        return low, t, 0.0
    q = math.atan2(abs(iy), abs(ix)) * (2.0 / math.pi) * (phis - 1)
    cell = min(int(q), phis - 2)
    return low * phis + cell, t, q - cell


@kernel
def _mixed(tables, m, row, t, q, at, row_stride):
    """Return data[at + row * row_stride] interpolated between the 2 or 4 rows of an incidence."""
    data, phis = tables.data, tables.head[m, _PHIS]
    at += row * row_stride
    below = at + phis * row_stride
    if phis == 1:
        return (1.0 - t) * data[at] + t * data[below]
    first = (1.0 - q) * data[at] + q * data[at + row_stride]
    return (1.0 - t) * first + t * ((1.0 - q) * data[below] + q * data[below + row_stride])


@kernel
def _density_at(tables, m, row, t, q, k, y, s, psi, plane):
    """Return D of a plane in ring k at share y, in sector s at share psi."""
    head = tables.head
    planes, sectors = head[m, _PLANES], head[m, _SECTORS] + 1
    stride = (head[m, _RINGS] + 1) * sectors * planes
    at = head[m, _DENSITY] + (k * sectors + s) * planes + plane
    above = at + sectors * planes
    low = (1.0 - psi) * _mixed(tables, m, row, t, q, at, stride)
    low += psi * _mixed(tables, m, row, t, q, at + planes, stride)
    high = (1.0 - psi) * _mixed(tables, m, row, t, q, above, stride)
    high += psi * _mixed(tables, m, row, t, q, above + planes, stride)
    return (1.0 - y) * low + y * high


@kernel
def _mirror(tables, m, row, t, channel):
    """Return the albedo of the mirror in a channel at an incidence."""
    at = tables.head[m, _MIRROR] + 3 * (row // tables.head[m, _PHIS]) + channel
    return (1.0 - t) * tables.data[at] + t * tables.data[at + 3]


@kernel
def _mirror_albedo(tables, m, row, t):
    return max(_mirror(tables, m, row, t, 0), _mirror(tables, m, row, t, 1), _mirror(tables, m, row, t, 2))


@kernel
def _albedos(tables, m, row, t, q):
    """Return the albedo of the lobe and that of the mirror, each the maximum over channels."""
    return _mixed(tables, m, row, t, q, tables.head[m, _MASS], 1), _mirror_albedo(tables, m, row, t)


@kernel
def albedo(tables, m, ix, iy, iz):
    """Return the probability in [0, 1] that light from direction i survives, by lobe or mirror of material m."""
    if iz <= 0.0:
        return 0.0
    row, t, q = _row(tables, m, ix, iy, iz)
    lobe, delta = _albedos(tables, m, row, t, q)
    return min(1.0, lobe + delta)


@kernel
def mirror_share(tables, m, ix, iy, iz):
    """Return the probability, given survival, that light from direction i leaves as from a perfect mirror."""
    if iz <= 0.0:
        return 0.0
    row, t, q = _row(tables, m, ix, iy, iz)
    lobe, delta = _albedos(tables, m, row, t, q)
    return delta / (lobe + delta) if delta > 0.0 else 0.0


@kernel
def _widths(tables, m, row, t):
    """Return the widths (sx, sy) of the lobe at an incidence."""
    at = tables.head[m, _WIDTH] + 2 * (row // tables.head[m, _PHIS])
    data = tables.data
    return (1.0 - t) * data[at] + t * data[at + 2], (1.0 - t) * data[at + 1] + t * data[at + 3]


@kernel
def _horizon2(ex, ey, ix, iy, iz):
    """Return R^2 for slopes (ex, ey) of rho = 1 and i in the frame of the table."""
    e2, b = ex * ex + ey * ey, (ex * ix + ey * iy) / iz
    root = math.sqrt(b * b + e2)
    limit = (root + b) / e2 if b > 0.0 else 1.0 / (root - b)
    return limit * limit


@kernel
def _place(tables, m, row, t, ix, iy, iz, ox, oy, oz):
    """Return y, psi and dw_o / (dy dpsi) of direction o."""
    a, b, c, d = _frame(tables, m, ix, iy)
    sx, sy = _widths(tables, m, row, t)
    turn = tables.head[m, _TURN]
    hx, hy, hz = ix + turn * ox, iy + turn * oy, iz + oz
    x, y = (a * hx + b * hy) / (hz * sx), (c * hx + d * hy) / (hz * sy)
    rho2 = x * x + y * y
    rho = math.sqrt(rho2)
    cos_psi, sin_psi = (x / rho, y / rho) if rho > 0.0 else (1.0, 0.0)
    limit2 = _horizon2(sx * cos_psi, sy * sin_psi, a * ix + b * iy, c * ix + d * iy, iz)
    place = min(1.0, rho2 * limit2 / (max(0.0, limit2 - rho2) + rho2 * limit2)) if rho > 0.0 else 0.0
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    cos_h, across = hz / length, 0.5 * length
    scale = limit2 / (limit2 * (1.0 - place) + place)
    psi = math.atan2(sin_psi, cos_psi)
    if tables.head[m, _PHIS] == 1:
        psi = abs(psi)
    elif psi < 0.0:
        psi += 2.0 * math.pi
    return place, psi, 2.0 * across * cos_h * cos_h * cos_h * sx * sy * scale * scale


@kernel
def _cell(tables, m, y, psi):
    """Return ring and share, sector and share of (y, psi)."""
    head, data = tables.head, tables.data
    start = head[m, _NODE]
    low = interval(data, start, start, 0.0, head[m, _RINGS] + 1, y)
    share = (y - data[start + low]) / (data[start + low + 1] - data[start + low])
    sectors = head[m, _SECTORS]
    x = psi * sectors / (math.pi if head[m, _PHIS] == 1 else 2.0 * math.pi)
    sector = min(int(x), sectors - 1)
    return low, share, sector, min(1.0, x - sector)


@kernel
def value(tables, m, ix, iy, iz, ox, oy, oz):
    """Return f [1/sr] of material m for directions i, o as (r, g, b), without the mirror."""
    if iz <= 0.0 or oz <= 0.0:
        return 0.0, 0.0, 0.0
    row, t, q = _row(tables, m, ix, iy, iz)
    y, psi, jacobian = _place(tables, m, row, t, ix, iy, iz, ox, oy, oz)
    k, fy, s, fp = _cell(tables, m, y, psi)
    factor = 1.0 / (jacobian * oz)
    if tables.head[m, _PLANES] == 1:
        f, at = factor * _density_at(tables, m, row, t, q, k, fy, s, fp, 0), tables.head[m, _TINT]
        return f * tables.data[at], f * tables.data[at + 1], f * tables.data[at + 2]
    return (
        factor * _density_at(tables, m, row, t, q, k, fy, s, fp, 1),
        factor * _density_at(tables, m, row, t, q, k, fy, s, fp, 2),
        factor * _density_at(tables, m, row, t, q, k, fy, s, fp, 3),
    )


@kernel
def pdf(tables, m, ix, iy, iz, ox, oy, oz):
    """Return the density [1/sr] of sample() without the mirror: it integrates to 1 - mirror_share()."""
    if iz <= 0.0 or oz <= 0.0:
        return 0.0
    row, t, q = _row(tables, m, ix, iy, iz)
    lobe, delta = _albedos(tables, m, row, t, q)
    if lobe + delta <= 0.0:
        return 0.0
    y, psi, jacobian = _place(tables, m, row, t, ix, iy, iz, ox, oy, oz)
    k, fy, s, fp = _cell(tables, m, y, psi)
    return _density_at(tables, m, row, t, q, k, fy, s, fp, 0) / (jacobian * (lobe + delta))


@kernel
def _linear(x, low, high):
    """Return the share in [0, 1] up to which a line from low to high has the area x."""
    root = math.sqrt(max(0.0, low * low + 2.0 * x * (high - low)))
    return min(1.0, 2.0 * x / (low + root)) if low + root > 0.0 else 0.0


@kernel
def sample(tables, m, ix, iy, iz, u, v, w):
    """Return a direction (ox, oy, oz) for light from i, and (r, g, b) = f cos / (pdf albedo), each in [0, 1].

    u, v, w are in [0, 1): y, psi, and the choice between mirror and rows. (r, g, b) = 0: the light is absorbed.
    """
    if iz <= 0.0:
        return 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    head, data = tables.head, tables.data
    row, t, q = _row(tables, m, ix, iy, iz)
    lobe, delta = _albedos(tables, m, row, t, q)
    if lobe + delta <= 0.0:
        return 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    w *= lobe + delta
    if w >= lobe:
        r, g, b = _mirror(tables, m, row, t, 0), _mirror(tables, m, row, t, 1), _mirror(tables, m, row, t, 2)
        return -ix, -iy, iz, r / delta, g / delta, b / delta

    # One of 2 or 4 rows, by weight and mass.
    phis, mass = head[m, _PHIS], head[m, _MASS] + row
    chosen = row
    if phis == 1:
        if w >= (1.0 - t) * data[mass]:
            chosen += 1
    else:
        first = (1.0 - t) * (1.0 - q) * data[mass]
        second = first + (1.0 - t) * q * data[mass + 1]
        third = second + t * (1.0 - q) * data[mass + phis]
        if w >= third:
            chosen += phis + 1
        elif w >= second:
            chosen += phis
        elif w >= first:
            chosen += 1

    # y by u: the marginal density is linear in each ring.
    rings, sectors = head[m, _RINGS], head[m, _SECTORS]
    start = head[m, _MARGINAL] + chosen * (rings + 1)
    x = u * data[start + rings]
    k = interval(data, start, start, 0.0, rings + 1, x)
    lower = head[m, _CUMULATIVE] + (chosen * (rings + 1) + k) * (sectors + 1)
    upper = lower + sectors + 1
    node = head[m, _NODE] + k
    width = data[node + 1] - data[node]
    fy = _linear((x - data[start + k]) / width, float(data[lower + sectors]), float(data[upper + sectors]))
    y = data[node] + fy * width

    # psi by v: given y, the density is linear in each sector.
    side, span = 1.0, 2.0 * math.pi
    if phis == 1:
        span = math.pi
        v *= 2.0
        if v >= 1.0:
            v -= 1.0
            side = -1.0
    x = v * ((1.0 - fy) * data[lower + sectors] + fy * data[upper + sectors])
    s = interval(data, lower, upper, fy, sectors + 1, x)
    x -= (1.0 - fy) * data[lower + s] + fy * data[upper + s]
    stride = head[m, _PLANES]
    at = head[m, _DENSITY] + ((chosen * (rings + 1) + k) * (sectors + 1) + s) * stride
    next_ring = at + (sectors + 1) * stride
    fp = _linear(
        x * sectors / (2.0 * math.pi),
        (1.0 - fy) * data[at] + fy * data[next_ring],
        (1.0 - fy) * data[at + stride] + fy * data[next_ring + stride],
    )
    psi = side * (s + fp) * span / sectors

    a, b, c, d = _frame(tables, m, ix, iy)
    jx, jy = a * ix + b * iy, c * ix + d * iy
    sx, sy = _widths(tables, m, row, t)
    ex, ey = sx * math.cos(psi), sy * math.sin(psi)
    limit2 = _horizon2(ex, ey, jx, jy, iz)
    rho = math.sqrt(y * limit2 / (limit2 * (1.0 - y) + y))
    hx, hy = rho * ex, rho * ey
    twice = 2.0 * (hx * jx + hy * jy + iz) / (1.0 + hx * hx + hy * hy)
    turn = head[m, _TURN]
    x, z = turn * (twice * hx - jx), turn * (twice * hy - jy)
    ox, oy, oz = a * x + c * z, b * x + d * z, twice - iz
    if stride == 1:
        tint = head[m, _TINT]
        return ox, oy, oz, float(data[tint]), float(data[tint + 1]), float(data[tint + 2])
    largest = _density_at(tables, m, row, t, q, k, fy, s, fp, 0)
    if largest <= 0.0:
        return ox, oy, oz, 0.0, 0.0, 0.0
    return (
        ox,
        oy,
        oz,
        min(1.0, _density_at(tables, m, row, t, q, k, fy, s, fp, 1) / largest),
        min(1.0, _density_at(tables, m, row, t, q, k, fy, s, fp, 2) / largest),
        min(1.0, _density_at(tables, m, row, t, q, k, fy, s, fp, 3) / largest),
    )

"""Any reflection model as a table that is sampled, evaluated and integrated without error of its own.

The table is the surface that a scene uses: `sample`, `value`, `pdf` and `albedo` belong to one f, which differs from
the model by the interpolation alone (docs/decisions/025-tables-of-brdfs.md).

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
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.bsdf.models import MODELS, Lobe

TOLERANCE = 0.005  # of an albedo, from interpolation: so much above 1 is scaled without a word
CHECKED = math.radians(89.0)  # incidence beyond it is scaled without a word: models diverge there

# Columns of Tables.head: numbers of rows theta_i, of rows phi_i, of cells of y, of cells of psi, of stored channels; -1
# if o is stored turned by 180 degrees, else 1 ...
_THETAS, _PHIS, _RINGS, _SECTORS, _PLANES, _TURN = range(6)
# ... and where sections of Tables.data begin.
_THETA, _WIDTH, _TINT, _NODE, _MASS, _MIRROR, _MARGINAL, _DENSITY, _CUMULATIVE, _END = range(6, 16)


class Resolution(NamedTuple):
    """Numbers of rows over theta_i and phi_i, and of cells over y and psi."""

    thetas: int
    phis: int
    rings: int
    sectors: int


ISOTROPIC = Resolution(40, 1, 64, 32)
ANISOTROPIC = Resolution(32, 9, 48, 48)


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


@lru_cache(maxsize=32)
def tabulate(lobes: tuple[Lobe, ...], scale: bool = False, resolution: Resolution | None = None) -> Table:
    """Return the table of a linear combination of lobes.

    ValueError, one sentence, if the surface would reflect more light than arrives; with `scale` it is darkened to 1 at
    those angles instead, and the table says by how much.
    """
    anisotropic = not _isotropic(lobes)
    size = resolution or (ANISOTROPIC if anisotropic else ISOTROPIC)
    kd = sum((lobe.factor * MODELS[lobe.model].diffuse(lobe.values()) for lobe in lobes), np.zeros(3))
    if kd.max() > 1.0:
        raise ValueError(f"{_names(lobes)} has a diffuse albedo of {kd.max():.3g}, and must have at most 1")
    theta = _thetas(size.thetas)
    phi = np.linspace(0.0, 0.5 * math.pi, size.phis) if anisotropic else np.zeros(1)
    full = 2.0 * math.pi if anisotropic else math.pi
    psi = np.linspace(0.0, full, size.sectors + 1)
    turn = _turn(lobes)
    width = _widths_of_rows(lobes, theta, anisotropic, turn).astype(np.float32).astype(float)
    node = _nodes(lobes, size.rings, theta, width, full, turn).astype(np.float32).astype(float)

    rows = [_density(lobes, t, p, node, psi, s, turn) for t, s in zip(theta, width, strict=True) for p in phi]
    channels = np.array(rows)  # (rows, rings + 1, sectors + 1, 3)
    density = channels.max(axis=3)
    step = psi[1] - psi[0]
    copies = 1.0 if anisotropic else 2.0  # of the stored range of psi in the circle
    along = copies * step * 0.5 * (density[:, :, 1:] + density[:, :, :-1])
    cumulative = np.concatenate((np.zeros((*density.shape[:2], 1)), np.cumsum(along, axis=2)), axis=2)
    rings = np.diff(node) * 0.5 * (cumulative[:, 1:, -1] + cumulative[:, :-1, -1])
    marginal = np.concatenate((np.zeros((len(rows), 1)), np.cumsum(rings, axis=1)), axis=1)
    cosine = np.cos(theta)
    delta = sum((k.factor * MODELS[k.model].mirror(k.values(), cosine) for k in lobes), np.zeros((len(theta), 3)))

    room = 1.0 - kd.max()
    total = marginal[:, -1] + np.repeat(delta.max(axis=1), len(phi))
    excess = total > room
    limited = _limited(lobes, theta, total.reshape(len(theta), len(phi)).max(axis=1), room) if excess.any() else ""
    if limited and not scale:
        raise ValueError(f"{limited}; lower its parameters, or set scale = true to darken it there")
    factor = np.where(excess, room / np.maximum(total, 1e-300), 1.0)
    channels *= factor[:, None, None, None]
    density *= factor[:, None, None]
    cumulative *= factor[:, None, None]
    marginal *= factor[:, None]
    delta *= factor.reshape(len(theta), len(phi)).min(axis=1)[:, None]

    tint, planes = _tint(channels, density)
    stored = density[..., None] if planes == 1 else np.concatenate((density[..., None], channels), axis=3)
    sections = (theta, width, tint, node, marginal[:, -1], delta, marginal, stored, cumulative)
    parts = [np.asarray(section, np.float32).ravel() for section in sections]
    starts = np.cumsum([0] + [len(part) for part in parts])
    head = np.array([len(theta), len(phi), size.rings, size.sectors, planes, turn, *starts], np.int64)
    return Table(head, np.concatenate(parts), kd, limited if scale else "")


def _names(lobes: Sequence[Lobe]) -> str:
    return " + ".join(lobe.model for lobe in lobes)


def _limited(lobes: Sequence[Lobe], theta: np.ndarray, total: np.ndarray, room: float) -> str:
    """Return a sentence where the albedo exceeds the room beside kd by more than the tolerance, else ""."""
    angles = np.append(theta[theta < CHECKED], CHECKED)
    albedos = np.interp(angles, theta, total)
    over = albedos > room + TOLERANCE
    if not over.any():
        return ""
    first, last, worst = np.degrees((angles[over][0], angles[over][-1], angles[np.argmax(albedos)]))
    return (
        f"{_names(lobes)} reflects more light than arrives, at {first:.0f} to {last:.0f} degrees of incidence"
        f" ({100.0 * (albedos.max() + 1.0 - room):.4g} % at {worst:.0f} degrees)"
    )


def _thetas(count: int) -> np.ndarray:
    """Return rows of theta_i from 0 to 89.95 degrees, denser at grazing incidence; multiples of float32."""
    x = np.linspace(0.0, 1.0, count)
    theta = 0.5 * math.pi * (1.0 - (1.0 - x) ** 1.75)
    theta[-1] = math.radians(89.95)
    return theta.astype(np.float32).astype(float)


def _directions(theta: float, phi: float, y: np.ndarray, psi: np.ndarray, width: np.ndarray):
    """Return i (3,), o (rings, sectors, 3) and dw_o / (dy dpsi) for nodes y and psi."""
    i = np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])
    ex, ey = width[0] * np.cos(psi), width[1] * np.sin(psi)
    e2, b = ex * ex + ey * ey, (ex * i[0] + ey * i[1]) / i[2]
    limit2 = ((np.sqrt(b * b + e2) + b) / e2) ** 2
    scale = limit2 * (1.0 - y[:, None]) + y[:, None]
    rho = np.sqrt(y[:, None] * limit2 / scale)
    x, z = rho * ex, rho * ey
    cos_h = 1.0 / np.sqrt(1.0 + x * x + z * z)
    h = np.stack((x * cos_h, z * cos_h, cos_h), axis=2)
    across = h @ i
    jacobian = 2.0 * across * cos_h**3 * width[0] * width[1] * (limit2 / scale) ** 2
    return i, 2.0 * across[:, :, None] * h - i, jacobian


def _evaluate(lobes, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f (n, 3) of a linear combination for directions (n, 3)."""
    return sum((k.factor * MODELS[k.model].evaluate(k.values(), i, o) for k in lobes), np.zeros_like(o))


def _density(lobes, theta: float, phi: float, y: np.ndarray, psi: np.ndarray, width: np.ndarray, turn: int):
    """Return f cos(theta_o) dw_o / (dy dpsi) per channel at nodes y and psi, (rings, sectors, 3)."""
    i, o, jacobian = _directions(theta, phi, y, psi, width)
    flat = (o * (turn, turn, 1)).reshape(-1, 3)
    f = _evaluate(lobes, np.broadcast_to(i, flat.shape), flat)
    result = f.reshape(o.shape) * (np.maximum(0.0, o[:, :, 2]) * jacobian)[:, :, None]
    result[y >= 1.0] = 0.0  # the horizon
    return result


def _cap(count: int) -> np.ndarray:
    """Return directions (count, 3) spread over the upper hemisphere, with density cos / pi."""
    n = np.arange(count) + 0.5
    r2, phi = n / count, n * (math.pi * (3.0 - math.sqrt(5.0)))
    return np.stack((np.sqrt(r2) * np.cos(phi), np.sqrt(r2) * np.sin(phi), np.sqrt(1.0 - r2)), axis=1)


def _isotropic(lobes) -> bool:
    """Return whether f is the same after a rotation of both directions about the normal."""
    if not any(MODELS[lobe.model].ANISOTROPIC for lobe in lobes):
        return True
    o = _cap(512)
    i = np.broadcast_to((0.6, 0.0, 0.8), o.shape)
    c, s = math.cos(1.1), math.sin(1.1)
    turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    f = _evaluate(lobes, i, o)
    return bool(np.abs(_evaluate(lobes, i @ turned, o @ turned) - f).max() <= 1e-6 * f.max())


def _turn(lobes) -> int:
    """Return -1 if light from 60 degrees mostly returns to its own side, else 1."""
    o = _cap(4096)
    sine, cosine = math.sin(math.pi / 3.0), 0.5
    f = sum(
        (_evaluate(lobes, np.broadcast_to(i, o.shape), o).max(axis=1) * (o @ (i * (1.0, 1.0, 0.0)))).sum()
        for i in (np.array([sine, 0.0, cosine]), np.array([0.0, sine, cosine]))
    )
    return -1 if f > 0 else 1


def _nodes(lobes, rings: int, theta: np.ndarray, width: np.ndarray, full: float, turn: int) -> np.ndarray:
    """Return rings + 1 nodes of y from 0 to 1, dense where the lobe's mean over incidence bends."""
    y = np.concatenate(([0.0], np.geomspace(1e-8, 0.05, 150), np.linspace(0.05, 1.0, 120)[1:]))
    psi = np.linspace(0.0, full, 9 if full < 4.0 else 17)
    bend = np.zeros(len(y) - 1)
    for row in range(0, len(theta), max(1, len(theta) // 8)):
        for phi in (0.0, 0.8, 1.57) if full > 4.0 else (0.0,):
            d = _density(lobes, theta[row], phi, y, psi, width[row], turn).max(axis=2)
            largest = d.max()
            if largest > 0.0:
                slope = np.diff(d, axis=0) / np.diff(y)[:, None] / largest
                second = np.abs(np.diff(slope, axis=0)) / (0.5 * (y[2:] - y[:-2]))[:, None]
                second = np.cbrt(np.concatenate((second[:1], second)).mean(axis=1))
                bend += second / max((second * np.diff(y)).sum(), 1e-300)
    share = bend * np.diff(y)
    share = share / share.sum() if share.sum() > 0 else np.diff(y)
    wanted = np.concatenate(([0.0], np.cumsum(0.75 * share + 0.25 * np.diff(y))))
    return np.interp(np.linspace(0.0, wanted[-1], rings + 1), wanted, y)


def _widths_of_rows(lobes, theta: np.ndarray, anisotropic: bool, turn: int) -> np.ndarray:
    """Return widths (sx, sy) of all rows, (n, 2): along and across i, or along x and y where f is anisotropic."""
    if anisotropic:
        return np.tile(_width(lobes, 0.0, turn), (len(theta), 1))
    few = np.linspace(0, len(theta) - 1, 14).astype(int)
    ratio = np.log([_width(lobes, theta[row], turn)[0] for row in few])
    sx = np.exp(np.interp(np.arange(len(theta)), few, ratio))
    return np.stack((sx, 1.0 / sx), axis=1)


def _width(lobes, theta: float, turn: int) -> np.ndarray:
    """Return widths (sx, sy) of product 1, by which the lobe's slopes along and across i are about alike."""
    y = np.geomspace(1e-7, 0.999, 64)
    psi = (np.arange(32) + 0.5) / 32 * math.pi
    width = np.ones(2)
    for _ in range(2):
        _, o, _ = _directions(theta, 0.0, y, psi, width)
        i = np.array([math.sin(theta), 0.0, math.cos(theta)])
        weight = _density(lobes, theta, 0.0, y, psi, width, turn).max(axis=2) * np.gradient(y)[:, None]
        if not 0.0 < weight.sum() < math.inf:
            return np.ones(2)
        h = o + i
        slopes = np.abs(h[:, :, :2]) / h[:, :, 2:]
        mean = (np.log(np.maximum(slopes, 1e-9)) * weight[:, :, None]).sum(axis=(0, 1)) / weight.sum()
        width = np.exp(0.5 * (mean - mean[::-1]))
    return np.clip(width, 0.1, 10.0)


def _tint(channels: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the colour (3,) of the lobe and the planes to store: 1 if the colour is the same everywhere, else 4."""
    sums = channels.sum(axis=(0, 1, 2))
    tint = sums / sums.max() if sums.max() > 0 else np.zeros(3)
    same = np.abs(channels - density[..., None] * tint).max() <= 1e-6 * density.max(initial=0.0)
    return (tint, 1) if same else (np.ones(3), 4)


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
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) >> 1
        if data[start + middle] <= theta:
            low = middle
        else:
            high = middle
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
    low, high = 0, head[m, _RINGS]
    while high - low > 1:
        middle = (low + high) >> 1
        if data[start + middle] <= y:
            low = middle
        else:
            high = middle
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
    k, high = 0, rings
    while high - k > 1:
        middle = (k + high) >> 1
        if data[start + middle] <= x:
            k = middle
        else:
            high = middle
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
    s, high = 0, sectors
    while high - s > 1:
        middle = (s + high) >> 1
        if (1.0 - fy) * data[lower + middle] + fy * data[upper + middle] <= x:
            s = middle
        else:
            high = middle
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

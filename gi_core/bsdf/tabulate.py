"""Any reflection model, or a linear combination of them, as a table; `table.py` describes its layout."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gi_core.bsdf.models import MODELS, Lobe
from gi_core.bsdf.table import Table

CHECKED = math.radians(89.0)  # incidence beyond it is scaled without a word: models diverge there


class Resolution(NamedTuple):
    """Numbers of rows over theta_i and phi_i, and of cells over y and psi."""

    thetas: int
    phis: int
    rings: int
    sectors: int


ISOTROPIC = Resolution(40, 1, 64, 32)
ANISOTROPIC = Resolution(32, 9, 48, 48)


@lru_cache(maxsize=32)
def tabulate(lobes: tuple[Lobe, ...], scale: bool = False) -> Table:
    """Return the table of a linear combination of lobes.

    ValueError, one sentence, if the surface would reflect more light than arrives; with `scale` it is darkened to 1 at
    those angles instead, and the table says by how much.
    """
    anisotropic = not _isotropic(lobes)
    size = ANISOTROPIC if anisotropic else ISOTROPIC
    kd = sum((lobe.factor * MODELS[lobe.model].diffuse(lobe.values()) for lobe in lobes), np.zeros(3))
    if kd.max() > 1.0:
        rule = "and must have at most 1; lower its colours or factors"
        raise ValueError(f"{_names(lobes)} has a diffuse albedo of {kd.max():.3g}, {rule}")
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
    over = albedos > room + 0.005  # interpolation errs by 0.005 of an albedo: so much above 1 is scaled without a word
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

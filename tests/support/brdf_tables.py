"""Batches of the kernels of `gi_core.bsdf.table`, and quadrature over directions, for tests and studies."""

import math

import numpy as np

from gi_core.base.jit import allocating
from gi_core.bsdf import table
from gi_core.bsdf.models import MODELS


@allocating
def draws(tables, m, i, numbers):
    """Return `table.sample` for numbers (n, 3): directions and factors, (n, 6)."""
    result = np.empty((len(numbers), 6))
    for n in range(len(numbers)):
        result[n] = table.sample(tables, m, i[0], i[1], i[2], numbers[n, 0], numbers[n, 1], numbers[n, 2])
    return result


@allocating
def values(tables, m, i, o):
    """Return `table.value` for one i (3,) and directions o (n, 3), (n, 3)."""
    result = np.empty((len(o), 3))
    for n in range(len(o)):
        result[n] = table.value(tables, m, i[0], i[1], i[2], o[n, 0], o[n, 1], o[n, 2])
    return result


@allocating
def densities(tables, m, i, o):
    """Return `table.pdf` for one i (3,) and directions o (n, 3), (n,)."""
    result = np.empty(len(o))
    for n in range(len(o)):
        result[n] = table.pdf(tables, m, i[0], i[1], i[2], o[n, 0], o[n, 1], o[n, 2])
    return result


def direction(theta: float, phi: float = 0.0) -> np.ndarray:
    """Return the unit vector (3,) at polar angle theta and azimuth phi [degrees]."""
    t, p = math.radians(theta), math.radians(phi)
    return np.array([math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t)])


def nodes(i: np.ndarray, rings: int = 160, sectors: int = 128) -> tuple[np.ndarray, np.ndarray]:
    """Return directions o (n, 3) and weights cos(theta_o) dw (n,) of a quadrature over the hemisphere.

    Written independently of `table`: Gauss-Legendre in the fourth root of y, so lobes of slope 0.01 are resolved.
    """
    x, w = np.polynomial.legendre.leggauss(rings)
    root = 0.5 * (x + 1.0)
    y, dy = root**4, 2.0 * root**3 * w
    psi = (np.arange(sectors) + 0.5) * (2.0 * math.pi / sectors)
    b = (np.cos(psi) * i[0] + np.sin(psi) * i[1]) / i[2]
    limit2 = (b + np.sqrt(b * b + 1.0)) ** 2
    scale = limit2 * (1.0 - y[:, None]) + y[:, None]
    slope = np.sqrt(y[:, None] * limit2 / scale)
    cos_h = 1.0 / np.sqrt(1.0 + slope * slope)
    h = np.stack((slope * np.cos(psi) * cos_h, slope * np.sin(psi) * cos_h, cos_h), axis=2)
    across = h @ i
    o = 2.0 * across[:, :, None] * h - i
    solid = 2.0 * across * cos_h**3 * (limit2 / scale) ** 2 * dy[:, None] * (2.0 * math.pi / sectors)
    return o.reshape(-1, 3), (np.maximum(0.0, o[:, :, 2]) * solid).ravel()


def exact(lobes, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f (n, 3) of a linear combination from its formulas, without diffuse part and mirror."""
    lit = np.broadcast_to(i, o.shape)
    return sum(k.factor * MODELS[k.model].evaluate(k.values(), lit, o) for k in lobes)

"""Poulin-Fournier: Blinn's lobe on small parallel cylinders, as brushed metal and satin have them.

Cylinders of radius 1 lie along the tangent, d apart, and rise h above a flat floor.
f = ks / (d cos i cos o) integral over the lit and seen arc and floor of blinn(n, m.half) (m.i) (m.o) ds, m its normal.
Each cylinder hides light from its neighbours. In the plane across the cylinders the lit and seen part of a convex arc
is one interval, so the integral is taken over it by 16 Gauss-Legendre points.

Parameters: kd, ks in [0, 1]; spacing d in [0.1, 20]; height h in [0.01, 1]; exponent n in [1, 10000]. Cylinders that
would overlap are cut at the floor's height, where neighbours meet.
Flaws: no light between cylinders, so albedo is lost in deep grooves. The paper's cylinders may be hollow and its floor
may have another exponent. Its Chebyshev polynomials approximate the same integral.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.blinn import lobe as blinn
from gi_core.bsdf.models.common import (
    KD,
    KS,
    Parameter,
    Values,
    above,
    coloured,
    cosines,
    diffuse_kd,
    half_vector,
    no_mirror,
)

SOURCE = "Poulin, Fournier, A model for anisotropic reflection, SIGGRAPH 90"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, True, "kd + ks <= 1"
PARAMETERS = {
    "kd": KD,
    "ks": KS,
    "d": Parameter(1.5, 0.1, 20.0, False, "distance between cylinders [radii]"),
    "h": Parameter(0.2, 0.01, 1.0, False, "height of cylinders above the floor [radii]"),
    "n": Parameter(200.0, 1.0, 10000.0, False, "exponent of Blinn's lobe"),
}
diffuse, mirror = diffuse_kd, no_mirror
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def _profile(p: Values) -> tuple[float, float]:
    """Return the half width of the arc in angle, at most asin(d / 2), and the width of the floor."""
    widest = math.acos(1.0 - p["h"])
    if 2.0 * math.sin(widest) >= p["d"]:
        return math.asin(min(1.0, 0.5 * p["d"])), 0.0
    return widest, p["d"] - 2.0 * math.sin(widest)


def _open_arc(w: np.ndarray, half: float, d: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends (n,) of the arc's angles that see directions w; of y / z plane, angles from z towards y."""
    angle = np.arctan2(np.abs(w[:, 1]), w[:, 2])
    edge = angle - 0.5 * math.pi  # of the arc itself; its normal is across w
    support = np.where(-edge <= half, 1.0, np.cos(half + edge))  # of the neighbour, across w
    shade = np.arccos(np.clip(support - d * np.cos(angle), -1.0, 1.0))
    low, high = np.maximum(-half, edge), np.minimum(half, edge + shade)
    flip = w[:, 1] < 0
    return np.where(flip, -high, low), np.where(flip, -low, high)


def _open_floor(w: np.ndarray, half: float, d: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends (n,) of the floor that sees directions w; y from the left cylinder's centre."""
    angle = np.arctan2(np.abs(w[:, 1]), w[:, 2])
    edge = angle - 0.5 * math.pi
    support = np.where(-edge <= half, 1.0, np.cos(half + edge))
    # A floor point (y, cos half) sees w if it lies above the neighbour's tangent: -cos(angle) y + sin(angle) z.
    reach = d + (math.cos(half) * np.sin(angle) - support) / np.maximum(np.cos(angle), 1e-12)
    low, high = np.full(len(w), math.sin(half)), np.minimum(reach, d - math.sin(half))
    flip = w[:, 1] < 0
    return np.where(flip, d - high, low), np.where(flip, d - low, high)


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    valid = above(i, o)
    result = np.zeros((len(i), 3))
    i, o = i[valid], o[valid]
    ci, co = cosines(i, o)
    h = half_vector(i, o)
    n, d = p["n"], p["d"]
    half, floor = _profile(p)
    towards = np.arctan2(h[:, 1], h[:, 2])
    width = math.acos(1e-8 ** (1.0 / n)) if n > 4.0 else math.pi  # cos^n is below 1e-8 beyond
    ends = [_open_arc(w, half, d) for w in (i, o)]
    low = np.maximum(np.maximum(ends[0][0], ends[1][0]), towards - width)
    high = np.minimum(np.minimum(ends[0][1], ends[1][1]), towards + width)
    middle, reach = 0.5 * (low + high), 0.5 * np.maximum(0.0, high - low)
    total = np.zeros(len(i))
    for point, weight in zip(_POINTS, _WEIGHTS, strict=True):
        angle = middle + reach * point
        sine, cosine = np.sin(angle), np.cos(angle)
        lit = np.maximum(0.0, sine * i[:, 1] + cosine * i[:, 2]) * np.maximum(0.0, sine * o[:, 1] + cosine * o[:, 2])
        total += weight * reach * lit * np.maximum(0.0, sine * h[:, 1] + cosine * h[:, 2]) ** n
    total *= blinn(n, np.ones(1))
    if floor > 0.0:
        left, right = (_open_floor(w, half, d) for w in (i, o))
        open_width = np.maximum(0.0, np.minimum(left[1], right[1]) - np.maximum(left[0], right[0]))
        total += blinn(n, h[:, 2]) * ci * co * open_width
    result[valid] = coloured(p["ks"], total / (d * ci * co), i, o)
    return result

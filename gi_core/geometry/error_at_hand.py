"""Noise and bias of a picture that has just been computed, and the error of each of its receivers.

`error.error_parts` wants the estimator's limit at very many photons. Beside a running solver there is none; what is
there is the same picture from fewer of its photons, and the difference of the two says how much the photons scatter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from gi_core.geometry.error import luminance

DARK = 0.02  # of the mean: an error is told relative to no less light than that
LEAST_RATIO = 1.5  # of all photons to a prefix: the closer they are, the less their difference says


def prefix_to_compare(prefixes: Iterable[int]) -> int | None:
    """Return the prefix whose difference from all photons says most about noise, None if there is none."""
    prefixes = sorted(prefixes)
    return max((n for n in prefixes[:-1] if 0 < LEAST_RATIO * n <= prefixes[-1]), default=None)


def noise_from_prefix(
    E: np.ndarray, fewer: np.ndarray, photons: int, prefix: int, weights: np.ndarray, other: np.ndarray | float = 0.0
) -> float:
    """Return the relative l1 noise of irradiance E (n, 3) of `photons`, judged by that of its first `prefix`, (n, 3).

    With variance v / N for N photons and a mean of the prefix's own, the difference of the two has variance
    v (1 / prefix - 1 / photons): photons / prefix - 1 times that of E. A lattice scatters less than that law says
    as photons grow, so this rather overstates; and what depends on the number of photons beyond noise (the search
    radius of a nearest-neighbour estimator) counts as noise here. `other`: standard error of the luminance (n,)
    [W/m2] by what both have in common and is not photons. Raises ValueError unless 0 < prefix < photons.
    """
    if not 0 < prefix < photons:
        raise ValueError(f"prefix must be in 1 .. {photons - 1}, got {prefix}")
    off = np.abs(luminance(fewer) - luminance(E)) / math.sqrt(photons / prefix - 1)
    light = float((weights * luminance(E)).sum())
    # A normal deviate has mean magnitude sqrt(2 / pi).
    return float((weights * np.sqrt(off * off + 2 / math.pi * np.square(other))).sum()) / light if light else math.nan


def bias_left(total: float, *noises: float) -> float:
    """Return what of a relative l1 error is left when independent noises are taken out: squares subtract.

    Exact for the root mean square of errors that are normal and alike everywhere, an estimate otherwise; 0 where
    the total is no larger than its noises; nan where any is.
    """
    left = total * total - sum(n * n for n in noises)
    return left if math.isnan(left) else math.sqrt(max(left, 0.0))


def signed_error(E: np.ndarray, T: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the error of each receiver's luminance relative to the truth's, (n,): 0.1 is 10 % too bright.

    Where T is nearly black the error is told relative to DARK of the mean of T: a candle's worth of error in a dark
    corner is no catastrophe. nan where T is nan (not known); 0 everywhere if T is black.
    """
    e, t = luminance(E), luminance(T)
    w = np.where(np.isnan(t), 0.0, weights)
    mean = float((w * np.nan_to_num(t)).sum() / w.sum()) if w.sum() > 0 else 0.0
    if mean <= 0:
        return np.where(np.isnan(t), np.nan, 0.0)
    return (e - t) / np.maximum(t, DARK * mean)


def round_scale(values: np.ndarray, weights: np.ndarray, share: float = 0.95) -> float:
    """Return a round number (1, 2 or 5 times a power of ten) that `share` of the weight of |values| stays within.

    For the end of a scale: nan values do not count; 1 if there is nothing to go by.
    """
    magnitude = np.abs(values)
    known = np.isfinite(magnitude) & (weights > 0)
    if not known.any() or not magnitude[known].any():
        return 1.0
    order = np.argsort(magnitude[known])
    sorted_weights = np.cumsum(np.asarray(weights, np.float64)[known][order])
    at = float(magnitude[known][order][np.searchsorted(sorted_weights, share * sorted_weights[-1])])
    if at <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(at))
    return next(step * power for step in (1, 2, 5, 10) if at <= step * power * (1 + 1e-9))


def some_receivers(weights: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return the rows of at most `count` receivers that have an area, ascending: all or a random choice."""
    rows = np.flatnonzero(np.asarray(weights) > 0)
    if len(rows) <= count:
        return rows
    return np.sort(np.random.default_rng(seed).choice(rows, count, replace=False))

"""Measures of error, defined once: every number that the project quotes comes from here.

Truth T is `reference.py` or a closed form at `evaluation_points()`. All measures are of luminance and weigh each
receiver by the area that it stands for. Noise is the error against the estimator's limit at very many photons, bias
that of the limit against T; `noise_from_subset` compares with the first photons of the same solution instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

REC709 = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear RGB
GROUPS = 8  # of receivers whose truth is alike in noise
CLOUD_REACH, PLACES = 0.1, 500  # clouds are looked for within so much of the scene's size around so many places
DARK = 0.02  # of mean irradiance: the least that a signed error is relative to


class Error(NamedTuple):
    """The error of an estimate, relative; 0.05 is 5 %."""

    l1: float  # sum(w |E - T|) / sum(w T): the report's measure, well defined in shadows
    l2: float  # sqrt(sum(w (E - T)^2) / sum(w T^2)): the same with squares, strict on single spots


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Return the luminance (...) of linear RGB (..., 3), in the same unit."""
    return np.asarray(rgb, np.float64) @ REC709


def relative_error(E: np.ndarray, T: np.ndarray, weights: np.ndarray, rows=slice(None)) -> Error:
    """Return the error of irradiance E (n, 3) against T (n, 3) with areas `weights` (n,), over some rows.

    nan where T is black everywhere.
    """
    e, t = luminance(E)[rows], luminance(T)[rows]
    w = np.asarray(weights, np.float64)[rows]
    light, light2 = float((w * t).sum()), float((w * t * t).sum())
    if light <= 0:
        return Error(float("nan"), float("nan"))
    off = np.abs(e - t)
    return Error(float((w * off).sum()) / light, float(np.sqrt((w * off * off).sum() / light2)))


def small_sample_bias(samples):
    """Return the expected standard deviation of n normal numbers over the true one (c4), per sample size n."""
    counts, at = np.unique(samples, return_inverse=True)
    factors = [math.sqrt(2 / (n - 1)) * math.exp(math.lgamma(n / 2) - math.lgamma((n - 1) / 2)) for n in counts]
    return np.array(factors)[at].reshape(np.shape(samples))


def relative_noise(deviation: np.ndarray, E: np.ndarray, weights: np.ndarray, rows=slice(None)) -> float:
    """Return the relative l1 noise of irradiance E (n, 3) whose luminance has this standard error (n,), over some rows.

    A normal deviate has mean magnitude sqrt(2 / pi). Noise of a truth adds as much error at most: smaller differences
    from it have no meaning. weights (n,): areas; nan where E is black everywhere.
    """
    w = np.asarray(weights, np.float64)[rows]
    light = float((w * luminance(E)[rows]).sum())
    return float(math.sqrt(2 / math.pi) * (w * deviation[rows]).sum() / light) if light > 0 else math.nan


def subset_to_compare(subsets: Iterable[int]) -> int | None:
    """Return the largest photon subset of at most half of all photons, which are the last of `subsets`; or None."""
    subsets = sorted(subsets)
    return max((n for n in subsets[:-1] if 0 < 2 * n <= subsets[-1]), default=None)


def noise_from_subset(
    E: np.ndarray, fewer: np.ndarray, photons: int, subset: int, weights: np.ndarray, other: np.ndarray | float = 0.0
) -> float:
    """Return the relative l1 noise of irradiance E (n, 3) of `photons`, from that of its first `subset`, (n, 3).

    N photons have variance v / N. The difference of the two therefore has variance v (1 / subset - 1 / photons): that
    of E times photons / subset - 1. Noise of a Sobol sequence falls faster, so this overestimates.
    Any other effect of the number of photons (the search radius of nearest neighbours) counts as noise here.
    `other`: standard error of the luminance (n,) [W/m2] from sources that both share and that are not photons.
    Raises ValueError unless 0 < subset < photons.
    """
    if not 0 < subset < photons:
        raise ValueError(f"subset must be in 1 .. {photons - 1}, got {subset}")
    off = np.abs(luminance(fewer) - luminance(E)) / math.sqrt(photons / subset - 1)
    light = float((weights * luminance(E)).sum())
    # A normal deviate has mean magnitude sqrt(2 / pi).
    return float((weights * np.sqrt(off * off + 2 / math.pi * np.square(other))).sum()) / light if light else math.nan


def local_deviation(
    E: np.ndarray, T: np.ndarray, receivers: tuple[np.ndarray, ...], reach: float,
    deviation: np.ndarray | float = 0.0,
) -> tuple[float, float]:  # fmt: skip
    """Return the standard deviation of luminance E / T around places, median and 90th percentile: clouds.

    E, T (n, 3); receivers: positions (n, 3) [m], normals (n, 3) and weights (n,). PLACES of them by weight have those
    around them within `reach` [m] and half a radian of normals; those darker than 5 % of the mean do not count. nan
    where nowhere five count. The mean around a place is no error here, nor is the noise of T: deviation (n,) of its
    luminance.
    """
    p, N, weights = receivers[:3]
    e, t, noise = luminance(E), luminance(T), np.broadcast_to(deviation, len(T))
    lit = np.flatnonzero((t > 0.05 * (weights @ t) / weights.sum()) & (weights > 0))
    if not len(lit):
        return math.nan, math.nan
    at, w = np.hstack([p / reach, 2 * N])[lit], weights[lit]
    ratio, squares = e[lit] / t[lit], (noise[lit] / t[lit]) ** 2
    out = []
    for k in np.random.default_rng(0).choice(len(lit), PLACES, p=w / w.sum()):
        near = ((at - at[k]) ** 2).sum(axis=1) <= 1
        if near.sum() >= 5:
            share = w[near] / w[near].sum()
            spread = share @ (ratio[near] - share @ ratio[near]) ** 2 / (1 - share @ share)
            out.append(math.sqrt(max(spread - share @ squares[near], 0.0)))
    return tuple(np.quantile(out, [0.5, 0.9]).tolist()) if out else (math.nan, math.nan)


def error_less_noise(E: np.ndarray, T: np.ndarray, deviation: np.ndarray, weights: np.ndarray) -> float:
    """Return the relative l1 error of irradiance E (n, 3) against noisy T (n, 3) without the noise of T.

    deviation (n,): mean standard error of T's luminance, without bias by few samples; weights (n,): areas. Squares of
    noise are subtracted in GROUPS of like noise. If subtracted from all at once, noise of few receivers would hide
    little of the error of the others, and twice the error would be left. Signs of groups stay, as noise alone has
    either. 0 where T is black.
    """
    truth = luminance(T)
    off, noise = weights * np.abs(luminance(E) - truth), weights * deviation
    groups = np.array_split(np.argsort(deviation), GROUPS)
    squares = np.array([off[g].sum() ** 2 - 2 / math.pi * noise[g].sum() ** 2 for g in groups])
    light = float((weights * truth).sum())
    return max(float((np.sign(squares) * np.sqrt(np.abs(squares))).sum()) / light, 0.0) if light > 0 else 0.0


def bias_left(total: float, *noises: float) -> float:
    """Return a relative l1 error less independent noises: squares subtract.

    Exact for the root mean square of errors that are normal and alike everywhere, an estimate otherwise; 0 where
    the total is no larger than its noises; nan where any is.
    """
    left = total * total - sum(n * n for n in noises)
    return left if math.isnan(left) else math.sqrt(max(left, 0.0))


def signed_error(E: np.ndarray, T: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the error of each receiver's luminance relative to the truth's, (n,): 0.1 is 10 % too bright.

    Where T is nearly black the error is relative to DARK of the mean of T. nan where T is nan (not known); 0
    everywhere if T is black.
    """
    e, t = luminance(E), luminance(T)
    w = np.where(np.isnan(t), 0.0, weights)
    mean = float((w * np.nan_to_num(t)).sum() / w.sum()) if w.sum() > 0 else 0.0
    if mean <= 0:
        return np.where(np.isnan(t), np.nan, 0.0)
    return (e - t) / np.maximum(t, DARK * mean)

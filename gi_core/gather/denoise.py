"""Denoising of gathered light along surfaces, in proportion to its noise.

Each receiver is averaged with its neighbours on the same smooth surface. Weights are Tukey's biweight of the difference
in units of its standard deviation, so noise is averaged and edges of shadows are kept. A second pass uses the noise
that the first leaves; Dammertz et al. 2010 and Schied et al. 2017 filter pixels in this way. Noise falls with more
paths, and smoothing with it, so the limit is unbiased.

Several reaches are tried, including none. Stein's unbiased risk estimate (1981), by the Monte Carlo method of Ramani et
al. 2008, gives the expected squared error of each without the truth. The lowest is taken.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges
from gi_core.geometry.error import luminance
from gi_core.geometry.mesh_neighbours import Neighbours

REACHES = (2.0, 4.0, 8.0)  # standard deviations at which the weight of a difference becomes 0
PASSES = 2
LITTLE = 0.1  # of the noise: perturbation for the risk estimate
CLEAR = 0.7  # of the risk without smoothing; a smaller gain is not trusted, since few receivers make the estimate rough
GRAIN = 4096  # receivers per thread


class Denoised(NamedTuple):
    """Denoised irradiance."""

    irradiance: np.ndarray  # (n, 3) float64 [W/m2], or more channels
    share: float  # of the error (l2, by area) that remains, 0 .. 1


def denoise(
    mean: np.ndarray, standard_error: np.ndarray, weights: np.ndarray, near: Neighbours, seed: int, threads: int,
    per_lamp: np.ndarray | None = None,
) -> Generator[None, None, Denoised]:  # fmt: skip
    """Denoise irradiance `mean` (n, 3) with its standard error (n, 3), in steps; weights (n,) are areas.

    per_lamp: light (n, 3 G) whose sum over lamps is `mean`; the result then is the same average of it. Black receivers
    stay black and have no weight for neighbours. The generator returns the result.
    """
    lit, sigma = (mean > 0).any(axis=1), luminance(standard_error)
    squares = (standard_error**2).sum(axis=1)
    variance = averaged(near, squares, lit, threads)  # a single variance of few rounds is too rough
    chance = np.random.default_rng(seed).standard_normal(len(mean))
    more = mean + LITTLE * chance[:, None] * standard_error
    noise = float((weights * sigma**2).sum())
    best, least, reached = mean, noise, 0.0
    yield
    for reach in REACHES:
        E = _smoothed(mean, variance, reach, near, lit, threads)
        yield
        answer = luminance(_smoothed(more, variance, reach, near, lit, threads) - E) / LITTLE
        moved = luminance(E - mean)
        risk = float((weights * (moved**2 + 2 * sigma * chance * answer)).sum()) - noise
        if risk < min(least, CLEAR * noise):
            best, least, reached = E, risk, reach
        yield
    if per_lamp is not None:
        best = per_lamp
        if reached:
            joined = np.concatenate([mean, per_lamp], axis=1)
            best = _smoothed(joined, variance, reached, near, lit, threads)[:, 3:]
            yield
    return Denoised(best, float(np.sqrt(max(least, 0.0) / noise)) if noise > 0 else 1.0)


def averaged(near: Neighbours, values: np.ndarray, lit: np.ndarray, threads: int) -> np.ndarray:
    """Return the means of values (n,) over each lit (n,) receiver and its lit neighbours; 0 at the others."""
    out = np.zeros_like(values)
    run_ranges(lambda _, a, b: _average(*near, values, lit, a, b, out), len(lit), threads, GRAIN)
    return out


@kernel
def _average(first, of, values, lit, start, stop, out):
    for i in range(start, stop):
        if not lit[i]:
            continue
        total, count = values[i], 1
        for k in range(first[i], first[i + 1]):
            if lit[of[k]]:
                total, count = total + values[of[k]], count + 1
        out[i] = total / count


def _smoothed(E: np.ndarray, variance: np.ndarray, *others) -> np.ndarray:
    out = E.copy()
    smooth(out, variance.copy(), *others)
    return out


def smooth(E: np.ndarray, variance: np.ndarray, reach: float, near: Neighbours, lit: np.ndarray, threads: int) -> None:
    """Average E (n, 3 or more) and its variance (n,) with neighbours, in place; the first three channels decide.

    variance: summed over these channels; reach: standard deviations. Receivers without noise, or not lit (n,) bool,
    stay; those that are not lit have no weight for neighbours.
    """
    rows = np.flatnonzero(lit & (variance > 0))
    out, left = np.empty((len(rows), E.shape[1])), np.empty(len(rows))
    for _ in range(PASSES):
        run_ranges(
            lambda _, a, b: _pass(*near, E, variance, lit, reach * reach, rows, a, b, out, left),
            len(rows), threads, GRAIN,
        )  # fmt: skip
        E[rows], variance[rows] = out, left


@kernel
def _pass(first, of, E, variance, lit, reach, rows, start, stop, out, left):
    for row in range(start, stop):
        i = rows[row]
        total, v = 1.0, variance[i]
        for c in range(E.shape[1]):
            out[row, c] = E[i, c]
        x, y, z = E[i, 0], E[i, 1], E[i, 2]
        for k in range(first[i], first[i + 1]):
            j = of[k]
            dx, dy, dz = E[i, 0] - E[j, 0], E[i, 1] - E[j, 1], E[i, 2] - E[j, 2]
            farthest = reach * (variance[i] + variance[j])
            d = dx * dx + dy * dy + dz * dz
            w = max(1.0 - d / farthest, 0.0) * lit[j]
            w *= w
            total += w
            v += w * w * variance[j]
            x, y, z = x + w * E[j, 0], y + w * E[j, 1], z + w * E[j, 2]
            for c in range(3, E.shape[1]):
                out[row, c] += w * E[j, c]
        out[row, 0], out[row, 1], out[row, 2] = x, y, z
        for c in range(E.shape[1]):
            out[row, c] /= total
        left[row] = v / (total * total)

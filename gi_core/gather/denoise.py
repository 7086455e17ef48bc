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
VARIANCE, NO_WEIGHT = 3, -1.0  # column of smooth(), and its value at receivers that do not count


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


def _smoothed(E: np.ndarray, variance: np.ndarray, reach: float, near: Neighbours, lit: np.ndarray, threads: int):
    light = np.concatenate([E[:, :3], np.where(lit, variance, NO_WEIGHT)[:, None], E[:, 3:]], axis=1)
    smooth(light, reach, near, threads)
    return np.delete(light, VARIANCE, axis=1)


def smooth(light: np.ndarray, reach: float, near: Neighbours, threads: int) -> None:
    """Average light (n, 4 or more) with neighbours, in place.

    Columns: three channels that decide, the sum of their variances, more channels. Receivers of variance 0 stay, as do
    those of NO_WEIGHT, which do not count for neighbours. reach: standard deviations.
    """
    rows = np.flatnonzero(light[:, VARIANCE] > 0)
    out = np.empty((len(rows), light.shape[1]))
    for _ in range(PASSES):
        run_ranges(lambda _, a, b: _pass(*near, light, reach * reach, rows, a, b, out), len(rows), threads, GRAIN)
        light[rows] = out


@kernel
def _pass(first, of, light, reach, rows, start, stop, out):
    for row in range(start, stop):
        i, total = rows[row], 1.0
        x, y, z, v = light[i, 0], light[i, 1], light[i, 2], light[i, 3]
        for c in range(4, light.shape[1]):
            out[row, c] = light[i, c]
        for k in range(first[i], first[i + 1]):
            j = of[k]
            variance = light[j, 3]
            dx, dy, dz = light[i, 0] - light[j, 0], light[i, 1] - light[j, 1], light[i, 2] - light[j, 2]
            w = max(1.0 - (dx * dx + dy * dy + dz * dz) / (reach * (light[i, 3] + abs(variance))), 0.0)
            w = w * w if variance >= 0.0 else 0.0
            total += w
            v += w * w * variance
            x, y, z = x + w * light[j, 0], y + w * light[j, 1], z + w * light[j, 2]
            for c in range(4, light.shape[1]):
                out[row, c] += w * light[j, c]
        out[row, 0], out[row, 1], out[row, 2], out[row, 3] = x / total, y / total, z / total, v / (total * total)
        for c in range(4, light.shape[1]):
            out[row, c] /= total

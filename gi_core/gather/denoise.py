"""Denoising of gathered light along surfaces, in proportion to its noise.

Each receiver is averaged with its neighbours on the same smooth surface. Weights are Tukey's biweight of the difference
in units of its standard deviation, so noise is averaged and edges of shadows are kept. A second pass uses the noise
that the first leaves; Dammertz et al. 2010 and Schied et al. 2017 filter pixels in this way. Noise falls with more
paths, and smoothing with it, so the limit is unbiased.

Several reaches are tried, including none. Stein's unbiased risk estimate (1981), by the Monte Carlo method of Ramani et
al. 2008, gives the expected squared error of each without the truth. Each receiver takes the reach that has the lowest
in its surroundings: noise and detail differ from surface to surface.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.pause import pause
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.geometry.error import luminance
from gi_core.geometry.mesh_neighbours import Neighbours
from gi_core.lights.lamps import sum_of_lamps

LITTLE = 0.1  # of the noise: perturbation for the risk estimate
VARIANCE, NO_WEIGHT = 3, -1.0  # column of smooth(), and its value at receivers that do not count


class Denoised(NamedTuple):
    """Denoised irradiance."""

    irradiance: np.ndarray  # (n, 3) float64 [W/m2], or more channels
    sigma: np.ndarray  # (n,) float64, standard error of the luminance before ...
    left: np.ndarray  # (n,) float64, ... and the share of it that remains, up to 1

    def share(self, weights: np.ndarray) -> float:
        """Return the share of the error (l1, by weights (n,)) that remains, up to 1."""
        noise = float(weights @ self.sigma)
        return float(weights @ (self.left * self.sigma)) / noise if noise > 0 else 1.0


def denoise(
    mean: np.ndarray, standard_error: np.ndarray, near: Neighbours, seed: int, threads: int,
    per_lamp: np.ndarray | None = None, alike: np.ndarray | None = None,
) -> Denoised:  # fmt: skip
    """Denoise irradiance `mean` (n, 3) with its standard error (n, 3).

    alike (n,): areas, to take one reach for all: standard errors of few paths are too rough to choose by place.
    per_lamp: light (n, 3 G) whose sum over lamps is `mean`; the result then is the same average of it. Black receivers
    stay black and have no weight for neighbours.
    """
    lit, sigma = (mean > 0).any(axis=1), luminance(standard_error)
    squares = (standard_error**2).sum(axis=1)
    reaches = 2.0, 4.0, 8.0  # standard deviations, where the weight of a difference is 0
    # A single variance of few rounds is too rough.
    variance = np.where(lit, averaged(near, squares, lit, threads), NO_WEIGHT)
    sign = np.random.default_rng(seed).choice([-1.0, 1.0], len(mean))  # Hutchinson 1990: the least variance
    more = mean + LITTLE * sign[:, None] * standard_error
    saved = np.zeros((len(mean), 1 + len(reaches)))  # squared error less than without smoothing, by reach
    lights = [mean if per_lamp is None else per_lamp]
    pause()

    def at_reach(E: np.ndarray, carried: np.ndarray, reach: float) -> np.ndarray:
        return smoothed(E, carried, variance, reach, near, threads)[:, VARIANCE + 1 :]

    for k, reach in enumerate(reaches, 1):
        lights.append(at_reach(mean, lights[0], reach))
        E = sum_of_lamps(lights[k])
        answer = luminance(at_reach(more, more, reach) - E) / LITTLE
        saved[:, k] = 2 * sigma * (sigma - sign * answer) - luminance(E - mean) ** 2

    def pooled(values: np.ndarray) -> np.ndarray:
        # 40 means over neighbours: one receiver's estimate is as large as the risk itself
        for _ in range(40):
            values = averaged(near, values, lit, threads)
            pause()
        return values

    best = pooled(saved).argmax(axis=1) if alike is None else np.full(len(mean), (alike @ saved).argmax())
    # Relative to the variance there: a few bright receivers would decide for all others.
    around = averaged(near, sigma**2, lit, threads)
    saved = np.take_along_axis(saved, best[:, None], axis=1)[:, 0]
    saved = pooled(np.divide(saved, around, out=np.zeros_like(around), where=around > 0)[:, None])[:, 0]
    # two passes average a receiver with two rings, some 19; a risk may be negative
    left = np.sqrt(np.clip(1 - saved, 1 / 19, 1.0))
    return Denoised(_chosen(lights, best), sigma, left)


def _chosen(lights: list[np.ndarray], best: np.ndarray) -> np.ndarray:
    """Return light (n, c) of each receiver from the one of `lights` that is best (n,) there."""
    out = lights[0].copy()
    for k, light in enumerate(lights[1:], 1):
        out[best == k] = light[best == k]
    return out


def averaged(near: Neighbours, values: np.ndarray, lit: np.ndarray, threads: int) -> np.ndarray:
    """Return the means of values (n, ...) over each lit (n,) receiver and its lit neighbours; 0 at the others."""
    out, columns = np.zeros_like(values), values.reshape(len(lit), math.prod(values.shape[1:]))

    def work(_, first, last):
        _average(near, columns, lit, first, last, out.reshape(columns.shape))

    run_ranges(work, len(lit), threads, COSTLY)
    return out


@kernel
def _average(near, values, lit, start, stop, out):
    for i in range(start, stop):
        if not lit[i]:
            continue
        for c in range(values.shape[1]):
            total, count = values[i, c], 1
            for k in range(near.first[i], near.first[i + 1]):
                j = near.of[k]
                if lit[j]:
                    total, count = total + values[j, c], count + 1
            out[i, c] = total / count


def smoothed(
    decider: np.ndarray, carried: np.ndarray, variance: np.ndarray, reach: float, near: Neighbours, threads: int
) -> np.ndarray:
    """Return light (n, k) of smooth() after two passes: decider, variance and carried, side by side."""
    light = np.concatenate([decider, variance[:, None], carried], axis=1)
    pause()
    smooth(light, reach, near, threads)
    return light


def smoothed_by_subset(
    E: np.ndarray, fewer: np.ndarray, times: float, reach: float, around: Neighbours, counts: np.ndarray,
    weights: np.ndarray, threads: int, per_lamp: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Smooth light E (n, 3) of photons in proportion to its noise.

    fewer (n, 3): that of a subset of its photons, which are `times` as many. Receivers that do not count (n,) stay,
    and have no weight for neighbours. per_lamp (n, k): light that takes the same averages. Returns
    smoothed E, or per_lamp in its place, and the standard error (n,) of the luminance of E. Neighbours share photons,
    so all standard errors are scaled: the subset, averaged alike, measures their mean over weights (n,).
    """
    apart = ((E - fewer) ** 2 / (times - 1)).sum(axis=1)
    variance = np.where(counts, averaged(around, apart, counts, threads), NO_WEIGHT)
    pause()
    carried = fewer if per_lamp is None else np.concatenate([fewer, per_lamp], axis=1)
    light = smoothed(E, carried, variance, reach, around, threads)
    E, left, fewer, smoothed_per_lamp = np.split(light, (VARIANCE, VARIANCE + 1, VARIANCE + 4), axis=1)
    deviation = np.sqrt(np.maximum(left[:, 0], 0.0))
    apart = weights @ np.abs(luminance(E - fewer)) / math.sqrt(times - 1)
    independent = math.sqrt(2 / math.pi) * (weights @ deviation)
    deviation *= apart / independent if independent > 0 else 0.0
    return E if per_lamp is None else smoothed_per_lamp, deviation


def smooth(light: np.ndarray, reach: float, near: Neighbours, threads: int, responds: bool = False) -> None:
    """Average light (n, 4 or more) with neighbours, in place.

    Columns: three channels that decide, the sum of their variances, more channels. Receivers of variance 0 stay, as do
    those of NO_WEIGHT, which do not count for neighbours. reach: standard deviations.
    responds: column 4 is a small grey change of the sum of channels, and becomes that of their averages. Weights
    change with it: it is the derivative in grey light, at constant variances.
    """
    for _ in range(2):
        rows = np.flatnonzero(light[:, VARIANCE] > 0)
        # 1 << 18 values per step, receivers times columns: 5 ms in office
        out, at_once = np.empty((len(rows), light.shape[1])), (1 << 18) // light.shape[1]
        for k in range(0, len(rows), at_once):
            part, to = rows[k : k + at_once], out[k : k + at_once]

            def work(_, first, last, part=part, to=to):
                _pass(near, light, reach * reach, responds, part, first, last, to)

            run_ranges(work, len(part), threads, COSTLY)
            pause()
        light[rows] = out
        pause()


@kernel
def _pass(near, light, reach, responds, rows, start, stop, out):
    for row in range(start, stop):
        i, total = rows[row], 1.0
        x, y, z, v = light[i, 0], light[i, 1], light[i, 2], light[i, 3]
        more = of_weights = 0.0  # than column 4 in proportion to weights; sum of small changes of weights
        for c in range(4, light.shape[1]):
            out[row, c] = light[i, c]
        for k in range(near.first[i], near.first[i + 1]):
            j = near.of[k]
            variance = light[j, 3]
            dx, dy, dz = light[i, 0] - light[j, 0], light[i, 1] - light[j, 1], light[i, 2] - light[j, 2]
            span = reach * (light[i, 3] + abs(variance))
            w = max(1.0 - (dx * dx + dy * dy + dz * dz) / span, 0.0) if variance >= 0.0 else 0.0
            if responds:
                grey = dx + dy + dz
                of_weight = 4.0 / 3.0 * w * grey * (light[j, 4] - light[i, 4]) / span
                more, of_weights = more - of_weight * grey, of_weights + of_weight
            w *= w
            total += w
            v += w * w * variance
            x, y, z = x + w * light[j, 0], y + w * light[j, 1], z + w * light[j, 2]
            for c in range(4, light.shape[1]):
                out[row, c] += w * light[j, c]
        out[row, 0], out[row, 1], out[row, 2], out[row, 3] = x / total, y / total, z / total, v / (total * total)
        for c in range(4, light.shape[1]):
            out[row, c] /= total
        if responds:
            moved = (x + y + z) / total - (light[i, 0] + light[i, 1] + light[i, 2])
            out[row, 4] += (more - moved * of_weights) / total

"""Light of photons, averaged along surfaces in proportion to its noise.

Discs of neighbouring receivers overlap, but photons two radii apart are others. So each receiver is averaged with some
within NEAR radii, by the kernel that averages changes by mobiles (`control_variate.py`): differences of REACH standard
deviations have no weight, so edges of shadows stay. Noise falls with more photons, and smoothing with it. A photon
subset tells the variance; averaged alike, it tells the noise that is left. docs/decisions/053-smoothed-photons.md has
the measurements.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from gi_core.frames.background import Background
from gi_core.frames.control_variate import REACH
from gi_core.gather.denoise import NO_WEIGHT, VARIANCE, averaged, smoothed
from gi_core.geometry.error import luminance, subset_to_compare
from gi_core.geometry.mesh_neighbours import Neighbours
from gi_core.lights.mix import sum_of_lamps

NEAR = 2.0  # disc radii: 4 serve few photons better, and half a million worse


class SmoothedPhotons(NamedTuple):
    """Light of n static receivers by all photons of a background, at the levels of the scene file."""

    background: Background
    photons: int
    irradiance: np.ndarray  # (n, 3) float64 [W/m2]
    deviation: np.ndarray  # (n,) float64 [W/m2], standard error of the luminance
    noise: float  # relative l1, of that; inf: photons too few to measure it, light as it is

    def is_of(self, b: Background) -> bool:
        return self.background is b and self.photons == b.estimate.photons


def smooth_photons(b: Background, around: Neighbours) -> Generator[None, None, SmoothedPhotons]:
    """Smooth the light of all photons of a background, in steps; around: receivers near each."""
    photons, fewer = b.estimate.photons, subset_to_compare(b.estimate.subsets)
    E, deviation = b.irradiance(photons), np.zeros(len(b.weights))
    if fewer is None:
        return SmoothedPhotons(b, photons, E, deviation, math.inf)
    given = b.irradiance(fewer), photons / fewer, around, _reached(b), b.weights, b.model.threads
    E, deviation = yield from smoothed_by_subset(E, *given)
    total = float(b.weights @ luminance(E))
    noise = math.sqrt(2 / math.pi) * float(b.weights @ deviation) / total if total > 0 else math.nan
    return SmoothedPhotons(b, photons, E, deviation, noise)


def smooth_per_lamp(b: Background, around: Neighbours) -> Generator[None, None, np.ndarray]:
    """Smooth the light (n, 3 G) [W/m2] of all photons by lamp, at the levels of the scene file, as smooth_photons()."""
    photons, fewer = b.estimate.photons, subset_to_compare(b.estimate.subsets)
    light = b.irradiance_per_lamp(photons)
    if fewer is None:
        return light
    both = sum_of_lamps(light), sum_of_lamps(b.irradiance_per_lamp(fewer))
    light, _ = yield from smoothed_by_subset(
        *both, photons / fewer, around, _reached(b), b.weights, b.model.threads, light
    )
    return light


def _reached(b: Background) -> np.ndarray:
    """Return whether light can reach static receivers at all, (n,) bool."""
    return b.estimate.background(b.estimate.photons)[1] > 0


def smoothed_by_subset(
    E: np.ndarray, fewer: np.ndarray, times: float, around: Neighbours, counts: np.ndarray, weights: np.ndarray,
    threads: int, per_lamp: np.ndarray | None = None,
) -> Generator[None, None, tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """Smooth light E (n, 3) in proportion to its noise, in steps.

    fewer (n, 3): that of a subset of its photons, which are `times` as many. Receivers that do not count (n,) stay,
    and have no weight for neighbours. per_lamp (n, k): light that takes the same averages. The generator returns
    smoothed E, or per_lamp in its place, and the standard error (n,) of the luminance of E. Neighbours share photons,
    so all standard errors are scaled: the subset, averaged alike, tells their mean over weights (n,).
    """
    apart = ((E - fewer) ** 2 / (times - 1)).sum(axis=1)
    variance = np.where(counts, averaged(around, apart, counts, threads), NO_WEIGHT)
    yield
    carried = fewer if per_lamp is None else np.concatenate([fewer, per_lamp], axis=1)
    light = yield from smoothed(E, carried, variance, REACH, around, threads)
    E, left, fewer, per_lamp_or_none = np.split(light, (VARIANCE, VARIANCE + 1, VARIANCE + 4), axis=1)
    deviation = np.sqrt(np.maximum(left[:, 0], 0.0))
    apart = weights @ np.abs(luminance(E - fewer)) / math.sqrt(times - 1)
    independent = math.sqrt(2 / math.pi) * (weights @ deviation)
    deviation *= apart / independent if independent > 0 else 0.0
    return E if per_lamp is None else per_lamp_or_none, deviation

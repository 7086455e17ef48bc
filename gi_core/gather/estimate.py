"""Light with its error: the record that each source of the static part's light fills.

Light is stored per lamp at the levels of the scene file, as lamps are dimmed without new photons or paths.
"""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np

from gi_core.geometry.error import luminance
from gi_core.lights.lamps import mix, sum_of_lamps


class Source(enum.Enum):
    """Source of an estimate."""

    PHOTONS = "photons alone"
    RADIOSITY = "bounces that are kept, in light that is iterated"
    WHOLE_PATHS = "whole paths, without bias"
    EDITED = "the best light before an edit, changed as photons say"


class Estimate(NamedTuple):
    """Light of n receivers with its error."""

    source: Source
    light: np.ndarray  # (n, 3 G) float64 [W/m2] per lamp; (n, 3) where the sum of all lamps is enough
    variance: np.ndarray  # (n, G) float64 [W2/m4], of the luminance of each lamp's light; independent between lamps
    noise: float  # relative l1, by the variance; inf: not measured
    error: float  # relative l1, bias included

    @property
    def irradiance(self) -> np.ndarray:
        """Irradiance (n, 3) [W/m2] at the levels of the scene file."""
        return sum_of_lamps(self.light)

    @property
    def deviation(self) -> np.ndarray:
        """Standard error (n,) [W/m2] of the luminance at the levels of the scene file."""
        return np.sqrt(self.variance.sum(axis=1))

    def deviation_at(self, levels: np.ndarray) -> np.ndarray:
        """Return the standard error (n,) [W/m2] of the luminance at levels (G, 3) of the lamps."""
        return np.sqrt(self.variance @ luminance(levels[: self.variance.shape[1]]) ** 2)

    @property
    def understated(self) -> float:
        """Error over noise: how many times larger than the standard error the error is on average; 1 if unknown."""
        return self.error / self.noise if 0 < self.noise < self.error < np.inf else 1.0

    def error_at(self, levels: np.ndarray, weights: np.ndarray) -> float:
        """Return the relative l1 error at levels (G, 3) of the lamps: `error`, scaled as the noise is.

        weights (n,): of the receivers.
        """
        own, at = (float(weights @ luminance(E)) for E in (self.irradiance, mix(self.light, levels)))
        of_own, of_at = (float(weights @ deviation) for deviation in (self.deviation, self.deviation_at(levels)))
        return self.error * ((of_at / at) / (of_own / own) if min(own, at, of_own) > 0 else 1.0)


def better(one: Estimate | None, other: Estimate | None) -> Estimate | None:
    """Return the estimate of less error; `one` where both have the same."""
    if one is None or other is None:
        return one or other
    return other if other.error < one.error else one


def variance_per_lamp(deviation: np.ndarray, of_lamps: np.ndarray) -> np.ndarray:
    """Return variances (n, G) whose sum is deviation (n,) squared, in proportion to of_lamps (n, G) squared."""
    squares = of_lamps**2
    total = squares.sum(axis=1)
    share = np.divide(deviation**2, total, out=np.zeros_like(total), where=total > 0)
    return squares * share[:, None]

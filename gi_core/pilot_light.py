"""Light by the few paths of a pilot: rough, but there long before the first rounds of gather_rounds.py.

Each point has as many paths, drawn beforehand and independent, so it is unbiased; it is what frames start from only
where photons are noisier by far, until rounds have come.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gi_core.error import falls_short, noise_of_truth

PASSES = (2, 2, 4)  # paths a point at a time; all points have had them before the next begin


def passes(paths: int) -> Iterator[tuple[int, int]]:
    """Return the first path of each pass and how many there are, up to `paths` in all."""
    first = 0
    for count in (*PASSES, paths - sum(PASSES)):
        if count > 0 and first + count <= paths:
            yield first, count
            first += count


class PilotLight:
    """Irradiance (n, 3) [W/m2] of n points by `paths` paths each; 0 paths: not yet known."""

    def __init__(self, n: int):
        self.paths = 0
        self._sums, self._squares = np.zeros((n, 3)), np.zeros((n, 3))

    def add(self, rows: np.ndarray, values: np.ndarray) -> None:
        """Take in what more paths have brought to some points, (rows, paths, 3)."""
        self._sums[rows] += values.sum(axis=1)
        self._squares[rows] += (values * values).sum(axis=1)

    @property
    def mean(self) -> np.ndarray:
        return self._sums / self.paths

    @property
    def standard_error(self) -> np.ndarray:
        """Of the mean, (n, 3) [W/m2]."""
        off = np.maximum(self._squares - self._sums**2 / self.paths, 0.0)
        return np.sqrt(off / (self.paths * (self.paths - 1)))

    def noise(self, weights: np.ndarray) -> float:
        """Return the l1 error that chance makes, as error.noise_of_truth(): rough, as so few paths know little."""
        return noise_of_truth(self.standard_error / falls_short(self.paths), self.mean, weights)

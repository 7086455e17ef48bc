"""Photons that glossy receivers have taken in."""

from __future__ import annotations

import numpy as np

PART = 8192  # photons taken in at a time


class Intake:
    """The first `photons` of a store of photons, whose lamps weigh `weights` (G, 3)."""

    def __init__(self, lamps: int):
        self.photons, self.weights = 0, np.ones((lamps, 3))
        self._store: object = None

    def begins_anew(self, store: object, weights: np.ndarray) -> bool:
        """Return whether store or weights differ from the last call; then no photon has been taken in."""
        anew = store is not self._store or not np.array_equal(weights, self.weights)
        if anew:
            self._store, self.weights, self.photons = store, weights.copy(), 0
        return anew

    def begin_with(self, store: object, weights: np.ndarray, photons: int) -> None:
        """Hold the first photons of a store, at these weights."""
        self._store, self.weights, self.photons = store, weights.copy(), photons

    def end_of_part(self, count: int) -> int:
        """Return the end of the next part of the first `count` photons."""
        return min(self.photons + PART, count)

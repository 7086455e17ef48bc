"""Sums of the background's segments at static receivers, by photon subset, with and without light from lamps.

Segments that leave lamps have columns of their own, behind those of all others. So bounced light alone costs no second
search.
"""

from __future__ import annotations

import numpy as np

from gi_core.photons.flux_sums import ThreadSums
from gi_core.photons.paths import Segments
from gi_core.photons.subsets import SubsetStore


class BackgroundSums:
    """Sums of n static receivers, of G lamps: 3 G columns, `channels`."""

    def __init__(self, receivers: int, channels: int, threads: int):
        self.added = ThreadSums(receivers, 2 * channels, threads)  # segments as apart() returns them
        self.subsets = SubsetStore()  # (n, 3 G) int64, of all segments
        self._bounced = SubsetStore()  # the same without segments that leave lamps
        self._sums = np.zeros((receivers, 2 * channels), np.int64)

    @property
    def channels(self) -> int:
        return self._sums.shape[1] // 2

    def copied(self, threads: int) -> BackgroundSums:
        """Return a copy; neither changes the other later."""
        self.added.move_to(self._sums)
        other = BackgroundSums(len(self._sums), self.channels, threads)
        other._sums = self._sums.copy()
        other.subsets, other._bounced = SubsetStore(self.subsets), SubsetStore(self._bounced)
        return other

    def apart(self, segments: Segments) -> Segments:
        """Return background segments with the columns that they add to."""
        direct = np.where(segments.bounce == 0, self.channels // 3, 0).astype(np.uint8)
        return segments._replace(lamp=segments.lamp + direct)

    def store(self, photons: int) -> None:
        """Store the sums of all that was added, the first `photons`, as a photon subset."""
        self.added.move_to(self._sums)
        bounced, direct = self._sums[:, : self.channels], self._sums[:, self.channels :]
        self.subsets[photons], self._bounced[photons] = bounced + direct, bounced.copy()

    def of(self, photons: int, direct: bool) -> np.ndarray:
        """Return the sums (n, 3 G) int64 of a subset; direct: with segments that leave lamps."""
        return (self.subsets if direct else self._bounced)[photons]

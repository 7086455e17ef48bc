"""Removed suffixes of cut photons: the cut segment behind the cut, and all later segments (report fig. 2.2).

A suffix is stored as photon, vertex and distance. Its segments are copied from the background on demand only: an
estimator that caches disc intersections needs none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.photons.paths import PathVertices, Segments, empty_segments, segments_behind


class RemovedSuffixes(NamedTuple):
    """Removed suffixes of n cut photons, photon-major."""

    paths: PathVertices  # of the background
    photon: np.ndarray  # (n,) int64
    vertex: np.ndarray  # (n,) int64, start vertex of the cut segment
    low: np.ndarray  # (n,) float32 [m], distance along it where the suffix begins; -1: with the whole segment

    @property
    def size(self) -> int:
        """Number of segments, including the cut ones."""
        return int((self.paths.offsets[self.photon + 1] - 1 - self.vertex).sum())

    @property
    def bounce(self) -> np.ndarray:
        """Bounce index of the cut segment, (n,) int64."""
        return self.vertex - self.paths.offsets[self.photon]

    def of(self, rows) -> RemovedSuffixes:
        """Return the suffixes of the given rows."""
        return self._replace(photon=self.photon[rows], vertex=self.vertex[rows], low=self.low[rows])

    def bounced(self) -> RemovedSuffixes:
        """Return the suffixes without the segments that leave lamps."""
        first = self.bounce == 0
        vertex, low = self.vertex + first, np.where(first, np.float32(-1.0), self.low)
        left = vertex < self.paths.offsets[self.photon + 1] - 1
        return self._replace(vertex=vertex, low=low).of(left)

    def segments(self, threads: int = 1) -> Segments:
        """Return the suffixes as segments, photon-major."""
        return segments_behind(self.paths, self.photon, self.vertex, self.low, threads)


def no_removed_suffixes(paths: PathVertices) -> RemovedSuffixes:
    """Return the removed suffixes of no photon."""
    nobody = np.empty(0, np.int64)
    return RemovedSuffixes(paths, nobody, nobody, empty_segments(0).low)

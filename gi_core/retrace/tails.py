"""What cut photons lose: the rest of the segment that a mobile cuts, and all later ones (report fig. 2.2).

Nothing is copied out of the background until somebody asks for `segments()`: who has kept what each background
segment adds, and where along it, needs no more than which photons are cut, at which vertex, and how far behind it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.photons.paths import PathVertices, Segments, empty_segments, segments_at


class Tails(NamedTuple):
    """Tails of cut photons, photon-major."""

    paths: PathVertices  # of the background
    eps: np.float32
    photon: np.ndarray  # (n,) int64
    vertex: np.ndarray  # (n,) int64, the one that the cut segment leaves
    low: np.ndarray  # (n,) float32 [m], where along it the tail begins

    @property
    def size(self) -> int:
        """How many segments there are, parts of segments included."""
        return int((self.paths.offsets[self.photon + 1] - 1 - self.vertex).sum())

    @property
    def bounce(self) -> np.ndarray:
        """Which segment of its photon is cut, (n,) int64."""
        return self.vertex - self.paths.offsets[self.photon]

    def of(self, rows) -> Tails:
        """Return the tails of some of the photons."""
        return self._replace(photon=self.photon[rows], vertex=self.vertex[rows], low=self.low[rows])

    def segments(self, threads: int = 1) -> Segments:
        """Return them as segments, photon by photon."""
        counts = self.paths.offsets[self.photon + 1] - 1 - self.vertex
        row = np.repeat(np.arange(len(counts)), counts)
        step = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
        out = segments_at(self.paths, self.eps, self.photon[row], self.vertex[row] + step, threads)
        out.low[step == 0] = self.low
        return out


def no_tails(paths: PathVertices, eps: np.float32) -> Tails:
    """Return those of no photon."""
    nobody = np.empty(0, np.int64)
    return Tails(paths, eps, nobody, nobody, empty_segments(0).low)

"""Photon subsets with stored background sums: the first 4,096, 8,192, ... photons, and all.

A photon subset is a valid smaller solution. A drag uses the largest subset whose frame fits the time; at rest all
photons are used.
"""

from __future__ import annotations

LOWEST = 4096  # photons: the noise of fewer is too high to be useful


def next_level(photons: int) -> int:
    """Return the smallest level (4,096, 8,192, ...) above a number of photons."""
    level = LOWEST
    while level <= photons:
        level *= 2
    return level


def is_level(photons: int) -> bool:
    return photons >= LOWEST and photons & (photons - 1) == 0


class SubsetStore(dict):
    """Results by photon subset: all levels, and the count stored last."""

    def __setitem__(self, photons: int, kept) -> None:
        for n in [n for n in self if not is_level(n) and n != photons]:
            del self[n]
        super().__setitem__(photons, kept)

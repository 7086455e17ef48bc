"""Photon subsets with stored background sums: the first 4,096, 8,192, ... photons, and all.

A photon subset is a valid smaller solution. A drag uses the largest subset whose frame fits the time; at rest all
photons are used.
"""

from __future__ import annotations

LOWEST = 4096  # photons: the noise of fewer is too high to be useful


def next_rung(photons: int) -> int:
    """Return the smallest rung above a number of photons."""
    rung = LOWEST
    while rung <= photons:
        rung *= 2
    return rung


def is_rung(photons: int) -> bool:
    return photons >= LOWEST and photons & (photons - 1) == 0


class Ladder(dict):
    """What is kept by prefix: the rungs, and the last count that was put in."""

    def __setitem__(self, photons: int, kept) -> None:
        for n in [n for n in self if not is_rung(n) and n != photons]:
            del self[n]
        super().__setitem__(photons, kept)

"""Prefixes of the photons for which a background is kept: a ladder of doubling counts, and all.

A prefix of the photons is a smaller solution of its own. While a mobile is dragged, the largest whose
frame fits the time is used; at rest, all photons.
"""

from __future__ import annotations

LOWEST = 4096  # photons: fewer are confetti


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

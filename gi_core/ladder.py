"""Prefixes of the photons for which a background is kept: a ladder of doubling counts, and all.

A prefix of the photons is a smaller solution of its own. While a mobile is dragged, the largest whose
frame fits the time is used; at rest, all photons.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from statistics import median

LOWEST = 4096  # photons: fewer are confetti
REMEMBERED = 9  # frames a prefix that a time is the median of


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


class FrameTimes:
    """Seconds that frames took, by prefix, and what others would take."""

    def __init__(self):
        self._seconds: dict[int, deque[float]] = {}

    def add(self, photons: int, seconds: float) -> None:
        self._seconds.setdefault(photons, deque(maxlen=REMEMBERED)).append(seconds)

    def expected(self, photons: int) -> float | None:
        """Return seconds [s] expected of a prefix: those measured, else a line through the two measured
        nearest to it, else proportional to the one measured; None without any."""
        times = {n: median(t) for n, t in self._seconds.items() if n}
        if not times or photons in times:
            return times.get(photons)
        near = sorted(times, key=lambda n: abs(n - photons))[:2]
        if len(near) == 1 or times[max(near)] <= times[min(near)]:
            return times[near[0]] * photons / near[0]
        a, b = sorted(near)
        slope = (times[b] - times[a]) / (b - a)
        return max(times[a] + slope * (photons - a), 0.0)

    def largest_within(self, seconds: float, prefixes: Iterable[int]) -> int:
        """Return the largest prefix expected to fit, the smallest if none does, all if nothing is known."""
        prefixes = sorted(prefixes)
        known = [(n, self.expected(n)) for n in prefixes]
        if known[-1][1] is None:
            return prefixes[-1]
        return max((n for n, t in known if t <= seconds), default=prefixes[0])

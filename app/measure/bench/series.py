"""Numbers of any count in bounded memory: a million frames leave as much behind as some thousands."""

from __future__ import annotations

import math

import numpy as np

ROOM = 8192  # numbers kept


class Series:
    """Keeps every number up to ROOM of them, then every second, every fourth ...; the extremes are exact."""

    def __init__(self, room: int = ROOM) -> None:
        self._room = room
        self._every = 1
        self._kept: list[tuple[float, int]] = []  # (number, its place in the series)
        self.count = 0
        self.min, self.max = math.inf, -math.inf

    def add(self, value: float) -> None:
        if self.count % self._every == 0:
            self._kept.append((value, self.count))
            if len(self._kept) == self._room:
                self._kept = self._kept[::2]
                self._every *= 2
        self.count += 1
        self.min, self.max = min(self.min, value), max(self.max, value)

    @property
    def median(self) -> float:
        return self.quantile(0.5)

    def quantile(self, q: float) -> float:
        """Return a quantile of the numbers kept, 0 of none."""
        return float(np.quantile([value for value, _ in self._kept], q)) if self._kept else 0.0

    def place_of_median(self) -> int:
        """Return which number lies nearest to the median: 0 for the first one added."""
        middle = self.median
        return min(self._kept, key=lambda kept: abs(kept[0] - middle))[1]

"""Moving median of displayed times."""

from __future__ import annotations

import statistics
from collections import deque

MEDIAN_FRAMES = 31


class MovingMedian:
    """The median of the last MEDIAN_FRAMES values, insensitive to one slow frame."""

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=MEDIAN_FRAMES)

    def add(self, value: float) -> None:
        self._values.append(value)

    @property
    def value(self) -> float:
        return statistics.median(self._values) if self._values else 0.0

"""Times as they are shown."""

from __future__ import annotations

import statistics
from collections import deque

SMOOTHED = 31  # frames that a shown time is the median of


class MovingMedian:
    """The median of the last values: one slow frame does not show."""

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=SMOOTHED)

    def add(self, value: float) -> None:
        self._values.append(value)

    @property
    def value(self) -> float:
        return statistics.median(self._values) if self._values else 0.0

"""Moving median of displayed times."""

from __future__ import annotations

import statistics
from collections import deque


class MovingMedian:
    """The median of the last 31 values, insensitive to one slow frame."""

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=31)

    def add(self, value: float) -> None:
        self._values.append(value)

    @property
    def value(self) -> float:
        return statistics.median(self._values) if self._values else 0.0

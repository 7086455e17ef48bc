"""Integer sums that several threads add to at once, each in an array of its own."""

from __future__ import annotations

import numpy as np


class ThreadSums:
    """An array of zeros (int64) a thread, made when first used."""

    def __init__(self, shape: tuple[int, ...], threads: int):
        self._shape = shape
        self._sums: list[np.ndarray | None] = [None] * threads

    def __getitem__(self, thread: int) -> np.ndarray:
        if self._sums[thread] is None:
            self._sums[thread] = np.zeros(self._shape, np.int64)
        return self._sums[thread]

    def move_to(self, total: np.ndarray) -> None:
        """Add all to `total` and start from zero again. Integers: the order does not matter."""
        for part in self._sums:
            if part is not None:
                total += part
                part.fill(0)

"""Sizes of steps from the measured time of earlier ones: an interactive program waits for the step under way."""

from __future__ import annotations

import math

STEP = 0.01  # s of a step at rest: a drag waits for one at most


class Pace:
    """Items per step."""

    def __init__(self, first: float, least: int, most: int):
        """first: seconds per item, before measurements; least, most: items per step."""
        self._each, self._least, self._most = first, least, most

    def fit(self, seconds: float) -> int:
        """Return the items that take so long."""
        return int(min(max(seconds / self._each, self._least), self._most))

    def share_of(self, left: int, seconds: float) -> int:
        """Return the items of the next step out of `left`; no step is short."""
        return -(-left // math.ceil(left / self.fit(seconds)))

    def took(self, count: float, seconds: float) -> None:
        """Record the time of a step. Faster steps count in full; slower ones may have been disturbed."""
        self._each = min(seconds / count, 0.5 * (self._each + seconds / count))

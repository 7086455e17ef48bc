"""The stage timer: seconds per stage of a frame."""

from __future__ import annotations

import time


class StageTimer:
    """Call it with the name of a stage when that stage ends; `seconds` sums the time per name."""

    def __init__(self):
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now

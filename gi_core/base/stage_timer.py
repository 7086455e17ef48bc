"""How long each stage of a frame took: the clock of gi_core."""

from __future__ import annotations

import time


class Stages:
    """Call it with a stage's name when the stage ends; `seconds` has the sum of each."""

    def __init__(self):
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now

"""Progress of work in steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Progress(NamedTuple):
    """State of `Solver.solve_steps` and `Solver.gather_steps`."""

    stage: str
    fraction: float  # 0 .. 1 of the photons wanted
    picture: bool  # irradiance was refreshed


class Interrupted(Exception):
    """A frame or a step was broken off, because its result is no longer wanted."""


def break_off_at(stop: Callable[[], bool] | None) -> None:
    """Raise Interrupted where stop() returns True."""
    if stop is not None and stop():
        raise Interrupted

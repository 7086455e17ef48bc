"""Progress of work in steps."""

from __future__ import annotations

from typing import NamedTuple


class Progress(NamedTuple):
    """State of `Solver.solve_steps` and `Solver.gather_steps`."""

    stage: str
    fraction: float  # 0 .. 1 of the photons wanted
    picture: bool  # irradiance was refreshed


class Interrupted(Exception):
    """A frame was broken off, because its result is no longer wanted."""

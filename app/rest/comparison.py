"""The same light by another estimator, for the right side of a wipe: computed at rest by a twin of the solver.

The twin shares the photons, so nothing is traced twice. Only the solver's thread uses it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from gi_core.display.dilation import Drawn
    from gi_core.solver import Solver


class Comparison(NamedTuple):
    """The light by another estimator."""

    version: object  # of the light
    estimator: str
    photons: int
    irradiance: np.ndarray  # (R, 3) [W/m2]
    drawn: Drawn  # the same for pictures


class ComparisonJob:
    """Call `step` until `seen`, the result, belongs to the wanted light."""

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self._twin: Solver | None = None
        self._steps: Iterator[Comparison | None] | None = None
        self._doing: tuple | None = None
        self.seen: Comparison | None = None

    def is_done(self, version: object, estimator: str) -> bool:
        return self.seen is not None and self.seen[:2] == (version, estimator)

    def step(self, version: object, estimator: str) -> None:
        """Advance the result of a version of the light and an estimator by one step."""
        if self._doing != (version, estimator):
            self._twin = self._twin or self._solver.twin()
            self._doing, self._steps = (version, estimator), _steps_of(self._solver, self._twin, version, estimator)
        self.seen = next(self._steps, None) or self.seen

    def drop(self) -> None:
        """Free twin and result."""
        self._twin = self._steps = self._doing = self.seen = None


def _steps_of(solver: Solver, twin: Solver, version: object, estimator: str) -> Iterator[Comparison | None]:
    """Yield None per step of the twin, then the result. Not a method: that would be a reference cycle."""
    fields = {**solver.setting._asdict(), "estimator": estimator}
    twin.configure(photons=solver.photons, light="photons", **fields)
    yield None
    for _ in twin.solve_steps():
        yield None
    twin.move_all(solver.poses)
    drawn = solver.as_drawn(twin.irradiance)
    yield Comparison(version, estimator, twin.photons_traced, twin.irradiance, drawn)

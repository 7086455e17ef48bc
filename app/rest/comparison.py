"""Light of another estimator for the right side of a wipe, computed at rest by a twin of the solver.

The twin shares the photons, so nothing is traced twice. Only the solver's thread uses it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from app.rest.results import Comparison

if TYPE_CHECKING:
    from gi_core.solver import Solver


class ComparisonJob:
    """Call `step` until `is_done`; `result` is then the light of that estimator."""

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self._twin: Solver | None = None
        self.steps: Iterator[Comparison | None] | None = None
        self._doing = ""
        self.result: Comparison | None = None

    def is_done(self, estimator: str) -> bool:
        return self.result is not None and self.result.estimator == estimator

    def step(self, estimator: str) -> None:
        """Advance the light of an estimator by one step."""
        self._twin = self._twin or self._solver.twin()
        steps, self.steps = self.steps, None  # a frame that is broken off ends its steps; new ones reuse its photons
        if steps is None or self._doing != estimator:
            self._doing, steps = estimator, _steps_of(self._solver, self._twin, estimator)
        self.result = next(steps, None)
        self.steps = steps

    def restart(self) -> None:
        """Discard the result, after a change of the light."""
        self.steps = self.result = None

    def drop(self) -> None:
        """Free twin and result."""
        self._twin = self.steps = self.result = None


def _steps_of(solver: Solver, twin: Solver, estimator: str) -> Iterator[Comparison | None]:
    """Yield None per step of the twin, then the result. Not a method: that would be a reference cycle."""
    fields = {**solver.setting._asdict(), "estimator": estimator}
    twin.configure(photons=solver.photons, light="photons", **fields)
    yield None
    for _ in twin.solve_steps():
        yield None
    twin.move_all(solver.poses)
    drawn = solver.drawn(twin.irradiance)
    yield Comparison(estimator, twin.frame.photons, twin.irradiance, drawn)

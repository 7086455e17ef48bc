"""The same light by another estimator, for the other side of a wipe: computed at rest by a twin of the solver.

The twin shares the photons, so nothing is traced twice; its memory is what that estimator keeps of them. It is
used in the solver's thread alone, a step at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from gi_core.display.dilation import Drawn
    from gi_core.solver import Solver


class Seen(NamedTuple):
    """What another estimator makes of the light."""

    version: object  # of the light that it belongs to
    estimator: str
    photons: int
    irradiance: np.ndarray  # (R, 3) [W/m2]
    drawn: Drawn  # the same for pictures


class OtherLook:
    """`step` until `seen` belongs to the light wanted."""

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self._twin: Solver | None = None
        self._steps: Iterator[Seen | None] | None = None
        self._doing: tuple | None = None
        self.seen: Seen | None = None

    def is_done(self, version: object, estimator: str) -> bool:
        return self.seen is not None and self.seen[:2] == (version, estimator)

    def step(self, version: object, estimator: str) -> None:
        """Go on towards the light of that version, seen by that estimator."""
        if self._doing != (version, estimator):
            self._twin = self._twin or self._solver.twin()
            self._doing, self._steps = (version, estimator), _look(self._solver, self._twin, version, estimator)
        self.seen = next(self._steps, None) or self.seen

    def drop(self) -> None:
        """Give back the memory: nobody looks any more."""
        self._twin = self._steps = self._doing = self.seen = None


def _look(solver: Solver, twin: Solver, version: object, estimator: str) -> Iterator[Seen | None]:
    """Go through steps of the twin, the last one with an answer; no method, which would hold who holds it."""
    fields = {**solver.setting._asdict(), "estimator": estimator}
    twin.configure(photons=solver.photons, light="photons", **fields)
    yield None
    for _ in twin.solve_steps():
        yield None
    twin.move_all(solver.poses)
    drawn = solver.as_drawn(twin.irradiance)
    yield Seen(version, estimator, twin.photons_traced, twin.irradiance, drawn)

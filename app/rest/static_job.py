"""The static part's light, gathered in pieces while everything rests and kept on disk: see `gi_core.gather.static`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from gi_core.solver import Solver

SAVE_EVERY = 20.0  # s


class Gathered(NamedTuple):
    """How far it is."""

    fraction: float  # 0 .. 1
    noise: float  # relative, l1; inf: not yet known
    used: bool  # the picture is made of it


class Gathering:
    """One a solver. `next_work` hands out a piece at a time for the solver's thread; `told` is for any thread."""

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        self._solver, self._clock = solver, clock
        self._steps = None
        self._store = None
        self._saved_at, self._saved = 0.0, -1.0  # the fraction that was
        self.told = Gathered(0.0, float("inf"), False)

    def next_work(self) -> Callable[[], bool] | None:
        """Return the next piece of work, None if nothing is left to do; it returns whether irradiance is new."""
        g = self._solver.gathered
        finished = self._steps is None and g is not None and g.enough  # what is known has reached the picture too
        if self._solver.light != "best" or finished:
            self._tell()
            return None
        return self._step

    def _step(self) -> bool:
        solver = self._solver
        if self._steps is None:
            from app.rest.reference_store import StaticStore

            self._store = StaticStore(solver.model, solver.seed)
            self._steps = solver.gather_steps(self._store.load() if solver.gathered is None else None)
            self._saved_at = self._clock()
        progress = next(self._steps, None)
        if progress is None:
            self._steps = None
        self._tell()
        done = progress is None or solver.gathered.enough
        state = solver.gathered.state  # None while there are single bounces alone: the store keeps whole paths
        due = done or self._clock() - self._saved_at > SAVE_EVERY
        if state is not None and self.told.fraction > self._saved and due:
            self._store.keep(state)
            self._saved_at, self._saved = self._clock(), self.told.fraction
        return progress is not None and progress.picture

    def _tell(self) -> None:
        g, solver = self._solver.gathered, self._solver
        if g is not None:
            self.told = Gathered(g.fraction, g.noise, solver.uses_gathered)


def gather(solver: Solver, bar) -> None:
    """Gather all of it at once, with the bar moving; what is there is kept, whatever ends it."""
    from app.rest.reference_store import StaticStore

    store = StaticStore(solver.model, solver.seed)
    try:
        for progress in solver.gather_steps(store.load()):
            bar(progress.stage, progress.fraction)
    finally:
        if solver.gathered is not None and solver.gathered.state is not None:
            store.keep(solver.gathered.state)

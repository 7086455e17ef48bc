"""The job of gathering the static part's light at rest, in short tasks, with its file: see `gi_core.gather.static`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from app.rest.reference_store import StaticStore
    from gi_core.solver import Progress, Solver


class GatherProgress(NamedTuple):
    """Progress of the static light."""

    fraction: float  # 0 .. 1
    noise: float  # relative l1; inf: unknown
    used: bool  # the picture shows it


class Gathering:
    """One per solver. The solver's thread runs the tasks of `next_work`; any thread may read `progress`."""

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        self._solver, self._clock = solver, clock
        self._steps: Iterator[Progress] | None = None
        self._store: StaticStore | None = None
        self._saved_at, self._saved = 0.0, -1.0  # the saved fraction
        self.progress = GatherProgress(0.0, float("inf"), False)

    def next_work(self) -> Callable[[], bool] | None:
        """Return the next task, None at the end; the task returns whether irradiance has changed."""
        g = self._solver.gathered
        finished = self._steps is None and g is not None and g.enough  # and its light is in the picture
        if self._solver.light != "best" or finished:
            self._update_progress()
            return None
        return self._step

    def _step(self) -> bool:
        from app.rest.reference_store import SAVE_SECONDS, StaticStore

        solver = self._solver
        if self._steps is None:
            self._store = StaticStore(solver.model, solver.seed)
            self._steps = solver.gather_steps(self._store.load() if solver.gathered is None else None)
            self._saved_at = self._clock()
        progress = next(self._steps, None)
        if progress is None:
            self._steps = None
        self._update_progress()
        done = progress is None or solver.gathered.enough
        state = solver.gathered.state  # None during single bounces: the file holds whole paths only
        due = done or self._clock() - self._saved_at > SAVE_SECONDS
        if state is not None and self.progress.fraction > self._saved and due:
            self._store.keep(state)
            self._saved_at, self._saved = self._clock(), self.progress.fraction
        return progress is not None and progress.picture

    def _update_progress(self) -> None:
        g, solver = self._solver.gathered, self._solver
        if g is not None:
            self.progress = GatherProgress(g.fraction, g.noise, solver.uses_gathered)


def gather(solver: Solver, bar) -> None:
    """Gather all static light, showing progress; save it at the end or after an exception."""
    from app.rest.reference_store import StaticStore

    store = StaticStore(solver.model, solver.seed)
    try:
        for progress in solver.gather_steps(store.load()):
            bar(progress.stage, progress.fraction)
    finally:
        if solver.gathered is not None and solver.gathered.state is not None:
            store.keep(solver.gathered.state)

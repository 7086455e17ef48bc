"""The order of work at rest: static light, error measurements, comparisons."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from app.rest.live_error import LiveError, Wants
from app.rest.results import RestResults
from app.rest.static_job import Gathering
from app.settings import REFERENCE, Settings
from app.worker import Task

if TYPE_CHECKING:
    from gi_core.solver import Solver

GATHERING = "gathering the static light"
FIRST_TURNS = 4  # all but one gather light, until it has a first result


class RestWork:
    """Work at rest in short tasks, and its results. One per solver; only the solver's thread uses it."""

    def __init__(self, solver: Solver, clock: Callable[[], float], stop: Callable[[], bool] | None = None) -> None:
        """stop: whether to break off a frame, as for Solver.move_all()."""
        self.gathering, self.live_error = Gathering(solver, clock, stop), LiveError(solver, clock, stop)
        self.given_up: set[str] = set()  # kinds of tasks that have failed
        self._wants = Wants()
        self._turn = 0

    def next_task(self, settings: Settings) -> Task | None:
        """Return a task of a kind not given up, None at the end: gathering and error measurement take turns.

        Until gathering has a first result it has most turns: a better picture matters more than its error.
        """
        other = "" if settings.compare == REFERENCE else settings.compare
        self._wants = Wants(settings.measure_errors, REFERENCE in settings.beside_estimate, other)
        self._turn += 1
        turns = FIRST_TURNS if math.isinf(self.gathering.progress.error) else 2
        first, second = (self._gather, self._measure_errors)[:: 1 if self._turn % turns else -1]
        return first() or second()

    def results(self) -> RestResults:
        """Return the results for the solver's present light."""
        e = self.live_error
        e.follow()
        reference = e.picture if self._wants.picture else None
        return RestResults(self.gathering.progress, e.report, e.point, reference, e.comparison.result)

    def keep(self) -> None:
        """Save the static light and the references as far as they are."""
        self.gathering.keep()
        self.live_error.keep()

    def _gather(self) -> Task | None:
        run = None if GATHERING in self.given_up else self.gathering.next_work()
        return run and Task(GATHERING, run)

    def _measure_errors(self) -> Task | None:
        return self.live_error.next_task(self._wants, self.given_up)

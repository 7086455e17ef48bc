"""The order of work at rest: static light, error measurements, comparisons."""

from __future__ import annotations

import math
from collections.abc import Set
from typing import TYPE_CHECKING

from app.rest.live_error import LiveError, Wants
from app.rest.static_job import Gathering
from app.settings import REFERENCE, Settings
from app.worker import Task

if TYPE_CHECKING:
    from app.session.solver_thread import Solving

GATHERING = "gathering the static light"
FIRST_TURNS = 4  # all but one gather light, until it has a first result


class AtRest:
    """Tasks for the solver's thread, one at a time; `next_task` is called there. `settings` are the user's."""

    def __init__(self, settings: Settings, light: Solving, gathering: Gathering, live_error: LiveError | None) -> None:
        self.settings = settings
        self._light, self._gathering, self._live_error = light, gathering, live_error
        self._turn = 0
        self._drawn: object = None  # state of reference and comparison in the last picture

    def next_task(self, given_up: Set[str] = frozenset()) -> Task | None:
        """Return a task of a job not given up, None at the end: gathering and error measurement take turns.

        Until gathering has a first result it has most turns: a better picture matters more than its error.
        """
        self._turn += 1
        turns = FIRST_TURNS if math.isinf(self._gathering.progress.noise) else 2
        first, second = (self._gather, self._measure_errors)[:: 1 if self._turn % turns else -1]
        return first(given_up) or second(given_up)

    def _gather(self, given_up: Set[str]) -> Task | None:
        run = None if GATHERING in given_up else self._gathering.next_work()
        return run and Task(GATHERING, run)

    def _measure_errors(self, given_up: Set[str]) -> Task | None:
        if self._live_error is None:
            return None
        s, light = self.settings, self._light
        other = "" if s.compare == REFERENCE else s.compare
        self._live_error.wants = Wants(s.measure_errors, REFERENCE in s.beside_estimate, other)
        return self._live_error.next_task(light.version, light.snapshot.irradiance, given_up)

    def has_news(self) -> bool:
        """Return whether the reference or the comparison has visibly changed since the last call."""
        if self._live_error is None:
            return False
        before, self._drawn = self._drawn, self._live_error.progress(self._light.version, self._light.snapshot.poses)
        return self._drawn != before

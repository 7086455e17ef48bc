"""Work at rest: the static light gathered, errors measured, comparisons computed."""

from __future__ import annotations

import math
from collections.abc import Set
from typing import TYPE_CHECKING

from app.rest.live_error import Appraisal, Wants
from app.rest.static_job import Gathering
from app.settings import REFERENCE, Settings
from app.worker import Task

if TYPE_CHECKING:
    from app.session.solver_thread import Solving

GATHERING = "gathering the static light"
TURNS = 4  # of which all but one are gathering's, at first


class AtRest:
    """Tasks for the solver's thread, one at a time; `next_task` is called there. `settings` are the user's."""

    def __init__(self, settings: Settings, light: Solving, gathering: Gathering, appraisal: Appraisal | None) -> None:
        self.settings = settings
        self._light, self._gathering, self._appraisal = light, gathering, appraisal
        self._turn = 0
        self._drawn: object = None  # how far the reference and the other estimator were when last drawn

    def next_task(self, given_up: Set[str] = frozenset()) -> Task | None:
        """Return a task of a job not given up, None if all is done: gathering and appraising take turns.

        Until gathering has an answer, most turns are its own: a better picture comes before the error of this one.
        """
        self._turn += 1
        turns = TURNS if math.isinf(self._gathering.told.noise) else 2
        first, second = (self._gather, self._appraise)[:: 1 if self._turn % turns else -1]
        return first(given_up) or second(given_up)

    def _gather(self, given_up: Set[str]) -> Task | None:
        run = None if GATHERING in given_up else self._gathering.next_work()
        return run and Task(GATHERING, run)

    def _appraise(self, given_up: Set[str]) -> Task | None:
        if self._appraisal is None:
            return None
        s, light = self.settings, self._light
        other = "" if s.compare == REFERENCE else s.compare
        self._appraisal.wants = Wants(s.appraise, REFERENCE in s.beside_estimate, other)
        return self._appraisal.next_task(light.version, light.snapshot.irradiance, given_up)

    def has_news(self) -> bool:
        """Return whether the reference or the other estimator has come, or become much better, since the last call."""
        if self._appraisal is None:
            return False
        before, self._drawn = self._drawn, self._appraisal.progress(self._light.version, self._light.snapshot.poses)
        return self._drawn != before

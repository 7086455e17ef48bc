"""What a session has done while everything rests: the static light gathered, errors measured, comparisons computed."""

from __future__ import annotations

import math
from collections.abc import Set
from typing import TYPE_CHECKING

from app import looks
from app.appraisal import Wants
from app.background import Task
from app.settings import REFERENCE

if TYPE_CHECKING:
    from app.session import Session

GATHERING = "gathering the static light"
TURNS = 4  # of which all but one are gathering's, at first


class AtRest:
    def __init__(self, session: Session) -> None:
        self._session = session
        self._turn = 0
        self._drawn: object = None  # how far what the picture is compared with was when it was last drawn

    def next_work(self, given_up: Set[str] = frozenset()) -> Task | None:
        """Return a task of a job not given up, None if all is done: gathering and appraising take turns.

        Until it has an answer, most turns are gathering's: a better picture comes before the error of
        this one.
        """
        gathering, self._turn = self._session.gathering, self._turn + 1
        turns = TURNS if math.isinf(gathering.told.noise) else 2
        first, second = (self._gather, self._appraise)[:: 1 if self._turn % turns else -1]
        return first(given_up) or second(given_up)

    def _gather(self, given_up: Set[str]) -> Task | None:
        run = None if GATHERING in given_up else self._session.gathering.next_work()
        return run and Task(GATHERING, run)

    def _appraise(self, given_up: Set[str]) -> Task | None:
        session, s = self._session, self._session.settings
        if session.appraisal is None:
            return None
        asked = looks.asked(s)
        session.appraisal.wants = Wants(s.appraise, REFERENCE in asked, "" if s.compare == REFERENCE else s.compare)
        return session.appraisal.next_work(session.light.version, session.irradiance, given_up)

    def has_news(self) -> bool:
        """Tell whether what the picture is compared with has come, or become much better, since the last call."""
        appraisal, light = self._session.appraisal, self._session.light
        if appraisal is None:
            return False
        before, self._drawn = self._drawn, appraisal.progress(light.version, light.poses_drawn)
        return self._drawn != before

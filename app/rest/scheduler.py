"""The order of work at rest: static light, light at the poses, a plane, errors; with or without a window."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from app import settings as defaults
from app.cli.progress import time_left
from app.rest.jobs import Job, PlaneJob, PoseJob, StaticJob, first_task
from app.rest.live_error import LiveError
from app.rest.results import GatherProgress, RestResults
from app.settings import REFERENCE, Settings
from app.worker import Task

if TYPE_CHECKING:
    from gi_core.solver import Solver

FIRST_TURNS = 3  # of gathering static light per turn of measuring errors, until it has a first result
NO_ERRORS = Settings(measure_errors=False)


class RestWork:
    """Work at rest in short tasks, and its results. One per solver; only the solver's thread uses it."""

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        self.gathering, self.live_error = StaticJob(solver, clock), LiveError(solver, clock)
        self.at_poses, self.plane = PoseJob(solver), PlaneJob(solver)
        self.given_up: set[str] = set()  # kinds of tasks that have failed
        self._settings = Settings()
        self._turn = 0

    def next_task(self, settings: Settings) -> Task | None:
        """Return a task of a kind not given up, None at the end: gathering and measurements take turns.

        Until gathering has a first result it has most turns: a better picture matters more than its error.
        """
        self._settings, static = settings, self.gathering
        unknown = math.isinf(static.progress.error) and static.name not in self.given_up
        gathering: tuple[Job, ...] = (static,) * FIRST_TURNS if unknown else (static, self.at_poses)
        jobs = *gathering, self.plane, self.live_error, self.plane  # two turns: the user waits for its numbers
        self._turn += 1
        turn = self._turn % len(jobs)
        return first_task((*jobs[turn:], *jobs[:turn]), settings, self.given_up)

    def results(self) -> RestResults:
        """Return the results for the solver's present light."""
        e = self.live_error
        e.follow()
        reference = e.picture if REFERENCE in self._settings.beside_estimate else None
        light = self.at_poses.light
        at_poses = None if light is None else GatherProgress(light.fraction, light.left, bool(light.used.any()))
        return RestResults(self.gathering.progress, at_poses, e.report, e.point, reference, e.comparison.result,
                           self.plane.light)  # fmt: skip

    def end(self) -> None:
        """Save the static light and the references as far as they are, and end all steps, in their own thread."""
        self.gathering.keep()
        self.live_error.keep()
        for job in (self.gathering, self.at_poses, self.plane, self.live_error, self.live_error.comparison):
            job.drop()


def gather(
    solver: Solver,
    seconds: float | None,
    bar: Callable[[str, float], None],
    at_poses: bool = True,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Gather light for at most `seconds`, and one task more; show the time left, save static light as the window does.

    seconds: None for the default, `app.settings.SECONDS`; at_poses: also with mobiles in place; without it only the
    static part's light, for pictures of other poses. Light is saved after an exception too. Nothing is gathered without
    seconds, and by a solver of light "photons".
    """
    seconds = defaults.SECONDS if seconds is None else seconds
    work, began = RestWork(solver, clock), clock()
    try:
        while (left := seconds - (clock() - began)) > 0:
            task = work.next_task(NO_ERRORS) if at_poses else first_task((work.gathering,), NO_ERRORS)
            if task is None:
                break
            bar(f"gathering light{time_left(left)}", 1 - left / seconds)
            task.run()
    finally:
        work.gathering.keep()

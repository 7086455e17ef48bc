"""The order of work at rest: static light, error measurements, comparisons."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from app.rest.gather_jobs import PoseJob, StaticJob
from app.rest.live_error import LiveError, Wants
from app.rest.plane_job import PlaneJob
from app.rest.results import GatherProgress, RestResults
from app.settings import REFERENCE, MeasuringPlane, Settings
from app.worker import Task

if TYPE_CHECKING:
    from gi_core.solver import Solver

GATHERING, AT_POSES = "gathering the static light", "gathering the light at these poses"
PLANE = "measuring the plane"
FIRST_TURNS = 3  # of gathering static light per turn of measuring errors, until it has a first result


class RestWork:
    """Work at rest in short tasks, and its results. One per solver; only the solver's thread uses it."""

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        self.gathering, self.live_error = StaticJob(solver, clock), LiveError(solver, clock)
        self.at_poses = PoseJob(solver)
        self.plane = PlaneJob(solver)
        self.given_up: set[str] = set()  # kinds of tasks that have failed
        self._wants = Wants()
        self._turn = 0

    def next_task(self, settings: Settings) -> Task | None:
        """Return a task of a kind not given up, None at the end: gathering and measurements take turns.

        Until gathering has a first result it has most turns: a better picture matters more than its error.
        """
        other = "" if settings.compare == REFERENCE else settings.compare
        self._wants = Wants(settings.measure_errors, REFERENCE in settings.beside_estimate, other)
        unknown = math.isinf(self.gathering.progress.error) and GATHERING not in self.given_up
        gathering = (self.next_static,) * FIRST_TURNS if unknown else (self.next_static, self._gather_at_poses)
        if settings.plane is None:
            self.plane.next_work(None)  # its light goes at once, whichever job has its turn
        plane: Callable[[], Task | None] = functools.partial(self._measure_plane, settings.plane)
        jobs = [*gathering, plane, self._measure_errors, plane]  # two turns: the user waits for its numbers
        self._turn += 1
        turn = self._turn % len(jobs)
        return next((task for job in (*jobs[turn:], *jobs[:turn]) if (task := job()) is not None), None)

    def results(self) -> RestResults:
        """Return the results for the solver's present light."""
        e = self.live_error
        e.follow()
        reference = e.picture if self._wants.picture else None
        light = self.at_poses.light
        at_poses = None if light is None else GatherProgress(light.fraction, light.left, bool(light.used.any()))
        return RestResults(self.gathering.progress, at_poses, e.report, e.point, reference, e.comparison.result,
                           self.plane.light)  # fmt: skip

    def end(self) -> None:
        """Save the static light and the references as far as they are, and end all steps, in their own thread."""
        self.gathering.keep()
        self.live_error.keep()
        self.gathering.steps = self.at_poses.steps = self.live_error.comparison.steps = None

    def next_static(self) -> Task | None:
        """Return a task that gathers the static part's light, None at the end."""
        run = None if GATHERING in self.given_up else self.gathering.next_work()
        return run and Task(GATHERING, run)

    def _gather_at_poses(self) -> Task | None:
        run = None if AT_POSES in self.given_up else self.at_poses.next_work()
        return run and Task(AT_POSES, run)

    def _measure_plane(self, plane: MeasuringPlane | None) -> Task | None:
        run = self.plane.next_work(plane)
        return None if run is None or PLANE in self.given_up else Task(PLANE, run)

    def _measure_errors(self) -> Task | None:
        return self.live_error.next_task(self._wants, self.given_up)

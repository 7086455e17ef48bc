"""The order of work at rest: static light, light at the poses, surfaces, errors; with or without a window."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app import settings as defaults
from app.cli.progress import time_left
from app.rest.hold import HeldResult
from app.rest.jobs import AskedJob, ChangeJob, FineJob, HoldJob, Job, PoseJob, StaticJob, SurfacesJob, first_task
from app.rest.live_error import LiveError
from app.rest.results import GatherProgress, RestResults
from app.settings import Settings
from app.worker import Task
from gi_core.base.pause import Interrupted
from gi_core.frames.first_frame import EARLY_PATHS
from gi_core.gather.static import ALL_PATHS
from gi_core.scene import Pose
from gi_core.solver import Solver

NO_ERRORS = Settings(measure_errors=False)


class TaskEnd(NamedTuple):
    """How a task has ended."""

    name: str  # its kind; "": no task was left
    changed: bool  # the light on show
    problem: Exception | None = None


class RestWork:
    """Work at rest in short tasks, and its results. One per solver; only the solver's thread uses it."""

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        self._solver = solver
        self._stated: tuple[np.ndarray | None, float] = None, math.nan  # irradiance, and the error that it states
        self.gathering, self.live_error = StaticJob(solver, clock), LiveError(solver, clock)
        self.at_poses, self.surfaces, self.fine = PoseJob(solver), SurfacesJob(solver), FineJob(solver)
        self.hold, self.asked, self.change = HoldJob(solver), AskedJob(solver), ChangeJob(solver)
        self.given_up: set[str] = set()  # kinds of tasks that have failed
        self._settings = Settings()
        self._poses: dict[str, Pose] = {}  # of `at_poses`
        self._taken: defaultdict[str, float] = defaultdict(float)  # s, by kind of task

    def next_task(self, settings: Settings) -> Task | None:
        """Return a task of a kind not given up, None at the end. The kind that has taken the least time is next.

        Turns by count gave light at poses a tenth of the time. It begins at 0 for new poses, where the user looks, but
        waits for all radiosity: until then the static part has clouds everywhere.
        """
        self._settings = settings
        if self._poses != self._solver.poses:
            self._poses, self._taken[self.at_poses.name] = self._solver.poses, 0.0
        first = first_task(self._first, settings, self.given_up)
        jobs: tuple[Job, ...] = self.gathering, self.surfaces, self.live_error
        if not self._is_early(ALL_PATHS) or self.gathering.name in self.given_up:
            jobs += (self.at_poses,)
        due = [first_task((job,), settings, self.given_up) for job in jobs]
        return first or min(filter(None, due), key=lambda task: self._taken[task.name], default=None)

    @property
    def _first(self) -> tuple[Job, ...]:
        """Jobs before all others. Fine points take 2 to 8 s once, and sunlight has teeth without them."""
        return *self._asked, self.fine

    @property
    def _asked(self) -> tuple[Job, ...]:
        """Jobs that the user waits for, a second each: levels change all light at rest, a pin, the change since A."""
        return self.hold, self.asked, self.change

    def next_urgent(self, settings: Settings) -> Task | None:
        """Return the next task that need not wait for all photons; None where none is due.

        Surfaces wait for light that is no longer early, which they held up by 15 s in classroom. Then they and fine
        points take turns.
        """
        both = sorted((self.fine, self.surfaces), key=lambda job: self._taken[job.name])
        jobs = self._first if self._is_early(EARLY_PATHS) else (*self._asked, *both)
        return first_task(jobs, settings, self.given_up)

    def _is_early(self, paths: int) -> bool:
        """Whether frames take gathered light, but there is none of so many paths per receiver."""
        light = self._solver.frame_light
        return light.setting.takes_gathered and light.static.is_early(paths)

    def run(self, task: Task | None) -> TaskEnd:
        """Run a task. One that fails ends only its own kind, until the scene is loaded again."""
        end, began = TaskEnd("", False), time.perf_counter()
        if task is not None:
            try:
                end = TaskEnd(task.name, task.run())
            except Interrupted:
                raise
            except Exception as problem:
                self.given_up.add(task.name)
                end = TaskEnd(task.name, False, problem)
            self._taken[task.name] += time.perf_counter() - began
        if self._stated[0] is not (E := self._solver.irradiance):  # not in motion, where no work is run
            self._stated = E, self._solver.error
        return end

    def results(self) -> RestResults:
        """Return the results for the solver's present light."""
        e, E = self.live_error, self._solver.irradiance
        reference = e.picture if self._settings.needs_reference else None
        light = self.at_poses.light
        held = self.hold.result
        surfaces = (*(held.lights if held else ()), *self.surfaces.lights)
        at_poses = None if light is None else GatherProgress(light.fraction, light.left, bool(light.used.any()))
        error = self._stated[1] if self._stated[0] is E else math.nan
        report, point = (e.report, e.point) if e.light is E else (None, None)
        more = self.fine.light, held, self.hold.fraction, self.asked.answer, self.change.result
        return RestResults(self.gathering.progress, error, at_poses, report, point, reference, surfaces, *more)

    def end(self) -> None:
        """Save the static light and the references as far as they are, and end all steps, in their own thread."""
        self.gathering.keep()
        self.live_error.keep()
        rest = self.hold, self.asked, self.change, self.surfaces, self.live_error
        for job in (self.gathering, self.at_poses, self.fine, *rest):
            job.drop()


def hold(solver: Solver, settings: Settings, bar: Callable[[str, float], None]) -> HeldResult | None:
    """Let each frame hold the targets of surfaces; return the result, None without targets."""
    work = HoldJob(solver)
    while (task := first_task((work,), settings)) is not None:
        bar("finding levels", 0.0)
        task.run()
    return work.result


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
            if (problem := work.run(task).problem) is not None:
                raise problem
    finally:
        work.gathering.keep()

"""The solver's thread: jobs one at a time, and the snapshot that the window draws.

Poses and their light change together, when a picture or a move is complete. A frame waits for a job within its budget;
the job then goes on behind the picture. During a motion the light may be that of a subset of the photons
(gi_core/frames/light_setting.py).
"""

from __future__ import annotations

import functools
import statistics
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from app.rest.jobs import HoldJob
from app.rest.results import RestResults
from app.rest.scheduler import RestWork, TaskEnd
from app.session.log import WARNING, Log
from app.session.method_view import MethodParts, MethodView
from app.session.solver_jobs import (
    Dim,
    Job,
    Move,
    Moved,
    Refine,
    Rest,
    Rested,
    Show,
    Snapshot,
    Step,
    Time,
    snapshot_of,
)
from app.settings import Settings
from app.worker import PATIENCE, Call, Worker
from gi_core.base.pause import Interrupted, Progress, breaking_off
from gi_core.base.results import Results
from gi_core.scene import Pose
from gi_core.solver import Solver

GRACE = 0.040  # s per frame for a move: with the drawing, a frame stays under 50 ms


class MovingMedian:
    """The median of the last 31 displayed times, insensitive to one slow frame."""

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=31)

    def add(self, value: float) -> None:
        self._values.append(value)

    @property
    def value(self) -> float:
        return statistics.median(self._values) if self._values else 0.0


class Waiting:
    """Moves and levels of lamps that wait for their turn."""

    def __init__(self) -> None:
        self.poses: dict[str, Pose] = {}
        self.levels: Mapping[str, tuple[float, float, float]] | None = None
        self.begins = False  # the next move begins a motion
        self.breaks = threading.Event()  # set while something waits: a frame that shows no move is then broken off
        self.over = threading.Event()  # set while a new motion waits: a later frame of the old one is broken off

    def __bool__(self) -> bool:
        return bool(self.poses) or self.levels is not None


@dataclass
class Refinement:
    """Steps to all photons."""

    steps: Generator[Progress, None, None] | None = None  # None: all is refined
    progress: Progress | None = None  # the last step


@dataclass
class Timing:
    """Frames of photon subsets that are timed, so that the first drag knows which fit."""

    due: bool = True
    steps: Iterator[bool] | None = None  # None: not begun at these poses


class Running(NamedTuple):
    """A job under way."""

    job: Job
    call: Call


class SolverThread:
    """Hands jobs to the solver's thread, which alone touches the solver; all methods are the window's thread's."""

    snapshot: Snapshot

    def __init__(self, solver: Solver, log: Log, clock: Callable[[], float], worker: Worker) -> None:
        self.log = log
        self.clock = clock
        self.version = 0  # of the picture in the snapshot
        self.gi_seconds = MovingMedian()  # new poses in, irradiance out
        self.grace = GRACE  # s per frame for a move
        self.budget = 0.0  # s per frame in motion; 0: always all photons
        self.move_failed = False  # the last one
        self.is_current = True  # the picture has the settings configured last
        self.all_done = False  # the last call for a task at rest found none
        self.method: MethodView | None = None  # parts of the method that the window draws
        self._parts: MethodParts | None = None  # those asked for
        self._warned: set[str] = set()  # kinds of warnings that the log has had
        self._waiting = Waiting()
        self._solver, self._work, self._worker = solver, RestWork(solver, clock), worker
        self._running: Running | None = None
        self._timing = Timing()
        self._refinement = Refinement()
        self._begin_refinement()
        self._show(worker.submit(functools.partial(snapshot_of, solver, self._work)).result())

    # -- state ------------------------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        job = isinstance(self._job, Refine | Move | Dim | Time)
        return self._is_refining or job or bool(self._waiting) or self.partial

    @property
    def refined(self) -> float:
        """Share of the photons at the present settings; 1: all are in the picture, below it another may be on show."""
        if not self._is_refining:
            return 1.0
        return min(self.progress.fraction, 0.99) if self.progress is not None else 0.0

    @property
    def progress(self) -> Progress | None:
        """The last step of the refinement under way."""
        return self._refinement.progress

    @property
    def _is_refining(self) -> bool:
        return self._refinement.steps is not None

    @property
    def _job(self) -> Job | None:
        """The job under way."""
        return self._running.job if self._running is not None else None

    @property
    def is_idle(self) -> bool:
        """Whether no job is under way."""
        return self._running is None

    @property
    def is_moving(self) -> bool:
        """Whether a move is under way or waits: mobiles are not yet drawn at their poses."""
        return isinstance(self._job, Move) or bool(self._waiting.poses)

    @property
    def partial(self) -> bool:
        """Whether the picture has fewer photons or paths than at rest, and more is to come."""
        return self.snapshot.partial and not self.move_failed

    @property
    def poses(self) -> dict[str, Pose]:
        """Poses of the mobiles, those of moves under way included."""
        moving = job.poses if isinstance(job := self._job, Move) else {}
        return {**self.snapshot.poses, **moving, **self._waiting.poses}

    # -- results ----------------------------------------------------------------------------------

    def _take(self, result: Step | Moved | Rested | MethodView | bool) -> None:
        """Take over the result of a job."""
        match result:
            case Step(progress, snapshot, warnings, urgent, rest):
                self._log_failure(urgent)
                self._refinement.progress = progress
                if progress is None:
                    self._refinement.steps = None
                if snapshot is not None:
                    self._show(snapshot)
                elif rest is not None:
                    self._take_rest(rest)
                self.is_current |= snapshot is not None or progress is None
                for kind, text in warnings.items():
                    if kind not in self._warned:
                        self._warned.add(kind)
                        self.log(text, WARNING)
                if urgent.changed and urgent.name == HoldJob.name:  # levels are other light
                    self._begin_refinement()
            case Moved(seconds, snapshot):
                if seconds is None:
                    self._show(snapshot._replace(timings=self.snapshot.timings))
                else:
                    self.gi_seconds.add(seconds)
                    self._show(snapshot)
                self._timing.steps = None
                self._begin_refinement()
            case Rested(end, rest, snapshot):
                self.all_done = not end.name
                self._log_failure(end)
                if snapshot is not None:
                    self._show(snapshot._replace(timings=self.snapshot.timings))
                else:
                    self._take_rest(rest)
            case bool(more):
                self._timing.due = more
            case view:
                self.method = view
                self.version += 1

    def _log_failure(self, end: TaskEnd) -> None:
        if end.problem is not None:
            self.log.failure(f"{end.name} has failed and stops until F5", end.problem)

    def _fail(self, job: Job, problem: Exception) -> None:
        match job:
            case Refine():
                self._refinement = Refinement()
            case Move():
                self.move_failed = True
            case Dim():
                pass
            case Time():
                self._timing.due = False
            case Rest():
                self.all_done = True
            case Show(parts):
                self.method = MethodView(parts, self.snapshot.irradiance)  # not again for this frame
        self.log.failure(job.name, problem)

    def _take_rest(self, rest: RestResults) -> None:
        """Take results that leave the light as it is; a map of some may look otherwise."""
        self.version += not rest.looks_like(self.snapshot.rest)
        self.snapshot = self.snapshot._replace(rest=rest)

    def _show(self, snapshot: Snapshot) -> None:
        """Let the window draw a snapshot."""
        self.snapshot = snapshot
        self.version += 1

    def _begin_refinement(self) -> None:
        """Start refining at the present state; photons already traced stay."""
        self._refinement = Refinement(_steps(self._solver))

    # -- jobs -------------------------------------------------------------------------------------

    def _begin(self, job: Job, stop: threading.Event | None = None) -> None:
        """Begin a job; stop: set once its frames are no longer wanted."""
        run = breaking_off(None if stop is None else stop.is_set)(job.run)
        self._running = Running(job, self._worker.submit(functools.partial(run, self._solver, self._work)))

    def _wait(self, seconds: float) -> bool:
        """Wait for the job under way and take its result; return whether none is under way any more."""
        if self._running is None:
            return True
        job, call = self._running
        if not call.wait(seconds):
            return False
        self._running = None
        try:
            result = call.result()
        except Interrupted:
            if isinstance(job, Move) and not job.settles:
                self._waiting.poses = {**job.poses, **self._waiting.poses}
            self._begin_refinement()
        except Exception as problem:
            self._fail(job, problem)
        else:
            self._take(result)
        return True

    def configure(self, changes: Mapping[str, Any], patience: float) -> bool:
        """Change the solver's settings; return False if it stays busy for `patience` [s]. Raises SceneError."""
        if not self._wait(patience):
            return False
        # The solver keeps the old picture until the new one is as good.
        self._worker.submit(lambda: self._solver.configure(**changes)).result()
        self._begin_refinement()
        self._timing, self.is_current = Timing(), False
        return True

    def keep_results(self) -> Results:
        """Return results that the solver of an edited scene begins with; waits for the job under way.

        The static part's light is saved first: edits that do not change that part begin with it.
        """

        def keep() -> Results:
            self._work.gathering.keep()
            return self._solver.keep_results()

        return self._worker.submit(keep).result()

    def close(self, patience: float = PATIENCE) -> None:
        """Stop after the job under way and save the results at rest; wait for each for at most `patience` [s]."""
        self._wait(patience)
        if (steps := self._refinement.steps) is not None:
            self._worker.submit(steps.close)
        self._worker.submit(self._work.end).wait(patience)
        self._worker.close()
        self._refinement, self._timing, self._running = Refinement(), Timing(), None

    def refine(self, budget: float, rest: Settings | None = None) -> None:
        """Refine for at most `budget` [s]; the step under way then goes on behind the picture.

        rest: settings for work at rest; None while anything moves in the window.
        """
        deadline = self.clock() + budget
        while (steps := self._refinement.steps) is not None and not self._waiting:
            self.settle()  # at once: the refinement step that estimates all photons lasts twice as long
            if self.is_idle and not self._begin_show():
                self._begin(Refine(steps, rest), self._waiting.breaks)
            if not self._wait(deadline - self.clock()):
                return
        if self._waiting or not self._wait(deadline - self.clock()):
            return
        if self.partial or self._is_refining:
            return
        if self._timing.due and self.snapshot.poses and self.budget > 0:
            self._timing.steps = self._timing.steps or _timings(self._solver, self.budget)
            self._begin(Time(self._timing.steps))
        elif rest is not None:
            self._rest(deadline, rest)

    def _rest(self, deadline: float, settings: Settings) -> None:
        """Do tasks at rest, one by one."""
        self.all_done = False
        while self._wait(deadline - self.clock()) and not self.all_done:
            if not self._begin_show():
                self._begin(Rest(settings), self._waiting.breaks)
            if self.clock() >= deadline:
                return

    def show_method(self, parts: MethodParts | None) -> None:
        """Ask for parts of the method of the frame on show; `method` has them a little later. None: for nothing."""
        self._parts = parts
        if parts is None:
            self.method = None
        elif self.is_idle and not self._waiting and self._begin_show():
            self._wait(0.010)  # s per frame for parts of the method

    def _begin_show(self) -> bool:
        """Begin to copy the parts of the method that are due; return False if none are."""
        parts, had = self._parts, self.method
        if parts is None:
            return False
        if had is not None and had.parts == parts and had.irradiance is self.snapshot.irradiance:
            return False
        self._begin(Show(parts))
        return True

    # -- moves ------------------------------------------------------------------------------------

    def move(self, poses: Mapping[str, Pose]) -> None:
        """Put mobiles at poses; a fast move is drawn in this frame, in its own light.

        The light has as many photons as fit the budget; settle() adds the others.
        """
        self._waiting.poses.update(poses)
        self._waiting.breaks.set()
        if self._waiting.begins:
            self._waiting.over.set()
        self.move_pending(self.grace)

    def dim(self, levels: Mapping[str, tuple[float, float, float]]) -> None:
        """Set levels of lamps; fast light is drawn in this frame."""
        self._waiting.levels = dict(levels)
        self._waiting.breaks.set()
        self.move_pending(self.grace)

    def begin_motion(self) -> None:
        """Let the next move choose its photons."""
        self._waiting.begins = True

    def settle(self) -> None:
        """Begin the frame of all photons at the poses on show, if the picture has fewer."""
        if self.partial and self.is_idle and not self._waiting:
            self._begin_move(self.snapshot.poses, settles=True)

    def move_pending(self, patience: float) -> None:
        """Begin the waiting moves, and the waiting levels; wait for them for at most `patience` [s]."""
        deadline, waiting = self.clock() + patience, self._waiting
        while waiting:
            if not self._wait(deadline - self.clock()):
                return
            waiting.breaks.clear()
            waiting.over.clear()
            if waiting.poses:
                poses, waiting.poses = waiting.poses, {}
                self._begin_move(poses, settles=False)
            else:
                levels, waiting.levels = waiting.levels, None
                self._begin(Dim(levels or {}, self.budget))
        if isinstance(self._job, Move | Dim):
            self._wait(deadline - self.clock())

    def _begin_move(self, poses: Mapping[str, Pose], settles: bool) -> None:
        self.move_failed = False
        waiting = self._waiting
        begins, waiting.begins = waiting.begins and not settles, waiting.begins and settles
        stop = waiting.breaks if settles else waiting.over
        # Undo repeats by itself: it would break off the first frame of a motion again and again.
        self._begin(Move(poses, self.budget, begins, settles, self.clock), None if begins else stop)


def _steps(solver: Solver) -> Generator[Progress, None, None]:
    """Iterate over the solver's steps; the solver is first touched with the first step."""
    yield from solver.solve_steps()


def _timings(solver: Solver, seconds: float) -> Iterator[bool]:
    """Time frames within a budget [s], smallest first, by a twin: the frame on show stays.

    Each moves a mobile, to and fro: without a move, little is left to do.
    """
    twin, names = solver.twin(), list(solver.poses)
    sizes = solver.budget.to_time(seconds, twin.frame.subsets, twin.paths_at_rest > 0)
    for k, (photons, paths) in enumerate(sizes):
        name = names[k % len(names)]
        x, y, z = solver.poses[name].position
        # A move as in a quick drag, and never to the pose on show: its rays are traced.
        x += 0.005 * solver.scene_size * (1 + k // len(names) % 2)
        twin.move_all({name: twin.poses[name]._replace(position=(x, y, z))}, photons, paths)
        twin.budget = solver.budget  # from the second frame on: the first of a twin takes much longer
        yield True

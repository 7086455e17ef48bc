"""The solver beside the window: steps of refinement and moves in one thread, one at a time.

What the window draws is a snapshot: poses and the light that belongs to them change together, when a picture
or a move is complete. A frame waits for refinement as long as its budget allows, for a move as long as a
frame may take; what is not done by then goes on behind the picture. While something moves, its light may be that
of a prefix of the photons (gi_core/frames/frame_budget.py); once it rests, that of all.
"""

from __future__ import annotations

import enum
import functools
from collections.abc import Callable, Mapping, Set
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from app.session.log import WARNING, Log
from app.session.moving_average import Smoothed
from app.session.warnings import caveats
from app.worker import PATIENCE, Job, Task, Worker

if TYPE_CHECKING:  # the solver takes a second to import: that happens behind the window's first frames
    from gi_core.discs.contact.stale_receivers import ControlFacts
    from gi_core.scene import Pose
    from gi_core.solver import Changes, Progress, Solver

GRACE = 0.040  # s that a frame waits for a move: with the drawing it stays under 50 ms


class Timing(enum.Enum):
    """How far the timing of prefixes' frames is."""

    DUE = enum.auto()
    BEGUN = enum.auto()  # the solver's last frame may be of few photons
    DONE = enum.auto()


class Snapshot(NamedTuple):
    """What the panel tells of the picture; the solver itself may be at work on something else."""

    timings: dict[str, float]  # stage -> seconds, of the last move
    changes: Changes
    probes: dict[str, np.ndarray]  # name -> irradiance (3,)
    segments: int
    control: ControlFacts


class Solving:
    """Only this touches the solver once it is open; all its methods are the window's thread's."""

    def __init__(self, solver: Solver, log: Log, clock: Callable[[], float], worker: Worker) -> None:
        self.solver = solver
        self.log = log
        self.clock = clock
        self.version = 0  # of what is to be drawn
        self.progress: Progress | None = None  # the last step of the refinement under way
        self.gi_seconds = Smoothed()  # new poses in, irradiance out
        self.grace = GRACE  # s that a frame waits for a move
        self.budget = 0.0  # s that a frame may take while something moves; 0: all photons always
        self.steps_begun = 0
        self.move_failed = False  # the last one
        self._told: set[str] = set()  # caveats that the log has had
        self.snapshot: Snapshot
        self.poses_drawn: dict[str, Pose] = {}
        self.irradiance = np.zeros((0, 3))  # (R, 3) at those poses
        self.photons_shown = 0  # that it is made of ...
        self.photons_there = 0  # ... and that it will be made of at rest
        self.paths_shown = 0  # the same of what vertices of mobiles gather
        self._paths_there = 0
        self._worker = worker
        self._job: Job | None = None  # what the thread is doing
        self._take: Callable[[Job], object]  # what to do with its result
        self._steps = solver.solve_steps()  # what is still to be refined, None when nothing is
        self._timing = Timing.DUE
        self._moving: dict[str, Pose] = {}  # poses of the move under way
        self._pending: dict[str, Pose] = {}  # poses that wait for their turn
        self._begins = False  # a motion, with the next of them
        self._hasty = False  # these may be shown in the light of fewer photons
        self.at_rest: Callable[[Set[str]], Task | None] | None = None  # next task at rest, of jobs not given up
        self._given_up: set[str] = set()  # jobs at rest that have failed
        self._idle = False  # the thread is doing such work: nobody waits for it
        self._show()

    @property
    def busy(self) -> bool:
        at_work = self._job is not None and not self._idle
        return self._steps is not None or at_work or bool(self._pending) or self.partial

    @property
    def is_moving(self) -> bool:
        """A move is under way or waits: what is drawn is not yet where it shall be."""
        return bool(self._moving or self._pending)

    @property
    def partial(self) -> bool:
        """The picture is made of fewer photons or paths than there are at rest, and more is to come."""
        less = self.photons_shown < self.photons_there or self.paths_shown < self._paths_there
        return less and not self.move_failed

    @property
    def poses(self) -> dict[str, Pose]:
        """Where the mobiles are, or will be as soon as the thread gets there."""
        return {**self.poses_drawn, **self._moving, **self._pending}

    def configure(self, changes: Mapping[str, Any], patience: float) -> bool:
        """Change the solver's settings; False if it is busy for longer than one's patience. Raises what it raises."""
        if not self._wait(patience):
            return False
        # The solver keeps the old picture until the new one is as good.
        self.solver.configure(**changes)
        self._steps = self.solver.solve_steps()
        self._timing = Timing.DUE
        return True

    def close(self, patience: float = PATIENCE) -> None:
        """Stop after what is under way, which is waited for so long [s]."""
        self._steps = None
        self._wait(patience)
        self._worker.close()
        self._job = self._take = self.at_rest = None  # rings, that would keep the scene in memory

    def refine(self, budget: float, still: bool = False) -> None:
        """Wait for steps until the budget is spent; the one under way then goes on behind the picture.

        `still`: nothing at all moves in the window, so that there is time for what is done at rest.
        """
        deadline = self.clock() + budget
        while self._steps is not None and not self._pending:
            if self._job is None:
                self._begin(functools.partial(next, self._steps, None), self._take_step)
                self.steps_begun += 1
            if not self._wait(deadline - self.clock()):
                break
        if self._steps is None and not self._pending and self._wait(deadline - self.clock()) and not self.partial:
            if not self._time_prefixes() and still:
                self._rest(deadline)

    def _time_prefixes(self) -> bool:
        """Have the frame of each prefix timed, smallest first, so that the first drag knows which one fits.

        False if that has been done. Nothing of it is shown. One frame is one job: a drag that begins now waits for
        no more than that.
        """
        if self._timing is Timing.DONE or not self.poses_drawn or self.budget <= 0:
            return False
        solver = self.solver
        photons = solver.budget.next_to_time(self.budget, solver.prefixes)
        if photons is None:  # what the solver shows is of all photons again, if it was not
            last, self._timing = self._timing, Timing.DONE
            if last is Timing.DUE:
                return False
            size: tuple = ()
        else:
            self._timing = Timing.BEGUN
            size = photons, solver.size_within(0.0)[1]
        self._begin(functools.partial(solver.move_all, {}, *size), self._take_time)
        return True

    def _take_time(self, job: Job) -> None:
        try:
            job.result()
        except Exception as problem:
            self._timing = Timing.DONE
            self.log.error("timing", problem)

    def _rest(self, deadline: float) -> None:
        """Do the work of one who has time, piece by piece; it shows nothing by itself."""
        while self.at_rest is not None and self._wait(deadline - self.clock()):
            if (task := self.at_rest(self._given_up)) is None:
                return
            self._begin(task.run, functools.partial(self._take_rest, task.name), idle=True)
            if self.clock() >= deadline:
                return

    def _take_rest(self, name: str, job: Job) -> None:
        """Take over a task; a failed one ends its own job alone, until the scene is loaded again."""
        try:
            if job.result():
                self._show(moved=False)
        except Exception as problem:
            self._given_up.add(name)
            self.log.failure(f"{name} has failed and stops until F5", problem)

    def _begin(self, call: Callable, take: Callable[[Job], object], idle: bool = False) -> None:
        self._job, self._take, self._idle = self._worker.submit(call), take, idle

    def _wait(self, seconds: float) -> bool:
        """Wait so long for what is under way, and take it over; True when nothing is under way any more."""
        if self._job is None:
            return True
        if not self._job.wait(seconds):
            return False
        job, self._job, self._idle = self._job, None, False
        self._take(job)
        return True

    def _take_step(self, job: Job) -> None:
        try:
            self.progress = job.result()
        except Exception as problem:
            self._steps = self.progress = None
            self.log.error("refining", problem)
            return
        if self.progress is None:
            self._steps = None
            for what, text in caveats(self.solver).items():
                if what not in self._told:
                    self._told.add(what)
                    self.log(text, WARNING)
        elif self.progress.picture:
            self._show()

    def _show(self, moved: bool = True) -> None:
        """Let the window draw what the solver has now; what it took is told of moves."""
        # The solver replaces its array with each picture and never writes into it: keeping it is free.
        self.poses_drawn, self.irradiance = dict(self.solver.poses), self.solver.irradiance
        self.photons_shown = self.solver.photons_traced
        self.photons_there = max(self.solver.prefixes, default=self.photons_shown)
        self.paths_shown, self._paths_there = self.solver.paths_gathered, self.solver.paths_at_rest
        s = self.solver
        timings = s.timings if moved else self.snapshot.timings
        self.snapshot = Snapshot(timings, s.changes, s.probe_irradiance, s.segments_total, s.control_facts)
        self.version += 1

    def move(self, poses: Mapping[str, Pose], hasty: bool = False) -> None:
        """Put mobiles at poses; unless it takes too long, they are drawn there in this frame, in their light.

        `hasty`: in that of as many photons as fit the budget; settle() then brings the rest.
        """
        self._pending.update(poses)
        self._hasty = hasty
        if self._timing is Timing.BEGUN:
            self._timing = Timing.DONE
        self.move_pending(self.grace)

    def begin_motion(self) -> None:
        """Let the next hasty move choose its photons."""
        self._begins = True

    def settle(self) -> None:
        """Begin to compute the light of all photons where the mobiles are, if the picture shows fewer."""
        if self.partial and self._job is None and not self._pending:
            self._moving = dict(self.poses_drawn)
            self._begin_move(hasty=False, take=functools.partial(self._take_move, moved=False))

    def move_pending(self, patience: float) -> None:
        """Make the moves that wait, as far as one's patience [s] goes."""
        deadline = self.clock() + patience
        while self._pending:
            if not self._wait(deadline - self.clock()):
                return
            self._moving, self._pending = self._pending, {}
            self._begin_move(self._hasty, self._take_move)
        if self._moving:
            self._wait(deadline - self.clock())

    def _begin_move(self, hasty: bool, take: Callable[[Job], None]) -> None:
        self.move_failed = False
        begins, self._begins = self._begins and hasty, self._begins and not hasty
        self._begin(functools.partial(self._timed_move, self._moving, hasty, begins), take)

    def _timed_move(self, poses: Mapping[str, Pose], hasty: bool, begins: bool) -> float:
        solver = self.solver
        size: tuple[int | None, int | None] = None, None
        if begins:
            solver.budget.begin()
        if hasty:
            size = solver.budget.choose(self.budget, solver.prefixes, solver.paths_at_rest > 0)
        started = self.clock()
        solver.move_all(poses, *size)
        seconds = self.clock() - started
        if hasty:
            solver.budget.moved(seconds)
        return seconds

    def _take_move(self, job: Job, moved: bool = True) -> None:
        self._moving = {}
        try:
            seconds = job.result()
        except Exception as problem:
            self.move_failed = True
            self.log.error("moving", problem)
            return
        if moved:
            self.gi_seconds.add(seconds)
        self._show(moved)
        # The iterator may have been left between two steps: begin a new one, nothing is traced twice.
        self._steps = self.solver.solve_steps()

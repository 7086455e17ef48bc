"""Jobs of the solver's thread: refine, move, time, rest.

`run` is called on the solver's thread with the solver; `taken` or `failed` on the window's thread with the result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from app.session.log import WARNING
from app.session.snapshot import Snapshot, snapshot_of
from app.session.warnings import caveats
from app.worker import Task

if TYPE_CHECKING:
    from app.session.solver_thread import Solving
    from gi_core.scene import Pose
    from gi_core.solver import Progress, Solver


@dataclass(frozen=True)
class Idle:
    """No job is under way."""

    busy: ClassVar[bool] = False


class Step(NamedTuple):
    """Result of `Refine`."""

    progress: Progress | None  # None: all is refined
    snapshot: Snapshot | None  # None: the picture is as it was
    warnings: dict[str, str]


@dataclass(frozen=True)
class Refine:
    """The next step of the first frame."""

    steps: Iterator[Progress]
    busy: ClassVar[bool] = True

    def run(self, solver: Solver) -> Step:
        progress = next(self.steps, None)
        if progress is None:
            return Step(None, None, caveats(solver))
        return Step(progress, snapshot_of(solver) if progress.picture else None, {})

    def taken(self, light: Solving, step: Step) -> None:
        light.progress = step.progress
        if step.progress is None:
            light.end_refinement()
        if step.snapshot is not None:
            light.show(step.snapshot)
        for kind, text in step.warnings.items():
            if kind not in light.warned:
                light.warned.add(kind)
                light.log(text, WARNING)

    def failed(self, light: Solving, problem: Exception) -> None:
        light.end_refinement()
        light.log.error("refining", problem)


@dataclass(frozen=True)
class Move:
    """Mobiles put at poses, in the light of all photons or of as many as fit the budget."""

    poses: Mapping[str, Pose]
    budget: float  # [s]
    hasty: bool  # as many photons as fit the budget
    begins: bool  # the first of a motion, which chooses the photons
    settles: bool  # the poses are those on show: more photons are all that is new
    clock: Callable[[], float]
    busy: ClassVar[bool] = True

    def run(self, solver: Solver) -> tuple[float, Snapshot]:
        size: tuple[int | None, int | None] = None, None
        if self.begins:
            solver.budget.begin()
        if self.hasty:
            size = solver.budget.choose(self.budget, solver.prefixes, solver.paths_at_rest > 0)
        started = self.clock()
        solver.move_all(self.poses, *size)
        seconds = self.clock() - started
        if self.hasty:
            solver.budget.moved(seconds)
        return seconds, snapshot_of(solver)

    def taken(self, light: Solving, result: tuple[float, Snapshot]) -> None:
        seconds, snapshot = result
        if self.settles:
            light.show(snapshot, light.snapshot.timings)
        else:
            light.gi_seconds.add(seconds)
            light.show(snapshot)
        light.begin_refinement()

    def failed(self, light: Solving, problem: Exception) -> None:
        light.move_failed = True
        light.log.error("moving", problem)


@dataclass(frozen=True)
class Time:
    """The frame of the next prefix timed, smallest first, so that the first drag knows which one fits.

    Nothing of it is shown. The last one is of all photons again.
    """

    budget: float  # [s]
    begun: bool  # the solver's last frame may be of few photons
    busy: ClassVar[bool] = True

    def run(self, solver: Solver) -> bool:
        """Return whether there are more prefixes to time."""
        photons = solver.budget.next_to_time(self.budget, solver.prefixes)
        if photons is not None:
            solver.move_all({}, photons, solver.size_within(0.0)[1])
        elif self.begun:
            solver.move_all({})
        return photons is not None

    def taken(self, light: Solving, more: bool) -> None:
        light.time_next(more)

    def failed(self, light: Solving, problem: Exception) -> None:
        light.time_next(False)
        light.log.error("timing", problem)


class Piece(NamedTuple):
    """Result of `Rest`."""

    name: str  # of the task; "": none is left
    snapshot: Snapshot | None = None  # None: the picture is as it was
    problem: Exception | None = None


@dataclass(frozen=True)
class Rest:
    """One short task while nothing moves; a drag waits for no more than that."""

    next_task: Callable[[Set[str]], Task | None]
    given_up: Set[str]
    busy: ClassVar[bool] = False

    def run(self, solver: Solver) -> Piece:
        task = self.next_task(self.given_up)
        if task is None:
            return Piece("")
        try:
            return Piece(task.name, snapshot_of(solver) if task.run() else None)
        except Exception as problem:
            return Piece(task.name, problem=problem)

    def taken(self, light: Solving, piece: Piece) -> None:
        """Show new light; a failed task ends its own kind alone, until the scene is loaded again."""
        light.all_done = not piece.name
        if piece.problem is not None:
            light.given_up.add(piece.name)
            light.log.failure(f"{piece.name} has failed and stops until F5", piece.problem)
        elif piece.snapshot is not None:
            light.show(piece.snapshot, light.snapshot.timings)

    def failed(self, light: Solving, problem: Exception) -> None:
        light.all_done = True
        light.log.failure("resting", problem)


Job = Refine | Move | Time | Rest

"""Jobs of the solver's thread: refine, move, dim, time, rest, show; and the snapshot that they leave.

`run` is called on the solver's thread; the window's thread receives its result (`solver_thread.py`). The snapshot has
all that the window reads of a solver.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from app.cli.progress import warnings_of
from app.rest.results import RestResults
from app.rest.scheduler import RestWork, TaskEnd
from app.session.method_view import MethodParts, MethodView, method_view
from app.settings import Settings
from gi_core.base.pause import Progress
from gi_core.discs.stale_receivers import ControlFacts
from gi_core.display.dilation import Drawn
from gi_core.estimators.base import Setting
from gi_core.frames.frame import Changes
from gi_core.gather.estimate import Source
from gi_core.gloss.light import GlossLight
from gi_core.scene import Pose
from gi_core.solver import Solver


class Snapshot(NamedTuple):
    """Poses and the light that belongs to them. The arrays are never written to again."""

    poses: dict[str, Pose]
    irradiance: np.ndarray  # (R, 3) [W/m2]
    drawn: Drawn  # the same for pictures, with dilation weights
    gloss: GlossLight | None  # directions of the light at glossy receivers; None: there are none
    deviation: np.ndarray | None  # (R,) [W/m2], as of Solver.deviation; None in motion
    source: Source  # of the light of the static part; photons change it
    photons: int
    photons_at_rest: int
    paths: int  # per receiver of mobiles
    paths_at_rest: int
    setting: Setting
    timings: Mapping[str, float]  # stage -> seconds, of the last move
    changes: Changes
    levels: np.ndarray  # (G, 3), of the lamps
    effective_photons: int  # of `photons`
    probes: dict[str, np.ndarray]  # name -> irradiance (3,)
    segments: int
    control: ControlFacts
    search_summary: str
    rest: RestResults

    @property
    def partial(self) -> bool:
        """Whether the frame has fewer photons or paths than at rest."""
        fewer = self.photons < self.photons_at_rest or self.paths < self.paths_at_rest
        return self.photons > 0 and fewer  # before the first frame a move changes nothing


def snapshot_of(s: Solver, work: RestWork) -> Snapshot:
    """Return the snapshot of a solver's frame; call it on the solver's thread."""
    return Snapshot(
        poses=dict(s.poses),
        irradiance=s.irradiance,
        drawn=s.drawn(s.irradiance),
        gloss=s.frame.gloss,
        deviation=None if s.frame.photons < max(s.frame.subsets, default=0) else s.deviation,
        source=s.frame_light.source,
        photons=s.frame.photons,
        photons_at_rest=max(s.frame.subsets, default=s.frame.photons),
        paths=s.frame.paths,
        paths_at_rest=s.paths_at_rest,
        setting=s.setting,
        timings=s.frame.timings,
        changes=s.frame.changes,
        levels=s.frame.levels,
        effective_photons=s.frame.effective_photons,
        probes=s.frame.probe_irradiance,
        segments=s.frame.segments,
        control=s.frame.control_facts,
        search_summary=s.frame.search_summary,
        rest=work.results(),
    )


class Step(NamedTuple):
    """Result of `Refine`."""

    progress: Progress | None  # None: all is refined
    snapshot: Snapshot | None  # None: the picture is as it was
    warnings: dict[str, str]
    urgent: TaskEnd
    rest: RestResults | None  # None: as they were


@dataclass(frozen=True)
class Refine:
    """Run the next step of the first frame, and urgent work as long."""

    steps: Iterator[Progress]
    rest: Settings | None  # None: no work at rest
    name: ClassVar[str] = "refining"

    def run(self, solver: Solver, work: RestWork) -> Step:
        began = time.perf_counter()
        progress = next(self.steps, None)
        until = 2 * time.perf_counter() - began
        urgent = work.run(None if self.rest is None else work.next_urgent(self.rest))
        while urgent.name and not urgent.changed and time.perf_counter() < until:
            if (task := work.next_urgent(self.rest)) is None:
                break
            urgent = work.run(task)
        rest, changed = work.results() if urgent.name else None, urgent.changed
        if progress is None:
            return Step(None, snapshot_of(solver, work) if changed else None, warnings_of(solver), urgent, rest)
        return Step(progress, snapshot_of(solver, work) if progress.picture or changed else None, {}, urgent, rest)


class Moved(NamedTuple):
    """Result of `Move` and of `Dim`."""

    seconds: float | None  # of a move; None: mobiles are where they were
    snapshot: Snapshot


@dataclass(frozen=True)
class Move:
    """Put mobiles at poses, in the light of as many photons as fit the budget, or settle there."""

    poses: Mapping[str, Pose]
    budget: float  # [s]
    begins: bool  # the first of a motion, which chooses the photons
    settles: bool  # the poses are those on show; the frame has all photons
    clock: Callable[[], float]
    name: ClassVar[str] = "moving"

    def run(self, solver: Solver, work: RestWork) -> Moved:
        if self.settles:
            solver.move_all(self.poses)
            return Moved(None, snapshot_of(solver, work))
        if self.begins:
            solver.budget.begin()
        size = solver.budget.choose(self.budget, solver.frame.subsets, solver.paths_at_rest > 0)
        started = self.clock()
        solver.move_all(self.poses, *size)
        seconds = self.clock() - started
        solver.budget.moved(seconds)
        return Moved(seconds, snapshot_of(solver, work))


@dataclass(frozen=True)
class Dim:
    """Set the levels of lamps, in the light of all photons, and of as many paths to mobiles as fit the budget."""

    levels: Mapping[str, tuple[float, float, float]]
    budget: float  # [s]; 0: all paths
    name: ClassVar[str] = "dimming"

    def run(self, solver: Solver, work: RestWork) -> Moved:
        solver.set_lamps(self.levels, solver.size_within(self.budget)[1] if self.budget > 0 else None)
        return Moved(None, snapshot_of(solver, work))


@dataclass(frozen=True)
class Time:
    """Measure the frame time of the next photon subset, so that the first drag knows which subset fits the budget."""

    steps: Iterator[bool]
    name: ClassVar[str] = "timing"

    def run(self, solver: Solver, work: RestWork) -> bool:
        """Return whether there may be more subsets to time."""
        return next(self.steps, False)


class Rested(NamedTuple):
    """Result of `Rest`."""

    end: TaskEnd
    rest: RestResults
    snapshot: Snapshot | None  # None: the light is as it was


@dataclass(frozen=True)
class Rest:
    """Run one short task while nothing moves; a drag waits for at most one."""

    settings: Settings
    name: ClassVar[str] = "resting"

    def run(self, solver: Solver, work: RestWork) -> Rested:
        """Return the results."""
        end = work.run(work.next_task(self.settings))
        return Rested(end, work.results(), snapshot_of(solver, work) if end.changed else None)


@dataclass(frozen=True)
class Show:
    """Copy parts of the method from the last frame, to be drawn."""

    parts: MethodParts
    name: ClassVar[str] = "showing the method"

    def run(self, solver: Solver, work: RestWork) -> MethodView:
        return method_view(solver, self.parts)


Job = Refine | Move | Dim | Time | Rest | Show

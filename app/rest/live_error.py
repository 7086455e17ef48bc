"""Error of the current light, measured at rest: frame time, noise, reference, comparison with another estimator.

`next_task` returns one short task at a time for the solver's thread; a drag waits for at most one task. Results belong
to a version of the light. References belong to poses; the last REMEMBERED_POSES are kept.
"""

from __future__ import annotations

import functools
import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.rest.comparison import ComparisonJob
from app.rest.measured_points import MeasuredPoint, MeasuredPoints
from app.rest.reference_job import Truth
from app.worker import Task
from gi_core.geometry.error import bias_left, noise_from_prefix, prefix_to_compare, relative_error

if TYPE_CHECKING:
    from gi_core.estimators.setting import Setting
    from gi_core.scene import Pose
    from gi_core.solver import Solver

SAMPLED_RECEIVERS = 1000  # of a scene with more than MOST_RECEIVERS
MOST_RECEIVERS = 4000  # in a measurement of all
NOISE_OF_ERROR = 0.15  # largest final noise of the reference, as a share of the error ...
LEAST_NOISE = 0.003  # ... or this, if larger
PICTURE_NOISE = 0.01  # final noise of the reference as a picture
FIRST_NOISE = 0.04  # noise of the reference before other work gets its turn
TIMED_FRAMES = 3  # per setting; their median counts
REMEMBERED_POSES = 3  # with a reference


class Wants(NamedTuple):
    """Parts that the window needs."""

    numbers: bool = True  # the report
    picture: bool = False  # the reference, or errors, at every receiver
    other: str = ""  # an estimator to compare with


class Report(NamedTuple):
    """The error of one version of the light, relative l1; nan: unknown."""

    version: object
    total: float
    noise: float
    bias: float
    reference_noise: float  # of the reference
    receivers: int  # in the measurement
    of: int  # receivers in all
    paths: float  # of the reference, per receiver
    done: bool  # the reference has little enough noise


@dataclass
class Measured:
    """Measurements of one version of the light that need no reference."""

    version: object
    setting: Setting
    twin: Solver | None  # None after the last measurement
    seconds: list[float]  # of frames of all photons
    photons: int = 0
    prefix: int = 0  # photons of the subset behind the noise; 0: none
    fewer: np.ndarray | None = None  # (R, 3) irradiance of the subset


class LiveError:
    """One per solver. The window sets `wants`; all else runs in the solver's thread."""

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        self.wants = Wants()
        self.points = MeasuredPoints()
        self.other = ComparisonJob(solver)
        self.report: Report | None = None
        self._solver, self._clock = solver, clock
        self._measured: Measured | None = None
        self._truths: dict[tuple, Truth] = {}  # newest last
        self._areas = solver.model.object_receivers.areas

    # The window's side ------------------------------------------------------------------------------

    def truth(self, poses: Mapping[str, Pose], everywhere: bool) -> Truth | None:
        """Return the reference at these poses: at all receivers, or at those of the report."""
        return self._truths.get(self._key(poses, everywhere))

    def picture(self, poses: Mapping[str, Pose]) -> np.ndarray | None:
        """Return the reference at all receivers (R, 3), nan where unknown; None before the first step."""
        truth = self.truth(poses, True)
        if truth is None:
            return None
        E = np.full((len(self._areas), 3), np.nan)
        E[truth.rows] = truth.irradiance
        return E

    def progress(self, version: object, poses: Mapping[str, Pose]) -> tuple:
        """Return a value that changes with the visible result; rounds count in powers of two."""
        truth = self.truth(poses, True) if self.wants.picture else None
        other = self.wants.other and self.other.is_done(version, self.wants.other)
        return bool(other), None if truth is None else truth.look

    def next_task(self, version: object, irradiance: np.ndarray, given_up: Set[str] = frozenset()) -> Task | None:
        """Return the next task for a version of the light, among jobs not given up; None at the end."""
        if not self.wants.other and self.other.seen is not None:
            self.other.drop()
        due = (task for task in self._due(version, irradiance) if task.name not in given_up)
        return next(due, None)

    def _due(self, version: object, irradiance: np.ndarray) -> Iterator[Task]:
        """Iterate over the next task of each due job, the most urgent first."""
        wants, poses = self.wants, self._solver.poses
        m = self._measured
        if wants.numbers and (not self._measures(version) or m.twin is not None):
            yield Task("timing frames", functools.partial(self._measure, version))
        if wants.other and not self.other.is_done(version, wants.other):
            name = f"computing {wants.other.replace('_', ' ')}"
            yield Task(name, functools.partial(self.other.step, version, wants.other))
        some, everywhere = self.truth(poses, False), self.truth(poses, True)
        reported = self.report is not None and self.report.version == version
        picture_due = wants.picture and (everywhere is None or everywhere.noise > PICTURE_NOISE)
        numbers_due = wants.numbers and not (reported and self.report.done)
        at_some, at_all = (functools.partial(self._gather, version, irradiance, every) for every in (False, True))
        of_numbers = Task("gathering the reference" if self._few else "gathering the reference for the error", at_some)
        if numbers_due and (not reported or some is None or some.noise > FIRST_NOISE):
            yield of_numbers
        if picture_due:
            yield Task("gathering the reference", at_all)
        if numbers_due:
            yield of_numbers

    # The solver's thread ----------------------------------------------------------------------------

    def _key(self, poses: Mapping[str, Pose], everywhere: bool) -> tuple:
        return tuple(sorted(poses.items())), everywhere or self._few

    @property
    def _few(self) -> bool:
        return int((self._areas > 0).sum()) <= MOST_RECEIVERS

    def _measure(self, version: object) -> None:
        """Time a frame of all photons TIMED_FRAMES times, then compute one of a subset, one frame per call."""
        m = self._measured
        if not self._measures(version):
            m = self._measured = Measured(version, self._solver.setting, self._solver.twin(), [])
            if not m.twin.uses_gathered:  # then photons light mobiles too
                m.twin.configure(prefix_only=True)
        if len(m.seconds) < TIMED_FRAMES:
            started = self._clock()
            m.twin.move_all({})
            m.seconds.append(self._clock() - started)
            m.photons = m.twin.photons_traced
            return
        m.prefix = prefix_to_compare(m.twin.prefixes) or 0
        if m.prefix:
            m.fewer = self._of_fewer(m)
        m.twin = None

    def _of_fewer(self, m: Measured) -> np.ndarray:
        """Return the irradiance (R, 3) of a subset; differences on path-traced mobiles are scaled to its variance."""
        twin = m.twin
        if not twin.paths_gathered:
            twin.move_all({}, m.prefix)
            return twin.irradiance
        E = twin.irradiance
        twin.move_all({}, m.prefix, twin.paths_at_rest // 2)
        fewer, mobile = twin.irradiance, slice(twin.surfaces.receiver_range(0).stop, None)
        # Half the paths are independent paths: variances v and 2 v add up. A subset's difference has v (N / n - 1).
        fewer[mobile] = E[mobile] + (fewer[mobile] - E[mobile]) * math.sqrt((m.photons / m.prefix - 1) / 3)
        return fewer

    def _gather(self, version: object, irradiance: np.ndarray, everywhere: bool) -> None:
        """Trace a step of the reference and update the report."""
        from gi_core.gather.reference_sample import draw_by_area

        key = self._key(self._solver.poses, everywhere)
        truth = self._truths.get(key)
        if truth is None:
            rows = np.flatnonzero(self._areas > 0)
            rows, weights = (
                (rows, self._areas[rows]) if key[1] else draw_by_area(rows, self._areas, SAMPLED_RECEIVERS, 0)
            )
            truth = Truth(self._solver, self._solver.poses, rows, weights, even=everywhere and not self._few)
        others = {k: t for k, t in self._truths.items() if k != key}
        self._truths = dict([*others.items(), (key, truth)][-REMEMBERED_POSES:])  # the window reads it meanwhile
        before = truth.look
        truth.step()
        if key[1] and (truth.drawn is None or truth.look != before):
            poses = self._solver.poses
            truth.drawn = self._solver.as_drawn(self.picture(poses), poses)
        if truth.rounds.bit_count() == 1 and truth.seen == 1:  # 1, 2, 4, ... rounds
            truth.keep()
        if truth.noise != float("inf") and (self._few or not everywhere):  # nan: there is no light
            self._report(version, irradiance, truth)

    def _report(self, version: object, irradiance: np.ndarray, truth: Truth) -> None:
        m, rows, w = self._measured, truth.rows, truth.weights
        total = relative_error(irradiance[rows], truth.irradiance, w).l1
        noise = float("nan")
        if m is not None and m.version == version and m.prefix:
            others = self._noise_of_gathered(rows)
            noise = noise_from_prefix(irradiance[rows], m.fewer[rows], m.photons, m.prefix, w, others)
        done = not truth.noise > max(LEAST_NOISE, NOISE_OF_ERROR * total)
        if done:
            truth.keep()
        of = int((self._areas > 0).sum())
        bias = bias_left(total, noise, truth.noise)
        self.report = Report(version, total, noise, bias, truth.noise, len(rows), of, truth.paths, done)
        if m is not None and m.version == version and m.seconds and total == total:
            self._note()

    def _measures(self, version: object) -> bool:
        m = self._measured
        return m is not None and m.version == version

    def _note(self) -> None:
        """Add the current setting to the points of the chart."""
        m, r = self._measured, self.report
        self.points.add(MeasuredPoint(m.setting, m.photons, statistics.median(m.seconds), r.total, r.reference_noise))

    def _noise_of_gathered(self, rows: np.ndarray) -> np.ndarray:
        """Return the standard error (n,) of luminance at receivers with gathered light, 0 at others."""
        out = np.zeros(len(rows))
        if self._solver.uses_gathered:
            known = self._solver.gathered.deviation
            static = rows < len(known)
            out[static] = known[rows[static]]
        return out

"""Error of the current light, measured at rest: frame time, noise, reference.

Results belong to the solver's irradiance and are dropped when it changes. A reference belongs to poses, to all or
sampled receivers, and to levels of lamps; the last three are kept. Errors count by importance
(`gi_core.gather.importance`).
"""

from __future__ import annotations

import functools
import math
import statistics
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from app.rest.jobs import Job
from app.rest.reference_store import ReferenceStore
from app.rest.results import MeasuredPoint, ReferencePicture, Report
from app.settings import Settings
from app.worker import Task
from gi_core.gather.importance import areas_in_reach, visual_shares
from gi_core.gather.reference_sample import draw_by_area
from gi_core.geometry.error import (
    CLOUD_REACH,
    bias_left,
    local_deviation,
    luminance,
    noise_from_subset,
    subset_to_compare,
)
from gi_core.scene import Pose
from gi_core.solver import Solver

SAMPLED_RECEIVERS = 1000  # of a scene with more than FEW_RECEIVERS
FEW_RECEIVERS = 4000  # in a measurement of all
NOISE_OF_ERROR = 0.15  # largest final noise of the reference, as a share of the error ...
FINAL_NOISE = 0.003  # ... or this, if larger
STATED = 0.7  # the same, from which on the error is stated
PICTURE_NOISE = 0.01  # final noise of the reference as a picture


@dataclass
class Measured:
    """Measurements of the light that need no reference."""

    twin: Solver | None = None  # None before the first measurement and after the last
    seconds: list[float] = field(default_factory=list)  # of frames of all photons
    photons: int = 0
    subset: int = 0  # photons of the subset behind the noise; 0: none
    fewer: np.ndarray | None = None  # (R, 3) irradiance of the subset


def _frames(solver: Solver, m: Measured, clock: Callable[[], float]) -> Iterator[bool]:
    """Time frames of all photons, then compute one of a subset: a frame per step, from the first that `m` lacks."""
    if m.twin is None:
        m.twin = solver.twin()
        if solver.light == "photons":  # then they light mobiles too
            m.twin.configure(subset_only=True)
    twin = m.twin
    while len(m.seconds) < 3:  # their median counts
        started = clock()
        twin.move_all({})
        m.seconds.append(clock() - started)
        m.photons = twin.frame.photons
        yield True
    m.subset = subset_to_compare(twin.frame.subsets) or 0
    if m.subset:
        m.fewer = _of_fewer(m, twin)
    m.twin = None


def _of_fewer(m: Measured, twin: Solver) -> np.ndarray:
    """Return the irradiance (R, 3) of a subset; differences on path-traced mobiles are scaled to its variance."""
    if not twin.frame.paths:
        twin.move_all({}, m.subset)
        return twin.irradiance
    E = twin.irradiance
    twin.move_all({}, m.subset, twin.paths_at_rest // 2)
    fewer, mobile = twin.irradiance, slice(twin.surfaces.receiver_range(0).stop, None)
    # Half the paths are independent paths: variances v and 2 v add up. A subset's difference has v (N / n - 1).
    fewer[mobile] = E[mobile] + (fewer[mobile] - E[mobile]) * math.sqrt((m.photons / m.subset - 1) / 3)
    return fewer


class ReferenceJob:
    """The reference of some receivers; only the solver's thread uses it."""

    def __init__(
        self, solver: Solver, poses: Mapping[str, Pose], rows: np.ndarray, need: np.ndarray, weights: np.ndarray,
        even: bool = False,
    ) -> None:  # fmt: skip
        """Errors and noise count receivers rows (n,) by `weights` (n,).

        `even`: equal path counts per receiver, for a picture; else counts that minimise the total error by `need` (n,).
        """
        self.rows, self.weights = rows, weights
        self.picture: ReferencePicture | None = None  # None before the first step
        self._store = ReferenceStore(solver.model, poses, rows, weights=need, levels=solver.levels)
        self._is_kept = dict(poses) == solver.model.start_poses() and bool((solver.levels == 1).all())
        self._gathered = self._store.rounds(even, self._is_kept)
        self._saved = self.rounds
        self.noise = self._gathered.state.noise(self.weights)  # relative, l1

    def step(self) -> None:
        self._gathered.step()
        self.noise = self._gathered.state.noise(self.weights)

    def keep(self) -> None:
        """Save the state at the scene's start poses."""
        if self._is_kept and self.rounds > self._saved:
            self._store.keep(self._gathered.state)
            self._saved = self.rounds

    @property
    def irradiance(self) -> np.ndarray:
        """Irradiance (n, 3) [W/m2], nan where unknown."""
        state = self._gathered.state
        return np.where(state.sets[:, None] > 0, state.mean, np.nan)

    @property
    def deviation(self) -> np.ndarray:
        """Standard error (n,) [W/m2] of the luminance."""
        return luminance(self._gathered.state.standard_error)

    def error(self, E: np.ndarray) -> float:
        """Return the relative l1 error of irradiance E (R, 3) [W/m2] without the noise of the reference."""
        return self._gathered.state.error(E[self.rows], self.weights)

    @property
    def seen(self) -> float:
        """Share of receivers with at least one round, 0 .. 1."""
        return np.count_nonzero(self._gathered.state.sets) / max(len(self.rows), 1)

    @property
    def paths(self) -> float:
        """Paths per receiver, on average."""
        return float(self._gathered.state.paths.mean())

    @property
    def look(self) -> tuple[int, int]:
        """A pair that changes when the result changes visibly: at powers of two of the rounds."""
        return self.rounds.bit_length(), int(16 * self.seen)

    @property
    def rounds(self) -> int:
        """Rounds that every receiver has had."""
        return self._gathered.state.rounds


class LiveError(Job):
    """Its own steps time frames; references follow."""

    name = "timing frames"

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        super().__init__(solver)
        self.report: Report | None = None
        self.point: MeasuredPoint | None = None  # of the chart
        self._clock, self._settings = clock, Settings()
        self.light: np.ndarray | None = None  # irradiance that the results belong to
        self._references: dict[tuple, ReferenceJob] = {}  # newest last
        self._areas = solver.model.object_receivers.areas
        self._few = int((self._areas > 0).sum()) <= FEW_RECEIVERS

    def key(self, settings: Settings) -> bool | None:
        return settings.measure_errors or None

    def begin(self) -> Iterator[bool]:
        return _frames(self._solver, self._measured, self._clock)

    def restart(self) -> None:
        super().restart()
        self._measured = Measured()

    def want(self, settings: Settings) -> None:
        if self.light is not self._solver.irradiance:  # results of an earlier light are dropped
            self.light = self._solver.irradiance
            self.report = self.point = None
            self.restart()
        self._settings = settings
        super().want(settings)

    def reference(self, poses: Mapping[str, Pose], everywhere: bool) -> ReferenceJob | None:
        """Return the reference at these poses: at all receivers, or at those of the report."""
        return self._references.get(self._reference_key(poses, everywhere))

    @property
    def picture(self) -> ReferencePicture | None:
        """The reference at all receivers and the current poses; None before the first step."""
        reference = self.reference(self._solver.poses, True)
        return None if reference is None else reference.picture

    def tasks(self) -> Iterator[Task]:
        poses, r = self._solver.poses, self.report
        sampled, everywhere = self.reference(poses, False), self.reference(poses, True)
        numbers = self._settings.measure_errors and not (r is not None and r.done)
        rough = r is None or sampled is None or sampled.noise > 0.04  # then other work gets its turn
        gathering, at_some = "gathering the reference", functools.partial(self._gather, False)
        of_numbers = Task(gathering if self._few else f"{gathering} for the error", at_some)
        yield from super().tasks()
        if numbers and rough:
            yield of_numbers
        if self._settings.needs_reference and (everywhere is None or everywhere.noise > PICTURE_NOISE):
            yield Task(gathering, functools.partial(self._gather, True))
        if numbers:
            yield of_numbers

    def keep(self) -> None:
        """Save the references at the scene's start poses."""
        for reference in self._references.values():
            reference.keep()

    def _reference_key(self, poses: Mapping[str, Pose], everywhere: bool) -> tuple:
        return tuple(sorted(poses.items())), everywhere or self._few, self._solver.levels.tobytes()

    def _gather(self, everywhere: bool) -> None:
        """Trace a step of the reference and update the report."""
        solver, key = self._solver, self._reference_key(self._solver.poses, everywhere)
        reference = self._references.pop(key, None)
        if reference is None:
            counted = areas_in_reach(solver.model)
            if key[1]:
                rows = np.flatnonzero(self._areas > 0)
                need, weights = self._areas[rows], counted[rows]
            else:
                rows, need = draw_by_area(np.flatnonzero(counted > 0), counted, SAMPLED_RECEIVERS, 0)
                weights = need
            weights = weights * visual_shares(solver.model, luminance(self.light), self._areas)[rows]
            reference = ReferenceJob(solver, solver.poses, rows, need, weights, even=everywhere and not self._few)
        self._references = dict([*self._references.items(), (key, reference)][-3:])
        before = reference.look
        reference.step()
        if key[1] and (reference.picture is None or reference.look != before):
            E = np.full((len(self._areas), 3), np.nan)
            E[reference.rows] = reference.irradiance
            drawn = solver.drawn(E, solver.poses)
            reference.picture = ReferencePicture(drawn, reference.noise, reference.paths, reference.seen)
        if reference.rounds.bit_count() == 1 and reference.seen == 1:  # 1, 2, 4, ... rounds
            reference.keep()
        if reference.noise != float("inf") and (self._few or not everywhere):  # nan: there is no light
            self._report(reference)

    def _report(self, reference: ReferenceJob) -> None:
        m, E, w = self._measured, self.light[reference.rows], reference.weights
        measured = reference.error(self.light)
        total = measured if reference.noise <= max(FINAL_NOISE, STATED * measured) else math.nan
        noise = float("nan")
        if m.subset:
            at = self._solver.model.transforms(self._solver.poses)
            deviation = self._solver.frame_light.deviation(at, self._solver.frame.background)[reference.rows]
            noise = noise_from_subset(E, m.fewer[reference.rows], m.photons, m.subset, w, deviation)
        done = not reference.noise > max(FINAL_NOISE, NOISE_OF_ERROR * measured)
        if done:
            reference.keep()
        of = int((self._areas > 0).sum())
        bias = bias_left(total, noise)
        clouds = self.report.clouds if self.report else (math.nan, math.nan)
        if done or reference.rounds.bit_count() == 1:  # measuring them takes 20 to 80 ms
            r = self._solver.receivers
            places = r.positions[reference.rows], r.normals[reference.rows], w
            reach = CLOUD_REACH * self._solver.scene_size
            clouds = local_deviation(E, reference.irradiance, places, reach, reference.deviation)
        self.report = Report(
            total, noise, bias, clouds, reference.noise, len(reference.rows), of, reference.paths, done
        )
        if m.seconds and total == total:
            seconds = statistics.median(m.seconds)
            self.point = MeasuredPoint(self._solver.setting, m.photons, seconds, total, reference.noise)

"""Settings of the chart measured on one scene: frame time along the path, error in each class; and the rival, path
tracing from every vertex in every frame, without photons.

All solvers are twins of one, so photons are traced once. A run measures settings family by family, and writes each to
the table. A family shares its limit at very many photons.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain, groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.cli.progress import Bar, time_left
from app.cli.version import commit
from app.draw import motion
from app.measure.chart import truth
from app.measure.chart.settings import (
    FULL,
    QUICK,
    RIVAL,
    Choice,
    Effort,
    choices,
    choices_like_the_report,
)
from app.measure.chart.truth import PoseTruth
from app.measure.results import Failure, attempted, load, processor, write_rows
from app.settings import STEP_PER_FRAME, Settings, make_solver
from gi_core.estimators import CHEAPEST, DEFAULT
from gi_core.gather.reference import Gatherer
from gi_core.geometry.error import local_deviation, luminance, relative_error, relative_noise
from gi_core.geometry.receiver_classes import CLASSES
from gi_core.geometry.surfaces import evaluation_points
from gi_core.scene import Scene
from gi_core.solver import Solver


class Walk(NamedTuple):
    """The frames of every setting."""

    lap: list  # poses of each frame
    cases: list[PoseTruth]


def go(
    solver: Solver, walk: Walk, photons: int | None = None, paths: int | None = None
) -> tuple[list[float], list[np.ndarray]]:
    """Move a solved solver along the walk; only the frame itself is timed.

    Return the time [ms] of each GI frame, and the light (n, 3) [W/m2] at the receivers of each case.
    """
    ms, by_frame = [], {}
    solver.move_all(walk.lap[-1], photons, paths)
    for k, poses in enumerate(walk.lap):
        started = time.perf_counter()
        solver.move_all(poses, photons, paths)
        ms.append(1e3 * (time.perf_counter() - started))
        for case in walk.cases:
            if case.frame == k:
                by_frame[k] = solver.irradiance[case.rows]
    return ms, [by_frame[c.frame] for c in walk.cases]


def at_cases(solver: Solver, walk: Walk, seconds: float = 0.0) -> list[np.ndarray]:
    """Return the irradiance (n, 3) of each case, gathered at its pose for so many CPU seconds."""
    out = []
    for case in walk.cases:
        solver.move_all(walk.lap[case.frame])
        started = time.process_time()
        for _ in solver.gather_pose_steps() if seconds else ():
            if time.process_time() - started > seconds:
                break
        out.append(solver.irradiance[case.rows])
    return out


def errors(light: list[np.ndarray], limit: list[np.ndarray] | None, cases: list[PoseTruth]) -> dict[str, float]:
    """Return noise, bias, total (l1), total (l2), the noise of the truth, and clouds.

    They are those of all receivers, and of each class. Clouds are means over the poses, of all receivers: median and
    90th percentile of `local_deviation`.
    """
    T, s, w, kind = (np.concatenate(a) for a in zip(*(c[4:6] + (c.weights, c.kind) for c in cases), strict=True))
    E, end = (None if of is None else np.concatenate(of) for of in (light, limit))
    out: dict[str, float] = {}
    for name in ("all", *CLASSES):
        of = slice(None) if name == "all" else kind == CLASSES.index(name)
        out |= _errors(name, E[of], None if end is None else end[of], T[of], s[of], w[of])
    clouds = [
        local_deviation(seen, case.truth, (*case.places, case.weights), 1.0, luminance(case.standard_error))
        for seen, case in zip(light, cases, strict=True)
    ]
    out["clouds"], out["clouds 90"] = np.mean(clouds, axis=0).tolist()
    return out


def _errors(name: str, light, end, T: np.ndarray, s: np.ndarray, w: np.ndarray) -> dict[str, float]:
    total = relative_error(light, T, w)
    return {
        f"noise {name}": float("nan") if end is None else relative_error(light, end, w).l1,
        f"bias {name}": float("nan") if end is None else relative_error(end, T, w).l1,
        f"total {name}": total.l1,
        f"total l2 {name}": total.l2,
        f"truth {name}": relative_noise(luminance(s), T, w),
        f"points {name}": len(w),
    }


def rival_light(solver: Solver, walk: Walk, paths: int, seed: int) -> list[np.ndarray]:
    """Return the irradiance (n, 3) of each case from a number of paths per receiver."""
    out = []
    for case in walk.cases:
        gatherer = _gatherer(solver, walk.lap[case.frame], seed ^ 0x417A1)  # the truth has other paths
        out.append(gatherer.paths(case.rows, 0, paths).mean(axis=1))
    return out


def rival_times(solver: Solver, walk: Walk, paths: int) -> dict[str, float]:
    """Return the time [ms] of a frame with paths from every vertex; times over four paths are scaled.

    The first frame takes as long as every other one.
    """
    count, took = min(paths, 4), []
    for k in range(3 if count == 1 else 1):  # a frame of four paths takes seconds: one is enough
        gatherer = _gatherer(solver, walk.lap[k % len(walk.lap)], k)
        started = time.perf_counter()
        gatherer.paths(np.arange(len(gatherer.positions)), 0, count)
        took.append(1e3 * (time.perf_counter() - started) * paths / count)
    return {"frame_ms": float(np.median(took)), "frame_p95_ms": max(took), "first_frame_ms": float(np.median(took))}


def _gatherer(solver: Solver, poses, seed: int) -> Gatherer:
    everywhere = {**solver.poses, **poses}
    points = evaluation_points(solver.surfaces, solver.model.receivers_at(everywhere))
    return Gatherer(solver.scene, *points, seed, everywhere, model=solver.model, levels=solver.levels)


class Measurer:
    """One scene and the solvers of its settings. `family` and `rival` measure along a walk."""

    def __init__(self, scene: Scene, settings: Settings, effort: Effort, bar) -> None:
        """bar(stage, fraction): called on the way."""
        self.scene, self.settings, self.effort, self.bar = scene, settings, effort, bar
        started = time.perf_counter()
        self.base = make_solver(scene, replace(settings, estimator=CHEAPEST))
        self._prepare_seconds = time.perf_counter() - started
        self._traced: dict[int, float] = {}  # s from the start to that number of photons
        self._gather_seconds = 0.0
        self._limits: Solver | None = None

    def family(self, choices: Iterable[Choice], walk: Walk) -> Iterator[dict | Failure]:
        """Yield the row of each setting of one family: they share the limit at very many photons."""
        limits: list = []

        def row(choice: Choice) -> dict:
            if choice.light == "best":  # gathered light has no limit at many photons
                return self._row(choice, None, walk)
            if not limits:
                limits.append(at_cases(self.limit(choice), walk))
            return self._row(choice, limits[0], walk)

        for choice in choices:
            yield attempted(f"{choice.curve}, {choice.summary()}", partial(row, choice))

    def rival(self, choice: Choice, walk: Walk) -> Iterator[dict | Failure]:
        """Yield the row of the rival."""

        def row() -> dict:
            seen = rival_light(self.base, walk, choice.photons, self.settings.seed)
            times = rival_times(self.base, walk, choice.photons)
            named = choice._asdict() | {"curve": choice.curve}
            return named | times | errors(seen, None, walk.cases)

        yield attempted(f"{choice.curve}, {choice.photons} paths", row)

    def solved(self, choice: Choice):
        """Return a solver of a setting, all its photons taken in, and the seconds that took without tracing."""
        self.trace(choice.traced)
        if choice.light == "best":
            self._gather()
        solver = self.base.twin()
        solver.configure(photons=choice.traced, **choice.setting)
        started = time.perf_counter()
        solver.solve()
        return solver, time.perf_counter() - started

    def _row(self, choice: Choice, limit, walk) -> dict:
        solver, seconds = self.solved(choice)
        first = self._prepare_seconds + self._traced[choice.traced] + seconds
        if choice.light == "best":
            first += self._gather_seconds
        ms, light = go(solver, walk, *choice.frame)
        if choice.rested:
            light = at_cases(solver, walk, self.effort.gathered_seconds)
        times = {
            "curve": choice.curve,
            "frame_ms": float(np.median(ms)),
            "frame_p95_ms": float(np.quantile(ms, 0.95)),
            "first_frame_ms": 1e3 * first,
        }
        return choice._asdict() | times | errors(light, limit, walk.cases)

    def trace(self, photons: int) -> None:
        """Trace photons up to a number, with the cheapest estimator."""
        if photons in self._traced:
            return
        most = max(self._traced, default=0)
        started = time.perf_counter()
        self.base.configure(photons=photons)
        self.base.solve()
        self._traced[photons] = self._traced.get(most, 0.0) + time.perf_counter() - started

    def _gather(self) -> None:
        """Gather the static light, once; every twin has it."""
        noise = self.effort.gathered_noise
        if self.base.frame_light.static.gathered is None or self.base.frame_light.static.gathered.noise > noise:
            started = time.perf_counter()
            for progress in self.base.gather_steps():
                self.bar(progress.stage, progress.fraction)
                if self.base.frame_light.static.gathered.noise <= noise:
                    break
            self._gather_seconds = time.perf_counter() - started

    def limit(self, choice: Choice):
        """Return a solver of the same family with very many photons, other ones."""
        if self._limits is None:
            # the limit must not share photons with the rows
            settings = replace(self.settings, estimator=CHEAPEST, seed=self.settings.seed + 1000)
            self._limits = make_solver(self.scene, replace(settings, photons=self.effort.limit_photons))
            self._limits.solve()
        limit = self._limits.twin()
        limit.configure(**choice.setting)
        limit.solve()
        return limit


class Run:
    """One scene with its walk, its truth and the settings to measure."""

    def __init__(self, scene, settings: Settings, quick: bool, frames: int | None, points: int | None, out: Path,
                 bar: Bar) -> None:  # fmt: skip
        self.scene, self.settings, self.quick, self.bar = scene, settings, quick, bar
        self.effort = QUICK if quick else FULL
        self.frames, self.points = frames or self.effort.frames, points or self.effort.points
        self.measurer = Measurer(scene, settings, self.effort, bar)
        self.base = self.measurer.base
        self.choices = choices(settings, self.base, self.effort)
        if not quick and settings.estimator is None:
            self.choices += [c for c in choices_like_the_report(settings.scene, self.base) if c not in self.choices]
        families = list(dict.fromkeys(c.family for c in self.choices))
        self.choices.sort(key=lambda c: families.index(c.family))
        self.under = {
            "scene": settings.scene,
            "commit": commit() or "unknown",
            "processor": processor(),
            "seed": settings.seed,
            "frames": self.frames,
            "asked_points": self.points,
            "lamps": lamps_of(settings),
        }
        self.file, self.rows = out / "results.csv", list[dict]()
        self.lap = motion.walk(motion.paths_of(self.base), STEP_PER_FRAME * self.base.scene_size, self.frames)
        poses = min(self.effort.poses, self.frames)
        self.failures: list[Failure] = []
        self.truth_frames = [(2 * k + 1) * self.frames // (2 * poses) for k in range(poses)]

    def about(self) -> dict[str, object]:
        """Return the conditions of the measurement."""
        return self.under | {
            "triangles": int(self.base.surfaces.first_face[-1]),
            "receivers": len(self.base.irradiance),
            "scene_size": self.base.scene_size,
            "threads": self.base.model.threads,
            "poses": len(self.truth_frames),
            "truth": self.effort.truth,
            "limit": self.effort.limit_photons,
            "load": load(),
        }

    def measure(self) -> None:
        """Measure every setting, and the rival; failed ones go to `failures`."""
        fixed = 60_000  # photons of about the same time as the fixed cost of a row
        todo = self.choices
        rival = [Choice(RIVAL, n, n, 0.0, 0, False, "photons") for n in self.effort.paths]  # n paths per vertex
        walk = self._walk()
        families = (self.measurer.family(tuple(group), walk) for _, group in groupby(todo, key=lambda c: c.family))
        rivals = (self.measurer.rival(choice, walk) for choice in rival)
        total, done, started = fixed + sum(fixed + c.photons for c in (*todo, *rival)), 0, time.monotonic()
        for row in chain.from_iterable(chain(families, rivals)):
            if isinstance(row, Failure):
                self.failures.append(row)
                continue
            self.rows.append(self.under | row)
            write_rows(self.file, self.rows)
            done += fixed + row["photons"]
            left = time_left((time.monotonic() - started) * max(total - done, 0) / done)
            self.bar(f"measuring settings{left}", min(done / total, 1.0))

    def _walk(self) -> Walk:
        for n in sorted({c.traced for c in self.choices}):
            self.bar("tracing", 0.0)
            self.measurer.trace(n)
        self.bar("the light of many photons", 0.0)
        s = self.base.setting
        finest = self.measurer.limit(Choice(DEFAULT, 0, 0, s.radius, s.neighbours, self.settings.control, "photons"))
        seed = self.settings.seed
        made = truth.cases(finest, self.lap, self.truth_frames, self.points, self.effort.truth, seed, self.bar)
        return Walk(self.lap, made)


def lamps_of(settings: Settings) -> str:
    """Return the levels of lamps that differ from the scene file, by name; "" if none does."""
    return "; ".join(f"{name} {', '.join(f'{c:g}' for c in level)}" for name, level in settings.levels(()).items())

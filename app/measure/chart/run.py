"""A run of the chart: missing settings are measured family by family and written one by one.

A family shares its limit at very many photons. Photons are traced once: every setting uses a twin of one solver.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
from pathlib import Path

from app.cli.progress import Bar, time_left
from app.cli.version import commit
from app.draw import motion
from app.measure.chart import measure, truth
from app.measure.chart import rival as chart_rival
from app.measure.chart.measure import Walk
from app.measure.chart.report import choices_like_the_report
from app.measure.chart.results import KEY, Results
from app.measure.chart.settings import Choice, choices, effort
from app.measure.chart.tuned import nearness, tuned_choice
from app.measure.machine import load, processor
from app.settings import STEP, Settings, make_solver
from gi_core.estimators import CHEAPEST, DEFAULT
from gi_core.solver import Solver

LIMIT_SEED = 1000  # added to the seed: the limit must not share photons with the rows
FIXED = 60_000  # photons of about the same time as the fixed cost of a row


class Run:
    """One scene with its walk, its truth and the settings to measure."""

    def __init__(self, scene, settings: Settings, quick: bool, frames: int | None, points: int | None, out: Path,
                 bar: Bar) -> None:  # fmt: skip
        self.scene, self.settings, self.quick, self.bar = scene, settings, quick, bar
        self.effort = effort(quick)
        self.frames, self.points = frames or self.effort.frames, points or self.effort.points
        started = time.perf_counter()
        self.base = make_solver(scene, replace(settings, estimator=CHEAPEST))
        self._prepare_seconds = time.perf_counter() - started
        self.choices = choices(settings, self.base, self.effort)
        if not quick and settings.estimator is None:
            self.choices += [c for c in choices_like_the_report(settings.scene, self.base) if c not in self.choices]
        families = list(dict.fromkeys(c.family for c in self.choices))
        self.choices.sort(key=lambda c: families.index(c.family))
        under = (settings.scene, commit() or "unknown", processor(), settings.seed, self.frames, self.points)
        self.results = Results(out, dict(zip(KEY, under, strict=True)), Choice._fields)
        self.lap = motion.walk(motion.paths_of(self.base), STEP * self.base.scene_size, self.frames)
        poses = min(self.effort.poses, self.frames)
        self.truth_frames = [(2 * k + 1) * self.frames // (2 * poses) for k in range(poses)]
        self._traced: dict[int, float] = {}  # s from the start to that number of photons
        self._gather_seconds = 0.0
        self._limits: Solver | None = None

    def about(self) -> dict[str, object]:
        """Return the conditions of the measurement."""
        return self.results.under | {
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
        """Measure every setting that is missing, and the rival."""
        todo = [c for c in self.choices if not self.results.has(c._asdict())]
        rival = [c for c in rival_choices(self.effort.paths) if not self.results.has(c._asdict())]
        tuned = not self.quick and self.settings.estimator is None and not nearness(self.results.rows)
        if not todo and not rival and not tuned:
            return
        walk = self._walk()
        works, done, started = [FIXED + c.photons for c in todo], 0, time.monotonic()
        for _, group in groupby(todo, key=lambda c: c.family):
            limit = None
            for choice in group:
                spent = time.monotonic() - started
                left = time_left(spent * (sum(works) - done) / done if done else None)
                self.bar(f"{choice.curve}{left}", done / sum(works))
                limit = measure.at_cases(self._limit(choice), walk) if limit is None else limit
                # Gathered light has no limit at very many photons.
                self.results.add(self._row(choice, None if choice.light == "best" else limit, walk))
                done += FIXED + choice.photons
        for choice in rival:
            self.bar(f"{choice.estimator}, {choice.photons} paths", 1.0)
            seen = chart_rival.seen(self.base, walk, choice.photons, self.settings.seed)
            self.results.add({
                **choice._asdict(), "curve": choice.curve, **chart_rival.times(self.base, walk, choice.photons),
                **measure.errors(seen, None, walk.cases),
            })  # fmt: skip

        if tuned:
            self.measure_tuned(walk)

    def measure_tuned(self, walk: Walk) -> None:
        """Measure the choice of `tune` on this scene and machine."""
        most = max(c.traced for c in self.choices)
        plain = Choice(
            DEFAULT, most, most, self.base.setting.radius, self.base.setting.neighbours, True, "best", paths=64
        )
        solver, _ = self.solved(plain)
        self.results.add(self._row(tuned_choice(solver, most, self.bar), None, walk))

    def solved(self, choice: Choice):
        """Return a solver of a setting, all its photons taken in, and the seconds that took without tracing."""
        self._trace(choice.traced)
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
        seen = measure.go(solver, walk, *choice.frame)
        if choice.rested:
            seen = seen._replace(at_cases=measure.at_cases(solver, walk, self.effort.gathered_seconds))
        return measure.row(choice, seen, limit, walk, first)

    def _trace(self, photons: int) -> None:
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
        if self.base.light_source.gathered is None or self.base.light_source.gathered.noise > noise:
            started = time.perf_counter()
            for progress in self.base.gather_steps():
                self.bar(progress.stage, progress.fraction)
                if self.base.light_source.gathered.noise <= noise:
                    break
            self._gather_seconds = time.perf_counter() - started

    def _walk(self) -> Walk:
        for n in sorted({c.traced for c in self.choices}):
            self.bar("tracing", 0.0)
            self._trace(n)
        self.bar("the light of many photons", 0.0)
        s = self.base.setting
        finest = self._limit(Choice(DEFAULT, 0, 0, s.radius, s.neighbours, self.settings.control, "photons"))
        seed = self.settings.seed
        found = truth.cases(finest, self.lap, self.truth_frames, self.points, self.effort.truth, seed, self.bar)
        return measure.make_walk(finest, self.lap, found, seed)

    def _limit(self, choice: Choice):
        """Return a solver of the same family with very many photons, other ones."""
        if self._limits is None:
            settings = replace(self.settings, estimator=CHEAPEST, seed=self.settings.seed + LIMIT_SEED)
            self._limits = make_solver(self.scene, replace(settings, photons=self.effort.limit_photons))
            self._limits.solve()
        limit = self._limits.twin()
        limit.configure(**choice.setting)
        limit.solve()
        return limit


def rival_choices(counts: tuple[int, ...]) -> Iterator[Choice]:
    """Return the rival's settings; `photons` holds its paths per vertex."""
    for paths in counts:
        yield Choice(chart_rival.RIVAL, paths, paths, 0.0, 0, False, "photons")

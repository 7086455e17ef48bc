"""Rows of the chart: settings measured on one scene. All solvers are twins of one, so photons are traced once."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

from app.measure.chart import measure
from app.measure.chart import rival as chart_rival
from app.measure.chart.measure import Walk
from app.measure.chart.settings import Choice, Effort
from app.measure.chart.tuned import tuned_choice
from app.settings import Settings, make_solver
from gi_core.estimators import CHEAPEST, DEFAULT
from gi_core.scene import Scene
from gi_core.solver import Solver

LIMIT_SEED = 1000  # added to the seed: the limit must not share photons with the rows


class Measurer:
    """One scene and the solvers of its settings. `family`, `rival` and `tuned` measure along a walk."""

    def __init__(self, scene: Scene, settings: Settings, effort: Effort, bar, threads: int | None = None) -> None:
        """bar(stage, fraction): called on the way; threads: None for one per core."""
        self.scene, self.settings, self.effort, self.bar, self._threads = scene, settings, effort, bar, threads
        started = time.perf_counter()
        self.base = make_solver(scene, replace(settings, estimator=CHEAPEST), threads=threads)
        self._prepare_seconds = time.perf_counter() - started
        self._traced: dict[int, float] = {}  # s from the start to that number of photons
        self._gather_seconds = 0.0
        self._limits: Solver | None = None

    @property
    def _process(self) -> dict[str, object]:
        """Columns of the process that has timed a row."""
        return {"process": f"{platform.node()}:{os.getpid()}", "threads": self.base.model.threads}

    def family(self, choices: Iterable[Choice], walk: Walk) -> Iterator[dict]:
        """Yield the row of each setting of one family: they share the limit at very many photons."""
        limit = None
        for choice in choices:
            limit = measure.at_cases(self.limit(choice), walk) if limit is None else limit
            # Gathered light has no limit at many photons.
            yield self._row(choice, None if choice.light == "best" else limit, walk)

    def rival(self, choice: Choice, walk: Walk) -> Iterator[dict]:
        """Yield the row of the rival."""
        seen = chart_rival.seen(self.base, walk, choice.photons, self.settings.seed)
        yield {
            **choice._asdict(), "curve": choice.curve, **chart_rival.times(self.base, walk, choice.photons),
            **measure.errors(seen, None, walk.cases), **self._process,
        }  # fmt: skip

    def tuned(self, most: int, walk: Walk) -> Iterator[dict]:
        """Yield the row of the choice of `tune` on this scene and machine; most: photons."""
        s = self.base.setting
        solver, _ = self.solved(Choice(DEFAULT, most, most, s.radius, s.neighbours, True, "best", paths=64))
        yield self._row(tuned_choice(solver, most, self.bar), None, walk)

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
        seen = measure.go(solver, walk, *choice.frame)
        if choice.rested:
            seen = seen._replace(at_cases=measure.at_cases(solver, walk, self.effort.gathered_seconds))
        return measure.row(choice, seen, limit, walk, first) | self._process

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
            settings = replace(self.settings, estimator=CHEAPEST, seed=self.settings.seed + LIMIT_SEED)
            self._limits = make_solver(
                self.scene, replace(settings, photons=self.effort.limit_photons), threads=self._threads
            )
            self._limits.solve()
        limit = self._limits.twin()
        limit.configure(**choice.setting)
        limit.solve()
        return limit

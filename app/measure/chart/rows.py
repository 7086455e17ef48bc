"""Rows of the chart: settings measured on one scene. All solvers are twins of one, so photons are traced once."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from app.measure.chart import measure
from app.measure.chart import rival as chart_rival
from app.measure.chart.measure import Walk
from app.measure.chart.settings import TUNED, Choice, Effort
from app.measure.chart.tuned import choice_of
from app.measure.tuning import tune
from app.settings import BUDGET, Settings, make_solver
from gi_core.estimators import CHEAPEST, DEFAULT
from gi_core.scene import Scene, SceneError
from gi_core.solver import Solver

LIMIT_SEED = 1000  # added to the seed: the limit must not share photons with the rows


class Failure(NamedTuple):
    """A row that could not be measured."""

    curve: str
    setting: str  # in words
    reason: str

    def __str__(self) -> str:
        return f"{', '.join(filter(None, (self.curve, self.setting)))} could not be measured: {self.reason}"


def _attempted(curve: str, setting: str, row: Callable[[], dict]) -> dict | Failure:
    """Return the columns of a row, or why it failed: no error of one row, whichever it is, may cost the others."""
    try:
        return row()
    except Exception as error:
        return Failure(curve, setting, str(error) if isinstance(error, SceneError) else repr(error))


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

    def family(self, choices: Iterable[Choice], walk: Walk) -> Iterator[dict | Failure]:
        """Yield the row of each setting of one family: they share the limit at very many photons."""
        limits: list = []

        def row(choice: Choice) -> dict:
            if choice.light == "best":  # gathered light has no limit at many photons
                return self._row(choice, None, walk)
            if not limits:
                limits.append(measure.at_cases(self.limit(choice), walk))
            return self._row(choice, limits[0], walk)

        for choice in choices:
            yield _attempted(choice.curve, choice.summary(), partial(row, choice))

    def rival(self, choice: Choice, walk: Walk) -> Iterator[dict | Failure]:
        """Yield the row of the rival."""

        def row() -> dict:
            seen = chart_rival.seen(self.base, walk, choice.photons, self.settings.seed)
            times = chart_rival.times(self.base, walk, choice.photons)
            named = choice._asdict() | {"curve": choice.curve}
            return named | times | measure.errors(seen, None, walk.cases) | self._process

        yield _attempted(choice.curve, f"{choice.photons} paths", row)

    def tuned(self, most: int, walk: Walk) -> Iterator[dict | Failure]:
        """Yield the row of the choice of `tune` on this scene and machine; most: photons."""

        def row() -> dict:
            s = self.base.setting
            solver, _ = self.solved(Choice(DEFAULT, most, most, s.radius, s.neighbours, True, "best", paths=64))
            found = tune(solver, 1e-3 * BUDGET, self.bar)
            return self._row(choice_of(found, self._traced, solver.frame.subsets), None, walk)

        yield _attempted(TUNED, "", row)

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

"""A run of the chart.

Missing settings are measured family by family and written to the table. A family shares its limit at very many photons.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from app.cli.cluster import Machines
from app.cli.progress import Bar, time_left
from app.cli.version import commit
from app.draw import motion
from app.measure.chart import truth
from app.measure.chart.measure import Measurer, Walk, make_walk
from app.measure.chart.settings import RIVAL, Choice, Effort, choices, choices_like_the_report, effort, nearness
from app.measure.results import KEY, Failure, Results, load, processor
from app.settings import STEP_PER_FRAME, Settings
from gi_core.estimators import DEFAULT
from gi_core.scene import Scene

if TYPE_CHECKING:
    from app.cli.cluster import Machines
    from app.measure.results import Failure


NUMBERS = "radius", "neighbours", "photons", "frame_ms", "frame_p95_ms", "first_frame_ms", "total all"
FIXED = 60_000  # photons of about the same time as the fixed cost of a row


class Run:
    """One scene with its walk, its truth and the settings to measure."""

    def __init__(self, scene, settings: Settings, quick: bool, frames: int | None, points: int | None, out: Path,
                 bar: Bar, machines: Machines | None = None) -> None:  # fmt: skip
        self.scene, self.settings, self.quick, self.bar = scene, settings, quick, bar
        self.effort = effort(quick)
        self.frames, self.points = frames or self.effort.frames, points or self.effort.points
        self.machines = machines  # whose processes measure; None: this one
        self.measurer = Measurer(scene, settings, self.effort, bar)
        self.base = self.measurer.base
        self.choices = choices(settings, self.base, self.effort)
        if not quick and settings.estimator is None:
            self.choices += [c for c in choices_like_the_report(settings.scene, self.base) if c not in self.choices]
        families = list(dict.fromkeys(c.family for c in self.choices))
        self.choices.sort(key=lambda c: families.index(c.family))
        kinds = [processor()] if machines is None else machines.ask(processor)
        under = (
            settings.scene,
            commit() or "unknown",
            "; ".join(sorted(set(kinds))),
            settings.seed,
            self.frames,
            self.points,
            lamps_of(settings),
        )
        self.results = Results(out, dict(zip(KEY, under, strict=True)), Choice._fields, NUMBERS)
        self.lap = motion.walk(motion.paths_of(self.base), STEP_PER_FRAME * self.base.scene_size, self.frames)
        poses = min(self.effort.poses, self.frames)
        self.failures: list[Failure] = []
        self.truth_frames = [(2 * k + 1) * self.frames // (2 * poses) for k in range(poses)]

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
        """Measure every setting that is missing, the rival, and tune's choice; failed ones go to `failures`."""
        todo = [c for c in self.choices if not self.results.has(c._asdict())]
        rival = [c for c in rival_choices(self.effort.paths) if not self.results.has(c._asdict())]
        tuned = not self.quick and self.settings.estimator is None and not nearness(self.results.rows)
        if not todo and not rival and not tuned:
            return
        walk, counts = self._walk(), sorted({c.traced for c in self.choices})
        tasks: list[tuple] = [(Measurer.family, tuple(group)) for _, group in groupby(todo, key=lambda c: c.family)]
        tasks += [(Measurer.rival, choice) for choice in rival]
        tasks += [(Measurer.tuned, counts[-1])] if tuned else []
        if self.machines is None:
            made: Iterator = (run(self.measurer, what, walk) for run, what in tasks)
        else:
            job = Job(self.scene, self.settings, self.effort, counts, walk)
            made = self.machines.crew(_ready, job).map(_measured, tasks)
        total, done, started = FIXED + sum(FIXED + c.photons for c in (*todo, *rival)), 0, time.monotonic()
        for rows in made:
            for row in rows:
                if isinstance(row, Failure):
                    self.failures.append(row)
                    continue
                self.results.add(row)
                done += FIXED + row["photons"]
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
        return make_walk(finest, self.lap, made, seed)


def lamps_of(settings: Settings) -> str:
    """Return the levels of lamps that differ from the scene file, by name; "" if none does."""
    return "; ".join(f"{name} {', '.join(f'{c:g}' for c in level)}" for name, level in settings.levels(()).items())


class Job(NamedTuple):
    """Data that all tasks of a chart share, for other processes."""

    scene: Scene
    settings: Settings
    effort: Effort
    counts: list[int]  # photons
    walk: Walk


def _ready(job: Job, threads: int | None) -> tuple[Measurer, Walk]:
    """Return the measurer of a job, in a process of the cluster."""
    measurer = Measurer(job.scene, job.settings, job.effort, _silent, threads)
    for n in job.counts:
        measurer.trace(n)
    return measurer, job.walk


def _silent(stage: str, fraction: float | None) -> None:
    pass


def _measured(ready: tuple[Measurer, Walk], run: Callable, what) -> list[dict | Failure]:
    measurer, walk = ready
    return list(run(measurer, what, walk))


def rival_choices(counts: tuple[int, ...]) -> Iterator[Choice]:
    """Return the rival's settings; `photons` holds its paths per vertex."""
    for paths in counts:
        yield Choice(RIVAL, paths, paths, 0.0, 0, False, "photons")

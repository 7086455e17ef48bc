"""Every number of one benchmark: the mobile walks along its path, each frame is timed, its light is checked.

A GI frame is everything from the new poses to the irradiance array. Memory does not grow with the number of
frames, so that a million of them show whether the program's does.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from app.cli.progress import Bar, solve
from app.draw import motion
from app.measure.bench.bounds import best_seconds, bounds
from app.measure.bench.series import Series
from app.measure.machine import commit, load, peak_rss_mb, processor, rss_mb
from app.settings import STEP, Settings, make_solver

FORMAT = "gi-viewer bench 2"
BEST_OF = 3  # from-scratch runs
LAP = 1000  # different poses at most; longer runs go round again


def warm_up(scene, settings: Settings) -> None:
    """Load what is compiled and start the threads, on a solver of its own with few photons."""
    solver = make_solver(scene, replace(settings, photons=1000))
    solver.solve()
    solver.move_all(solver.poses)
    solver.from_scratch()


def measure(scene, settings: Settings, frames: int, bar: Bar, step: float = STEP) -> dict:
    """Return every number that `bench` prints, by its JSON key; step: of a mobile in a frame, over the scene size."""
    busy = load()
    started = time.perf_counter()
    solver = make_solver(scene, settings)
    prepared = time.perf_counter()
    solve(solver, bar)
    first_frame = time.perf_counter() - prepared

    lap = motion.walk(motion.paths_of(solver), step * solver.scene_size, min(frames, LAP))
    walked = _walk(solver, lap, frames, bar)
    scratch, equal = _from_scratch(solver, bar)
    frame_ms, stages_ms = walked.frame.median, {name: s.median for name, s in walked.stages.items()}
    bar("bounds", 0.0)
    median_pose = lap[walked.frame.place_of_median() % len(lap)]
    bound = bounds(solver, median_pose, stages_ms, frame_ms, walked.cpu.median)
    return {
        "format": FORMAT,
        "scene": settings.scene,
        "triangles": int(solver.surfaces.first_face[-1]),
        "receivers": len(solver.irradiance),
        "photons": solver.photons_traced,
        "estimator": solver.estimator,
        "control": solver.setting.control,
        "control_share": solver.control_facts.share,
        "control_stale": walked.in_contact.median,
        "control_on_mobiles": walked.on_mobiles.median,
        "radius": solver.radius,
        "neighbours": solver.neighbours,
        "seed": solver.seed,
        "threads": solver.model.threads,
        "processor": processor(),
        "commit": commit(),
        "load": busy,
        "frames": frames,
        "step_percent": 100 * step,
        "frame_ms": {
            "median": frame_ms,
            "p95": walked.frame.quantile(0.95),
            "min": walked.frame.min,
            "max": walked.frame.max,
            "cpu": walked.cpu.median,
            "first_tenth": walked.first_tenth.median,
            "last_tenth": walked.last_tenth.median,
        },
        "stages_ms": stages_ms,
        "bounds": bound,
        "share_cut": walked.cut.median / max(solver.photons_traced, 1),
        "segments": solver.segments_total,
        "segments_changed": walked.changed.median,
        "us_per_cut_photon": walked.per_cut.median if walked.per_cut.count else None,
        "photon_map": _queries(solver, walked, stages_ms),
        "from_scratch_ms": 1e3 * scratch,
        "from_scratch_ratio": 1e3 * scratch / frame_ms,
        "prepare_ms": 1e3 * (prepared - started),
        "first_frame_ms": 1e3 * first_frame,
        "rss_mb": {"first_tenth": walked.rss_first, "last_tenth": walked.rss_last, "peak": peak_rss_mb()},
        "bits_equal": equal,
    }


class _Walked:
    """What the frames of a walk took; milliseconds, and microseconds a cut photon."""

    def __init__(self) -> None:
        self.frame, self.first_tenth, self.last_tenth = Series(), Series(), Series()
        self.cpu = Series()  # of all threads together: what other programs do hardly shows in it
        self.stages: dict[str, Series] = {}
        self.cut, self.changed, self.per_cut, self.stale = Series(), Series(), Series(), Series()
        self.in_contact, self.on_mobiles = Series(), Series()  # receivers
        self.rss_first: float | None = None  # MB held after the first tenth of the frames ...
        self.rss_last: float | None = None  # ... and after the last one


def _walk(solver, lap: list[dict], frames: int, bar: Bar) -> _Walked:
    from gi_core.instruments.lower_bounds import estimate_of

    walked, tenth = _Walked(), max(1, frames // 10)
    solver.move_all(lap[-1])  # the frame before the first one, untimed
    for k in range(frames):
        bar("moving", k / frames)
        before, cpu_before = time.perf_counter(), time.process_time()
        solver.move_all(lap[k % len(lap)])
        ms = 1e3 * (time.perf_counter() - before)
        walked.frame.add(ms)
        walked.cpu.add(1e3 * (time.process_time() - cpu_before))
        if k < tenth:
            walked.first_tenth.add(ms)
        if k >= frames - tenth:
            walked.last_tenth.add(ms)
        for name, seconds in solver.timings.items():
            walked.stages.setdefault(name, Series()).add(1e3 * seconds)
        cut = solver.changes.photons_cut
        walked.cut.add(cut)
        walked.changed.add(solver.changes.old_segments + solver.changes.new_segments)
        if cut:
            walked.per_cut.add(1e3 * ms / cut)
        walked.in_contact.add(solver.control_facts.stale)
        walked.on_mobiles.add(solver.control_facts.on_mobiles)
        walked.stale.add(getattr(estimate_of(solver), "stale", 0))
        if k == tenth - 1:
            walked.rss_first = rss_mb()
    walked.rss_last = rss_mb()
    return walked


def _from_scratch(solver, bar: Bar) -> tuple[float, bool]:
    """Return the best time [s] of the same frame from scratch, and whether it has the same bits."""
    took, equal = Series(), True
    for k in range(BEST_OF):
        bar("from scratch", k / BEST_OF)
        before = time.perf_counter()
        fresh = solver.from_scratch()
        took.add(time.perf_counter() - before)
        equal = equal and bool(np.array_equal(fresh, solver.irradiance))
    return took.min, equal


def _queries(solver, walked: _Walked, stages_ms: dict[str, float]) -> dict | None:
    """Return what an estimator that estimates stale receivers again spends on it; None for others.

    `allowed_ms` is what the frame's share of a full estimate would cost.
    """
    from gi_core.instruments import lower_bounds

    if not hasattr(lower_bounds.estimate_of(solver), "stale"):
        return None
    static = solver.surfaces.receiver_range(0).stop
    queries = walked.stale.median + len(solver.irradiance) - static
    full = 1e3 * best_seconds(lower_bounds.full_estimate(solver))
    share = walked.stale.median / max(static, 1)
    return {
        "stale_share": share,
        "queries": queries,
        "us_a_query": 1e3 * stages_ms.get("estimate", 0.0) / max(queries, 1),
        "full_estimate_ms": full,
        "allowed_ms": full * share,
    }

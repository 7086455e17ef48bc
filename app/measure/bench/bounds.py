"""Lower bounds of a frame: the work that its stages cannot avoid, timed alone on this machine in this run."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gi_core.solver import Solver

REPEATS = 5  # the least time counts
LEAST_SECONDS = 0.02  # of all repeats of one kind of work
COPY_BYTES = 128_000_000  # of the copy that measures bandwidth: larger than any cache


def bounds(solver: Solver, poses, stages_ms: dict[str, float], frame_ms: float, cpu_ms: float) -> dict:
    """Return the bound of each stage and of the frame at `poses`, and measured time / bound.

    `stages_ms`, `frame_ms`, `cpu_ms`: measured medians; CPU time is of all threads. Leaves the solver at `poses`.
    """
    from gi_core.instruments import lower_bounds

    works = lower_bounds.work_of_frame(solver, poses)
    per_stage: dict[str, list[dict]] = {}
    for work in works:
        per_second = work.batch / best_seconds(work.run)
        ms = 1e3 * work.count / per_second
        entry = {"unit": work.unit, "count": work.count, "per_second": per_second, "ms": ms}
        per_stage.setdefault(work.stage, []).append(entry)
    stages = {}
    for stage, entries in per_stage.items():
        bound = sum(e["ms"] for e in entries)
        took = stages_ms.get(stage)
        stages[stage] = {"bound_ms": bound, "ratio": took / bound if took and bound else None, "work": joined(entries)}
    whole = sum(s["bound_ms"] for s in stages.values())
    copy = lower_bounds.copied("", COPY_BYTES, solver.model.threads)
    return {
        "stages": stages,
        "frame_bound_ms": whole,
        "frame_ratio": frame_ms / whole if whole else None,
        "frame_cpu_ratio": cpu_ms / (whole * solver.model.threads) if whole else None,
        "copy_gb_per_s": 1e-9 * copy.batch / best_seconds(copy.run),
    }


def joined(entries: list[dict]) -> dict[str, dict]:
    """Return the work of one stage by unit, with sums of count and time."""
    out: dict[str, dict] = {}
    for e in entries:
        have = out.setdefault(e["unit"], {"count": 0, "ms": 0.0})
        have["count"] += e["count"]
        have["ms"] += e["ms"]
    for have in out.values():
        have["per_second"] = 1e3 * have["count"] / have["ms"] if have["ms"] else 0.0
    return out


def best_seconds(run) -> float:
    """Return the least time [s] of a call, after one untimed call.

    On a busy machine CPU time is nearer to it than the clock: the smaller of both counts.
    """
    run()
    best, spent, calls = math.inf, 0.0, 0
    while calls < REPEATS or spent < LEAST_SECONDS:
        before, cpu_before = time.perf_counter(), time.process_time()
        run()
        seconds, cpu = time.perf_counter() - before, time.process_time() - cpu_before
        best = min(best, seconds, cpu or seconds)  # 0: a clock that ticks 64 times per second (Windows)
        spent, calls = spent + seconds, calls + 1
    return max(best, 1e-9)


def summary(stage: dict) -> str:
    """Return a stage's bound in words: "9.1 x its bound 0.740 ms: 14 k rays at 4.1 M rays/s"."""
    parts = (f"{_amount(w['count'], unit)} at {_amount(w['per_second'], unit)}/s" for unit, w in stage["work"].items())
    ratio = f"{stage['ratio']:.1f} x" if stage["ratio"] else "not timed apart;"
    return f"{ratio} its bound {stage['bound_ms']:.3f} ms: {', '.join(parts)}"


def _amount(n: float, unit: str) -> str:
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if n >= factor:
            return f"{n / factor:.3g} {prefix}{'B' if unit == 'bytes' else ' ' + unit}"
    return f"{n:.0f} {'B' if unit == 'bytes' else unit}"

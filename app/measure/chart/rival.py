"""The rival: path tracing from every vertex in every frame, without photons."""

from __future__ import annotations

import time

import numpy as np

from app.measure.chart.measure import AtCases, Walk
from gi_core.gather.point_gather import Gatherer
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.solver import Solver

RIVAL = "path gather"
TIMED = 4  # paths per vertex; the time of more is scaled from these
OTHER_SEED = 0x417A1  # the truth has other paths


def seen(solver: Solver, walk: Walk, paths: int, seed: int) -> AtCases:
    """Return the irradiance of each case from a number of paths per receiver; it has no gloss."""
    out = []
    for case in walk.cases:
        gatherer = _gatherer(solver, walk.lap[case.frame], seed ^ OTHER_SEED)
        out.append(gatherer.paths(case.rows, 0, paths).mean(axis=1))
    return AtCases(out, [None] * len(out))


def times(solver: Solver, walk: Walk, paths: int) -> dict[str, float]:
    """Return the time [ms] of a frame with paths from every vertex; times over TIMED paths are scaled.

    The first frame takes as long as every other one.
    """
    count, took = min(paths, TIMED), []
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

"""The rival: no photons kept; every frame gathers some random paths at every vertex."""

from __future__ import annotations

import time

import numpy as np

from app.measure.chart.measure import Walk
from gi_core.gather.point_gather import Gatherer
from gi_core.geometry.evaluation_points import evaluation_points

RIVAL = "path gather"
PATHS = (1, 4, 16, 64)  # a vertex
QUICK_PATHS = (1, 4)
TIMED = 4  # paths a vertex: more take as many times longer
OTHER_SEED = 0x417A1  # its paths are not those of the truth


def seen(solver, walk: Walk, paths: int, seed: int) -> list[np.ndarray]:
    """Return irradiance (n, 3) at each case's receivers by so many independent paths."""
    out = []
    for case in walk.cases:
        gatherer = _gatherer(solver, walk.lap[case.frame], seed ^ OTHER_SEED)
        out.append(gatherer.paths(case.rows, 0, paths).mean(axis=1))
    return out


def times(solver, walk: Walk, paths: int) -> dict[str, float]:
    """Return the time of a frame that gathers at every vertex [ms]; of many paths, by that of TIMED.

    There is no first frame but this, and no two frames have noise in common.
    """
    count, took = min(paths, TIMED), []
    for k in range(3 if count == 1 else 1):  # one of four paths takes seconds, and hardly swings
        gatherer = _gatherer(solver, walk.lap[k % len(walk.lap)], k)
        started = time.perf_counter()
        gatherer.paths(np.arange(len(gatherer.positions)), 0, count)
        took.append(1e3 * (time.perf_counter() - started) * paths / count)
    return {"frame_ms": float(np.median(took)), "frame_p95_ms": max(took), "first_frame_ms": float(np.median(took))}


def _gatherer(solver, poses, seed: int) -> Gatherer:
    everywhere = {**solver.poses, **poses}
    points = evaluation_points(solver.surfaces, solver.model.receivers_at(everywhere))
    return Gatherer(solver.scene, *points, seed, everywhere, model=solver.model)

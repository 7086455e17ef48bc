"""The truth of the chart: unbiased light at some poses, at a random sample of receivers of each class."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.rest.reference_store import ReferenceStore
from gi_core.gather.reference_sample import draw_by_area
from gi_core.geometry.error import CLOUD_REACH
from gi_core.geometry.receiver_classes import CLASSES, receiver_classes
from gi_core.solver import Solver

SHARES = {"untouched": 0.4, "affected": 0.2, "mobile": 0.2, "border": 0.2}  # of the sample


class PoseTruth(NamedTuple):
    """One pose of the path, and the truth there at n receivers."""

    frame: int  # of the walk
    rows: np.ndarray  # (n,) receivers
    weights: np.ndarray  # (n,) area per sampled receiver [m2]
    kind: np.ndarray  # (n,) int, of CLASSES
    truth: np.ndarray  # (n, 3) float64 [W/m2]
    standard_error: np.ndarray  # (n, 3) float64 [W/m2]
    places: tuple[np.ndarray, np.ndarray]  # positions (n, 3) in units of the reach of clouds, and normals (n, 3)


def background_of(solver: Solver) -> np.ndarray:
    """Return the irradiance (R, 3) of the static part without mobiles; the poses are put back."""
    poses = dict(solver.poses)
    # 1e3 of the scene size: a mobile there changes nothing
    away = np.asarray(solver.scene.up, float) * 1e3 * solver.scene_size
    solver.move_all({name: p._replace(position=tuple(away * (k + 1))) for k, (name, p) in enumerate(poses.items())})
    irradiance = solver.irradiance.copy()
    solver.move_all(poses)
    return irradiance


def cases(
    solver: Solver, lap: list[dict], frames: list[int], points: int, error: float, seed: int, progress
) -> list[PoseTruth]:
    """Return the truth at some frames of a walk, with a noise of `error` (l1); kept on disk.

    The light of `solver`, which is solved, decides the class of each receiver; SHARES of `points` are drawn from each.
    `progress(stage, fraction)` is called on the way.
    """
    background, start, out = background_of(solver), dict(solver.poses), []
    for k, frame in enumerate(frames):
        solver.move_all(lap[frame])
        areas = solver.receivers.areas
        sides = receiver_classes(solver.surfaces, solver.receivers, solver.irradiance, background)
        rows, weights, kind = choose(sides, areas, points, np.random.default_rng([seed, frame]))
        store = ReferenceStore(solver.model, solver.poses, rows, seed, weights=weights, levels=solver.levels)
        for reached in store.gather(error):
            progress(f"truth {k + 1} of {len(frames)}", (k + reached.fraction) / len(frames))
        places = solver.receivers.positions[rows] / (CLOUD_REACH * solver.scene_size), solver.receivers.normals[rows]
        state = reached.state
        out.append(PoseTruth(frame, rows, weights, kind, state.mean, state.standard_error, places))
    solver.move_all(start)
    return out


def choose(sides: dict[str, np.ndarray], areas: np.ndarray, points: int, random) -> tuple[np.ndarray, ...]:
    """Return rows, weights and class of about `points` receivers, drawn by area in each class.

    Weights are areas / probabilities: weighted sums over the sample are unbiased estimates of sums over all.
    """
    rows, weights, kind = [], [], []
    for number, name in enumerate(CLASSES):
        mine = np.flatnonzero(sides[name] & (areas > 0))
        if not len(mine):
            continue
        count = max(1, round(SHARES[name] * points))
        if count >= len(mine):
            rows.append(mine)
            weights.append(areas[mine])
        else:
            drawn, times = draw_by_area(mine, areas, count, random)
            rows.append(drawn)
            weights.append(times * areas[mine].sum() / count)
        kind.append(np.full(len(rows[-1]), number))
    return np.concatenate(rows), np.concatenate(weights), np.concatenate(kind)

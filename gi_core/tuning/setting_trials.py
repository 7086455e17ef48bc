"""Short trials of settings on one scene: error and time of frames of few photons, the input of `error_model.py`.

Errors are measured at receivers on mobiles and at static receivers that mobiles change. The truth is `reference.py` at
few receivers; its known noise is subtracted.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gi_core.estimators.setting import Setting
from gi_core.gather.reference import gather_rounds
from gi_core.geometry.error import relative_error
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.geometry.receiver_classes import receiver_classes
from gi_core.scene.types import Pose
from gi_core.solver import Solver

PHOTONS = 1 << 17  # per trial: about a second
COUNTS = 5  # photon subsets per trial: all, one half, ...
RECEIVERS = 300  # per pose
NOISE = 0.02  # of the truth, relative l1; it is subtracted
PATHS_PER_STEP = 1 << 13  # paths of the truth per step: a drag waits for one step at most
MOST_PATHS = 2048  # per receiver


class Yardstick(NamedTuple):
    """What errors are measured with at one pose."""

    poses: dict[str, Pose]
    rows: np.ndarray  # (n,) receivers
    truth: np.ndarray  # (n, 3) irradiance [W/m2]
    weights: np.ndarray  # (n,) how often each was drawn
    noise: float  # of truth, relative l1


class Trial(NamedTuple):
    """What a setting did, for each of some numbers of photons."""

    setting: Setting
    photons: np.ndarray  # (m,) int64, ascending
    alone: np.ndarray  # (m,) squared l1 error, truth's noise taken out, of so many photons and no more
    moving: np.ndarray  # (m,) the same with the static light of the largest number
    seconds: np.ndarray  # (m,) [s] a frame


def yardsticks(
    solver: Solver, frames: Sequence[Mapping[str, Pose]], seed: int = 0
) -> Generator[float, None, list[Yardstick]]:
    """Measure the truth at some poses of the mobiles; yields the share that is done, returns one each.

    `solver` has solved; its poses change. Receivers are drawn with a chance that grows with their area.
    """
    out, rng = [], np.random.default_rng(seed)
    low, high = solver.chosen.low, solver.chosen.high
    for k, poses in enumerate(frames):
        solver.move_all(poses)
        receivers = solver.receivers
        resting = np.zeros_like(solver.irradiance)
        resting[solver.surfaces.receiver_range(0)] = solver.resting_irradiance
        classes = receiver_classes(solver.surfaces, receivers, solver.irradiance, resting)
        inside = ((receivers.positions >= low) & (receivers.positions <= high)).all(axis=1) & (receivers.areas > 0)
        wanted = inside & (classes["affected"] | classes["mobile"])
        rows = np.flatnonzero(wanted if wanted.any() else inside)
        share = receivers.areas[rows] / receivers.areas[rows].sum()
        # Drawn with replacement: without it, few large receivers would count no more than many small ones.
        rows, times = np.unique(rng.choice(rows, RECEIVERS, p=share), return_counts=True)
        points, normals = (a[rows] for a in evaluation_points(solver.surfaces, receivers))
        weights = times.astype(np.float64)  # the draw has weighed them by area
        steps = gather_rounds(
            solver.scene,
            points,
            normals,
            1000 * seed + k,
            weights,
            solver.poses,
            model=solver.model,
            step=PATHS_PER_STEP,
        )
        for truth in steps:
            noise = truth.noise(weights)
            done = max(min((NOISE / noise) ** 2, 1.0), int(truth.paths.sum()) / (MOST_PATHS * len(rows)))
            yield (k + min(done, 1.0)) / len(frames)
            if done >= 1 and truth.sets.min() > 1:
                break
        out.append(Yardstick(dict(solver.poses), rows, truth.mean.copy(), weights, noise))
    return out


def trial(solver: Solver, sticks: list[Yardstick], paths: int | None = None, **setting) -> Generator[None, None, Trial]:
    """Try a setting on a twin of a solver, in steps of some 20 ms or one frame; returns what it did.

    paths: that mobiles gather, as of Solver.move_all(); `setting`: fields of Setting. Photons that the solver has
    traced already are not traced again.
    """
    twin = solver.twin(fresh=True)
    twin.configure(photons=min(PHOTONS, solver.photons), prefix_only=True, **setting)
    for _ in twin.solve_steps():
        yield
    counts = np.array(twin.prefixes[-COUNTS:], np.int64)
    errors, seconds = np.zeros((2, len(counts))), np.zeros((len(sticks), 2, len(counts)))
    for kind, prefix_only in enumerate((True, False)):
        twin.configure(prefix_only=prefix_only)
        for n, count in enumerate(counts):
            for p, stick in enumerate(sticks):  # in the inmost loop, so that something moves in each frame
                twin.move_all(stick.poses, int(count), paths)
                errors[kind, n] += _squared_error(twin, stick) / len(sticks)
                seconds[p, kind, n] = sum(twin.timings.values())
                yield
    # What else the machine does can only add time.
    return Trial(twin.setting, counts, *np.maximum(errors, 0.0), seconds.min(axis=1).mean(axis=0))


def errors_of(
    solver: Solver, sticks: list[Yardstick], frame: int, paths: int | None = None
) -> tuple[float, float, int, float]:
    """Return relative l1 errors at rest and of a frame of the prefix nearest to `frame` photons and so many
    paths, that prefix and its seconds (the median)."""
    prefix = min(solver.prefixes, key=lambda n: abs(n - frame))
    at_rest = moving = 0.0
    seconds = []
    for stick in sticks:
        solver.move_all(stick.poses)
        at_rest += _squared_error(solver, stick) / len(sticks)
    for _ in range(3):
        for stick in sticks:
            solver.move_all(stick.poses, prefix, paths)
            seconds.append(sum(solver.timings.values()))
            moving += _squared_error(solver, stick) / (3 * len(sticks))
    at_rest, moving = (float(np.sqrt(max(e, 0.0))) for e in (at_rest, moving))
    return at_rest, moving, prefix, float(np.median(seconds))


def _squared_error(solver: Solver, stick: Yardstick) -> float:
    """Return the square of the l1 error of what a solver shows, truth's noise taken out; 0 where truth is black."""
    l1 = relative_error(solver.irradiance[stick.rows], stick.truth, stick.weights).l1
    return 0.0 if np.isnan(l1) else l1 * l1 - stick.noise**2

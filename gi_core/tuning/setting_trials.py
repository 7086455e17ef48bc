"""Short trials of settings on one scene: error and time of frames of few photons, the input of `error_model.py`.

Errors are measured at receivers on mobiles and at static receivers that mobiles change, against a reference at few of
them; its known noise is subtracted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gi_core.estimators import ESTIMATORS
from gi_core.estimators.setting import Setting
from gi_core.gather.reference_sample import ReferenceSample, draw_by_area, gather_sample
from gi_core.geometry.receiver_classes import receiver_classes
from gi_core.photons.subsets import LOWEST
from gi_core.scene.types import Pose
from gi_core.solver import Solver

TRIAL_PHOTONS = 1 << 17  # per trial: about a second
PHOTON_COUNTS = 5  # numbers of photons per trial: all, one half, ...
RECEIVERS = 300  # per pose
MOST_TRIAL_PATHS = 2048  # per receiver

PosedSample = tuple[dict[str, Pose], ReferenceSample]  # the reference at one set of poses


class Trial(NamedTuple):
    """Measured errors and times of a setting, for m numbers of photons."""

    setting: Setting
    photons: np.ndarray  # (m,) int64, ascending
    alone: np.ndarray  # (m,) squared relative l1 error with that many photons, the reference's noise subtracted
    moving: np.ndarray  # (m,) the same, with the static light of the most photons
    seconds: np.ndarray  # (m,) [s] per frame


def reference_samples(
    solver: Solver, frames: Sequence[Mapping[str, Pose]], progress: Callable[[float], None], seed: int = 0
) -> list[PosedSample]:
    """Gather the reference at some poses of the mobiles, at receivers drawn by area.

    `solver` has solved; its poses change. progress(fraction) is called on the way.
    """
    out = []
    low, high = solver.chosen.low, solver.chosen.high
    for k, poses in enumerate(frames):
        solver.move_all(poses)
        receivers = solver.receivers
        static = np.zeros_like(solver.irradiance)
        static[solver.surfaces.receiver_range(0)] = solver.static_irradiance
        classes = receiver_classes(solver.surfaces, receivers, solver.irradiance, static)
        inside = ((receivers.positions >= low) & (receivers.positions <= high)).all(axis=1) & (receivers.areas > 0)
        wanted = inside & (classes["affected"] | classes["mobile"])
        rows = np.flatnonzero(wanted if wanted.any() else inside)
        rows, weights = draw_by_area(rows, receivers.areas, RECEIVERS, [seed, k])
        most = MOST_TRIAL_PATHS * len(rows)
        model, at = solver.model, dict(solver.poses)
        # 0.02 of the truth, relative l1; it is subtracted
        for sample in gather_sample(model, at, rows, weights, 1000 * seed + k, 0.02, most, solver.levels):
            progress((k + sample.fraction) / len(frames))
        out.append((dict(solver.poses), sample))
    return out


def trial(solver: Solver, samples: list[PosedSample], paths: int | None = None, **setting) -> Trial:
    """Return error and time of frames with a setting, on a twin of a solver, which shares its photons.

    An estimator without photon subsets, whose sums are not additive, is solved for each number of photons.
    paths: per receiver of a mobile, as in Solver.move_all(). setting: fields of Setting.
    """
    twin = solver.twin(fresh=True)
    twin.configure(photons=min(TRIAL_PHOTONS, solver.photons), subset_only=True, **setting)
    additive = ESTIMATORS[twin.setting.estimator].additive
    if additive:
        twin.solve()
    counts = twin.frame.subsets[-PHOTON_COUNTS:] if additive else _halved(twin.photons)
    errors, seconds = np.zeros((2, len(counts))), np.zeros((len(samples), 2, len(counts)))
    for kind, subset_only in enumerate((True, False)):
        twin.configure(subset_only=subset_only)
        for n, count in enumerate(counts):
            if not additive:
                twin.configure(photons=count)
                twin.solve()
            for p, (poses, sample) in enumerate(samples):  # innermost: mobiles move in each frame
                twin.move_all(poses, count, paths)
                errors[kind, n] += sample.squared_error(twin.irradiance) / len(samples)
                seconds[p, kind, n] = sum(twin.frame.timings.values())
    # Other load can only add time, so the minimum is taken.
    return Trial(twin.setting, np.array(counts, np.int64), *np.maximum(errors, 0.0), seconds.min(axis=1).mean(axis=0))


def _halved(photons: int) -> list[int]:
    """Return a number of photons, its half, quarter, ... of at least LOWEST, ascending; at most PHOTON_COUNTS."""
    smaller = (photons >> k for k in range(PHOTON_COUNTS - 1, 0, -1))
    return [*(n for n in smaller if n >= LOWEST), photons]


def errors_of(
    solver: Solver, samples: list[PosedSample], frame: int, paths: int | None = None
) -> tuple[float, float, int, float]:
    """Return relative l1 errors at rest and in motion, the photons of a frame in motion, and its median seconds.

    A frame in motion has the photon subset nearest to `frame` photons, and `paths` per receiver of mobiles.
    """
    subset = min(solver.frame.subsets, key=lambda n: abs(n - frame))
    at_rest = moving = 0.0
    seconds = []
    for poses, sample in samples:
        solver.move_all(poses)
        at_rest += sample.squared_error(solver.irradiance) / len(samples)
    for _ in range(3):
        for poses, sample in samples:
            solver.move_all(poses, subset, paths)
            seconds.append(sum(solver.frame.timings.values()))
            moving += sample.squared_error(solver.irradiance) / (3 * len(samples))
    at_rest, moving = (float(np.sqrt(max(e, 0.0))) for e in (at_rest, moving))
    return at_rest, moving, subset, float(np.median(seconds))

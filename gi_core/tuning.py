"""Error model fitted to trials of a few settings, and the best setting for a given time or error.

With N photons the squared error of a setting is A / N + B^2: variance, and squared bias. A frame of n of the N photons
with the static light of all (`control_variate.py`) adds M (1 / n - 1 / N). Its time is s + c n. The five parameters are
fitted to the trials of each radius. Over radii each is a fitted power law: A should fall as r^-2, B grow as r^2 in
smooth light and as r at edges of shadows. No parameter is preset for a scene. An estimator whose sums are not additive
has no photon subsets: each of its frames uses all photons.

Trials are frames of few photons. Errors are measured at receivers on mobiles and at static receivers that mobiles
change, against a reference at few of them; its known noise is subtracted.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.fixed_point import MAX_PHOTONS
from gi_core.estimators import ESTIMATORS
from gi_core.estimators.base import Setting
from gi_core.gather.reference_sample import ReferenceSample, draw_by_area, gather_sample
from gi_core.geometry.receiver_classes import receiver_classes
from gi_core.photons.flux_sums import LOWEST
from gi_core.scene.types import Pose
from gi_core.solver import Solver

TRIAL_PHOTONS = 1 << 17  # per trial: about a second
PHOTON_COUNTS = 5  # numbers of photons per trial: all, one half, ...
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
        rows, weights = draw_by_area(rows, receivers.areas, 300, [seed, k])  # per pose
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


FINE_RADII = 16  # radii evaluated, from the smallest to the largest tried
LEAST = {
    "noise": 1e-6,
    "moving": 1e-6,
    "bias": 3e-3,
    "start": 1e-5,
    "slope": 1e-12,
}  # lower bounds: smaller values are within noise of 0
SMALLEST_FRAME = 1024  # photons of a frame
EXPONENTS = {"noise": "A", "moving": "M", "bias": "B", "start": "s", "slope": "c"}


class ErrorModel(NamedTuple):
    """Predicted error and frame time of a setting, see the module."""

    setting: Setting
    noise: float  # A
    moving: float  # M
    bias: float  # B
    start: float  # s [s]
    slope: float  # c [s] per photon
    scatter: float = 0.0  # relative standard deviation of measured errors from the model; nan: too few to know

    def error(self, photons: float, frame: float | None = None) -> float:
        """Return the relative l1 error of `photons` photons, or of a frame of `frame` of them."""
        more = self.moving * max(1 / frame - 1 / photons, 0.0) if frame else 0.0
        return math.sqrt(self.noise / photons + more + self.bias**2)

    def seconds(self, photons: float) -> float:
        """Return the time of a frame [s]."""
        return self.start + self.slope * photons

    def photons_within(self, seconds: float) -> float:
        """Return the photons of a frame of the given time [s]."""
        return max((seconds - self.start) / max(self.slope, 1e-15), 0.0)

    def photons_for(self, error: float) -> float:
        """Return the photons for a relative l1 error; inf if the bias exceeds it."""
        left = error**2 - self.bias**2
        return self.noise / left if left > 0 else math.inf


class TunedChoice(NamedTuple):
    """A chosen setting and its predicted errors and frame time."""

    setting: Setting
    photons: int  # at rest
    frame: int  # photons of a frame in motion
    error: float  # relative l1 at rest, at receivers that mobiles change
    moving_error: float  # the same in motion
    seconds: float  # [s] per frame of `frame` photons
    met: bool  # whether the requested time or error is reached


def fitted(trial: Trial) -> ErrorModel:
    """Return the least-squares fit to the squared errors and the times of a trial."""
    inverse = 1 / trial.photons
    noise, bias2 = _line(inverse, trial.alone)
    apart = inverse - inverse[-1]
    more = trial.moving - trial.alone[-1]
    moving = max(float((apart * more).sum() / max((apart * apart).sum(), 1e-300)), 0.0) if len(apart) > 1 else noise
    slope, start = _line(trial.photons.astype(float), trial.seconds)
    if slope == 0:  # time does not grow with photons: use the slowest
        slope, start = float(trial.seconds[-1] / trial.photons[-1]), 0.0
    return ErrorModel(trial.setting, noise, moving, math.sqrt(bias2), start, slope, _scatter(trial, noise, bias2))


def _scatter(trial: Trial, noise: float, bias2: float) -> float:
    """Return the relative standard deviation of the measured errors from those of the fit; nan for too few of them."""
    model = noise / trial.photons + bias2
    if len(model) < 3 or not (model > 0).all():
        return math.nan
    off = trial.alone / model - 1  # of squared errors
    return 0.5 * math.sqrt(float((off * off).sum()) / (len(off) - 2))


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return slope and intercept, both >= 0, of the least-squares line by relative distance."""
    if len(x) == 1:
        return float(y[0] / x[0]), 0.0
    weight = 1 / np.maximum(y, 1e-3 * max(float(y.max()), 1e-30))
    columns = np.stack([x, np.ones(len(x))], axis=1) * weight[:, None]
    (slope, intercept), *_ = np.linalg.lstsq(columns, y * weight, rcond=None)
    if slope < 0:
        return 0.0, float(np.average(y, weights=weight))
    if intercept < 0:
        return float((columns[:, 0] * y * weight).sum() / (columns[:, 0] ** 2).sum()), 0.0
    return float(slope), float(intercept)


def between_radii(models: Sequence[ErrorModel]) -> tuple[list[ErrorModel], dict[str, dict[str, float]]]:
    """Return models at FINE_RADII radii of estimators tried at several radii, the other models as given, and exponents.

    exponents: by estimator, as over_radii() returns them.
    """
    made: list[ErrorModel] = []
    exponents = {}
    for name in dict.fromkeys(model.setting.estimator for model in models):
        own = [model for model in models if model.setting.estimator == name]
        if len({model.setting.radius for model in own}) > 1:
            own, exponents[name] = over_radii(own)
        made += own
    return made, exponents


def over_radii(models: Sequence[ErrorModel]) -> tuple[list[ErrorModel], dict[str, float]]:
    """Return models at FINE_RADII radii over the range of `models` (one per radius), and the exponents by parameter."""
    if len(models) < 2:
        return list(models), {}
    tried = np.log([model.setting.radius for model in models])
    fine = np.linspace(tried.min(), tried.max(), FINE_RADII)
    parts, exponents = {}, {}
    for name, letter in EXPONENTS.items():
        values = np.log(np.maximum([getattr(model, name) for model in models], LEAST[name]))
        exponents[letter], level = (float(v) for v in np.polyfit(tried, values, 1))
        parts[name] = np.exp(level + exponents[letter] * fine)
    setting, scatter = models[0].setting, mean_scatter(models)
    made = [
        ErrorModel(
            setting._replace(radius=float(f"{math.exp(r):.3g}")),
            **{name: float(v[i]) for name, v in parts.items()},
            scatter=scatter,
        )
        for i, r in enumerate(fine)
    ]
    return made, exponents


def mean_scatter(models: Iterable[ErrorModel]) -> float:
    """Return the root mean square of the scatter of models; nan where one is unknown."""
    return math.sqrt(statistics.fmean(model.scatter**2 for model in models))


def within_time(models: Sequence[ErrorModel], seconds: float, photons: int) -> TunedChoice:
    """Return the setting with the least error in motion within a frame time [s], with `photons` at rest."""

    def choice_of(model: ErrorModel) -> TunedChoice:
        room = model.photons_within(seconds)
        frame = min(max(room, SMALLEST_FRAME), photons)
        return _choice(model, photons if _is_additive(model) else frame, frame, room >= SMALLEST_FRAME)

    return max(map(choice_of, models), key=lambda choice: (choice.met, -choice.moving_error))


def within_error(models: Sequence[ErrorModel], error: float, seconds: float, most: int) -> TunedChoice:
    """Return the fastest setting that reaches a relative l1 error, or that of least error with `most` photons.

    seconds: time of a frame in motion [s], which uses as many of the photons as fit.
    """
    most = min(most, MAX_PHOTONS)

    def choice_of(model: ErrorModel) -> TunedChoice:
        needed = model.photons_for(error)
        photons = max(math.ceil(min(needed, most)), SMALLEST_FRAME)
        frame = min(max(model.photons_within(seconds), SMALLEST_FRAME), photons) if _is_additive(model) else photons
        return _choice(model, photons, frame, needed <= most)

    def order(pair: tuple[ErrorModel, TunedChoice]) -> tuple:
        model, choice = pair
        return choice.met, -model.seconds(choice.photons) if choice.met else -choice.error

    return max(((model, choice_of(model)) for model in models), key=order)[1]


def _choice(model: ErrorModel, photons: float, frame: float, met: bool) -> TunedChoice:
    return TunedChoice(
        model.setting,
        int(photons),
        int(frame),
        model.error(photons),
        model.error(photons, frame),
        model.seconds(frame),
        met,
    )


def _is_additive(model: ErrorModel) -> bool:
    return ESTIMATORS[model.setting.estimator].additive

"""Automatic settings: trials on the scene, then the best setting that the fitted error models predict."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from typing import NamedTuple

from app.draw.motion import paths_of, spread
from gi_core import tuning
from gi_core.estimators import ESTIMATORS
from gi_core.solver import Solver
from gi_core.tuning import ErrorModel, TunedChoice

TRIAL_RADII = (0.5, 0.71, 1.0, 1.41, 2.0)  # of the current radius


class Tuned(NamedTuple):
    """A chosen setting and the error models behind it."""

    choice: TunedChoice
    models: tuple[ErrorModel, ...]  # one per trial
    exponents: dict[str, dict[str, float]]  # by estimator: power of the radius per part of the model
    paths: int | None = None  # per mobile vertex and frame; None: photons light the mobiles
    by_law: tuple[ErrorModel, ...] = ()  # at radii between, by the power laws fitted to the trials; the choice's among


def tune(solver: Solver, budget: float, bar: Callable[[str, float], None], error: float | None = None) -> Tuned:
    """Try settings on twins of a solved solver; return the choice. bar(stage, fraction) is called on the way.

    budget: [s] per frame in motion; error: relative l1 at rest to reach, None: the least error in motion within the
    budget.
    """
    judge = solver.twin()
    frames = _frames(solver)
    paths = _paths(judge, frames, budget)
    samples = tuning.reference_samples(judge, frames, lambda done: bar("tracing the reference", 0.3 * done))
    fits, every = [], candidates(solver)
    for k, candidate in enumerate(every):
        bar(f"trying {candidate['estimator']}", 0.3 + 0.7 * k / len(every))
        fits.append(tuning.fitted(tuning.trial(judge, samples, paths, **candidate)))
    interpolated, exponents = tuning.between_radii(fits)
    if error is None:
        choice = tuning.within_time(interpolated, budget, solver.photons)
    else:
        choice = tuning.within_error(interpolated, error, budget, 4_000_000)
    return Tuned(choice, tuple(fits), exponents, paths, tuple(interpolated))


def compared(tuned: Tuned, budget: float) -> list[tuple[float, bool]]:
    """Return the predicted error in motion of each setting tried, and whether it differs from the choice's in noise.

    budget: [s] per frame. In noise: by less than both are uncertain, which is the scatter of measured errors about
    their model and, of an estimator tried at several radii, that of models about their power laws.
    """
    c = tuned.choice

    def error(model: ErrorModel) -> float:
        return tuning.within_time([model], budget, c.photons).moving_error

    def apart(model: ErrorModel) -> float:
        laws = (m for m in tuned.by_law if m.setting.estimator == model.setting.estimator)
        law = min(laws, key=lambda m: abs(math.log(m.setting.radius / model.setting.radius)), default=model)
        return error(model) / error(law) - 1

    def uncertainty(estimator: str) -> float:
        alike = [m for m in tuned.models if m.setting.estimator == estimator]
        return math.hypot(tuning.mean_scatter(alike), math.sqrt(statistics.fmean(apart(m) ** 2 for m in alike)))

    own, out = uncertainty(c.setting.estimator) * c.moving_error, []
    for model in tuned.models:
        e = error(model)
        out.append((e, abs(e - c.moving_error) < math.hypot(own, uncertainty(model.setting.estimator) * e)))
    return out


def candidates(solver: Solver) -> list[dict]:
    """Return the settings to try, as fields of Setting."""
    radii = [r * solver.setting.radius for r in TRIAL_RADII]
    tried: dict[str | None, list] = {"radius": radii, "neighbours": [80], None: [None]}
    return [
        {"estimator": name} | ({kind.smoothing: value} if kind.smoothing else {})
        for name, kind in ESTIMATORS.items()
        for value in tried[kind.smoothing]
    ]


def _paths(solver: Solver, frames: list, budget: float) -> int | None:
    """Return the paths per mobile vertex that fit a frame of `budget` [s], after frames of two path counts."""
    for k, few in enumerate((None, 4) * 3):  # 3 timed frames per number of paths
        solver.move_all(frames[k // 2 % len(frames)], None, few)  # each at another pose than the last of its count
    return solver.size_within(budget)[1]


def measured(solver: Solver, tuned: Tuned, bar: Callable[[str, float], None]) -> tuple[float, float, int, float]:
    """Return measured errors at rest and in motion, photons and seconds of the choice's frame."""
    choice, (judge, samples) = tuned.choice, judged(solver, lambda done: bar("checking", done))
    judge.configure(photons=choice.photons, **choice.setting._asdict())
    judge.solve()
    return tuning.errors_of(judge, samples, choice.frame, tuned.paths)


def judged(solver: Solver, progress: Callable[[float], None]) -> tuple[Solver, list]:
    """Return a twin and references independent of those that chose the setting."""
    judge = solver.twin()
    return judge, tuning.reference_samples(judge, _frames(solver), progress, seed=1)


def _frames(solver: Solver) -> list:
    """Return the poses of the trials."""
    return spread(paths_of(solver), 4)[1:-1]  # two poses, without the ends of the path

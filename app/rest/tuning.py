"""Automatic settings: trials on the scene, then the best setting that the fitted error models predict."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

if TYPE_CHECKING:
    from gi_core.solver import Solver
    from gi_core.tuning.error_model import ErrorModel, TunedChoice

Result = TypeVar("Result")
TRIAL_RADII = (0.5, 0.71, 1.0, 1.41, 2.0)  # of the current radius
TRIAL_NEIGHBOURS = 80
TRIAL_POSES = 2  # along the path
FRAMES_PER_COUNT = 3  # timed frames per number of paths
MOST_PHOTONS = 4_000_000


class Tuned(NamedTuple):
    """A chosen setting and the error models behind it."""

    choice: TunedChoice
    models: tuple[ErrorModel, ...]  # one per trial
    exponents: dict[str, dict[str, float]]  # by estimator: power of the radius per part of the model
    paths: int | None = None  # per mobile vertex and frame; None: photons light the mobiles


def tune(solver: Solver, budget: float, error: float | None = None) -> Generator[tuple[str, float], None, Tuned]:
    """Try settings on twins of a solved solver; yield stage and fraction, return the choice.

    budget: [s] per frame in motion; error: relative l1 at rest to reach, None: the least error in motion within the
    budget.
    """
    from gi_core.tuning import error_model, setting_trials

    judge = solver.twin()
    frames = _frames(solver)
    paths = _paths(judge, frames, budget)
    samples = yield from _staged("tracing the reference", setting_trials.reference_samples(judge, frames), 0.0, 0.3)
    found, every = [], candidates(solver)
    for k, candidate in enumerate(every):
        share = 0.3 + 0.7 * k / len(every)
        stage = f"trying {candidate['estimator']}"
        tried = yield from _staged(stage, setting_trials.trial(judge, samples, paths, **candidate), share, 0.0)
        found.append(error_model.fitted(tried))
    known, exponents = error_model.between_radii(found)
    if error is None:
        choice = error_model.within_time(known, budget, solver.photons)
    else:
        choice = error_model.within_error(known, error, budget, MOST_PHOTONS)
    return Tuned(choice, tuple(found), exponents, paths)


def candidates(solver: Solver) -> list[dict]:
    """Return the settings to try, as fields of Setting."""
    from gi_core.estimators import ESTIMATORS

    radii = [r * solver.radius for r in TRIAL_RADII]
    tried: dict[str | None, list] = {"radius": radii, "neighbours": [TRIAL_NEIGHBOURS], None: [None]}
    return [
        {"estimator": name} | ({kind.smoothing: value} if kind.smoothing else {})
        for name, kind in ESTIMATORS.items()
        for value in tried[kind.smoothing]
    ]


def _paths(solver: Solver, frames: list, budget: float) -> int | None:
    """Return the paths per mobile vertex that fit a frame of `budget` [s], after frames of two path counts."""
    for k, few in enumerate((None, 4) * FRAMES_PER_COUNT):
        solver.move_all(frames[k // 2 % len(frames)], None, few)  # each at another pose than the last of its count
    return solver.size_within(budget)[1]


def measured(solver: Solver, found: Tuned) -> tuple[float, float, int, float]:
    """Return measured errors at rest and in motion, photons and seconds of the choice's frame."""
    from gi_core.tuning import setting_trials

    choice, (judge, samples) = found.choice, judged(solver)
    judge.configure(photons=choice.photons, **choice.setting._asdict())
    judge.solve()
    return setting_trials.errors_of(judge, samples, choice.frame, found.paths)


def judged(solver: Solver) -> tuple[Solver, list]:
    """Return a twin and references independent of those that chose the setting."""
    from gi_core.tuning import setting_trials

    judge = solver.twin()
    return judge, _returned(setting_trials.reference_samples(judge, _frames(solver), seed=1))


def _frames(solver: Solver) -> list:
    """Return the poses of the trials."""
    from app.draw.motion import paths_of, spread

    return spread(paths_of(solver), TRIAL_POSES + 2)[1:-1]


def _returned(steps: Generator[Any, None, Result]) -> Result:
    """Run steps to their end; return their result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def _staged(
    stage: str, steps: Generator[Any, None, Result], start: float, share: float
) -> Generator[tuple[str, float], None, Result]:
    """Run steps, yielding stage and fraction; return their result."""
    while True:
        try:
            done = next(steps)
        except StopIteration as end:
            return end.value
        yield stage, start + share * (done or 0.0)


def finished(steps, bar) -> Tuned:
    """Run tune() to its end, showing progress; return its result."""
    while True:
        try:
            bar(*next(steps))
        except StopIteration as end:
            return end.value

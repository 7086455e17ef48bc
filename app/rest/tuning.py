"""Settings that choose themselves: trials on the scene at hand, then the best that their laws foretell."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from gi_core.solver import Solver
    from gi_core.tuning.error_model import Choice, Law

RADII = (0.5, 0.71, 1.0, 1.41, 2.0)  # of the radius in use
NEIGHBOURS = 80
POSES = 2  # along the path
TRIES = 3  # frames of each number of paths
MOST_PHOTONS = 4_000_000


class Tuned(NamedTuple):
    """The choice and what it was chosen from."""

    choice: Choice
    laws: tuple[Law, ...]  # one a trial
    exponents: dict[str, dict[str, float]]  # by estimator: of the disc's radius in each part of the law
    paths: int | None = None  # that mobiles gather in a frame; None: their light is the photons'


def tune(solver: Solver, budget: float, error: float | None = None) -> Generator[tuple[str, float], None, Tuned]:
    """Try settings on twins of a solver that has solved; yields what is being done and the share of it that is done.

    budget: [s] a frame may take while something moves; error: relative l1 wanted at rest, None: the least that the
    budget allows in motion.
    """
    from gi_core.tuning import error_model, setting_trials

    judge = solver.twin()
    frames = _frames(solver)
    paths = _paths(judge, frames, budget)
    sticks = yield from _told("measuring the truth", setting_trials.yardsticks(judge, frames), 0.0, 0.3)
    found, every = [], candidates(solver)
    for k, candidate in enumerate(every):
        share = 0.3 + 0.7 * k / len(every)
        what = f"trying {candidate['estimator']}"
        tried = yield from _told(what, setting_trials.trial(judge, sticks, paths, **candidate), share, 0.0)
        found.append(error_model.law_of(tried))
    known, exponents = error_model.between_radii(found)
    if error is None:
        choice = error_model.within_time(known, budget, solver.photons)
    else:
        choice = error_model.within_error(known, error, budget, MOST_PHOTONS)
    return Tuned(choice, tuple(found), exponents, paths)


def candidates(solver: Solver) -> list[dict]:
    """Return the settings that are tried, as fields of Setting."""
    from gi_core.estimators import ESTIMATORS

    tried = {"radius": [r * solver.radius for r in RADII], "neighbours": [NEIGHBOURS], None: [None]}
    return [
        {"estimator": name} | ({kind.smoothing: value} if kind.smoothing else {})
        for name, kind in ESTIMATORS.items()
        for value in tried[kind.smoothing]
    ]


def _paths(solver: Solver, frames: list, budget: float) -> int | None:
    """Return how many paths mobiles will gather in frames of that time, after trying two numbers of them."""
    for k, few in enumerate((None, 4) * TRIES):
        solver.move_all(frames[k // 2 % len(frames)], None, few)  # each elsewhere than the one of as many before
    return solver.size_within(budget)[1]


def measured(solver: Solver, found: Tuned) -> tuple[float, float, int, float]:
    """Return what a choice really does: errors at rest and in motion, photons of that frame, its seconds."""
    from gi_core.tuning import setting_trials

    choice, (judge, sticks) = found.choice, judged(solver)
    judge.configure(photons=choice.photons, **choice.setting._asdict())
    judge.solve()
    return setting_trials.errors_of(judge, sticks, choice.frame, found.paths)


def judged(solver: Solver) -> tuple[Solver, list]:
    """Return a twin, and yardsticks other than those that settings are chosen by."""
    from gi_core.tuning import setting_trials

    judge = solver.twin()
    return judge, _returned(setting_trials.yardsticks(judge, _frames(solver), seed=1))


def _frames(solver: Solver) -> list:
    """Return the poses at which settings are tried."""
    from app.draw.motion import paths_of, spread

    return spread(paths_of(solver), POSES + 2)[1:-1]


def _returned(steps: Generator):
    """Run steps to their end; return what they return."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def _told(what: str, steps: Generator, start: float, share: float) -> Generator:
    """Run steps, telling each; return what they return."""
    while True:
        try:
            done = next(steps)
        except StopIteration as end:
            return end.value
        yield what, start + share * (done or 0.0)


def finished(steps, bar) -> Tuned:
    """Run tune() to its end, with the bar moving; return what it returns."""
    while True:
        try:
            bar(*next(steps))
        except StopIteration as end:
            return end.value

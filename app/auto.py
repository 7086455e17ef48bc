"""Settings that choose themselves in the window: trials in pieces while everything rests, then the choice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from app.background import without_frames

if TYPE_CHECKING:
    from app.settings import Settings
    from app.tuning import Tuned
    from gi_core.solver import Solver


class Doing(NamedTuple):
    """What the panel tells meanwhile."""

    what: str
    fraction: float


class Auto:
    """Trials for one budget and error. `next_work` hands out pieces for the solver's thread; then look at `found`."""

    def __init__(self, solver: Solver, settings: Settings) -> None:
        from app.tuning import tune

        self.settings = settings
        self.found: Tuned | None = None
        self.problem: Exception | None = None
        self.doing = Doing("trying settings", 0.0)
        error = None if settings.error is None else 1e-2 * settings.error
        self._steps = tune(solver, 1e-3 * (settings.budget or type(settings).budget), error)

    @property
    def done(self) -> bool:
        return self.found is not None or self.problem is not None

    def next_work(self) -> Callable[[], None] | None:
        return None if self.done else self._step

    def _step(self) -> None:
        try:
            self.doing = Doing(*next(self._steps))
        except StopIteration as end:
            self.found = end.value
        except Exception as problem:
            self.problem = without_frames(problem)

    def told(self) -> list[str]:
        """Return what was chosen and what is expected of it, in words."""
        from app.tune_command import told

        return told(self.found, self.settings.budget or type(self.settings).budget, self.settings.error)

    def taken_over(self, settings: Settings) -> Settings:
        """Return settings with what was chosen."""
        c = self.found.choice
        s = c.setting
        return replace(
            settings, estimator=s.estimator, photons=c.photons, radius=s.radius, neighbours=s.neighbours,
            control=s.control,
        )  # fmt: skip

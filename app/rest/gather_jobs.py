"""Jobs of gathering light at rest, in short tasks: the static part's, with its file, and that at the present poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from app.rest.results import GatherProgress
from gi_core.base.pause import Interrupted

if TYPE_CHECKING:
    from gi_core.base.pause import Progress
    from gi_core.gather.estimate import Estimate
    from gi_core.gather.pose_gather import PoseGather
    from gi_core.solver import Solver


class StaticJob:
    """One per solver; only the solver's thread uses it."""

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        self._solver, self._clock = solver, clock
        self.steps: Iterator[Progress] | None = None
        self._saved_at = 0.0
        self._saved: tuple | None = None  # photons, and noise and sets of gathered light, in the file

    @property
    def progress(self) -> GatherProgress:
        solver, light = self._solver, self._solver.frame_light
        g, error = light.static.gathered, light.static.error(solver.levels)
        return GatherProgress(g.fraction if g else 0.0, error, light.is_gathered)

    def next_work(self) -> Callable[[], bool] | None:
        """Return the next task, None at the end; the task returns whether irradiance has changed."""
        light = self._solver.frame_light
        g = light.static.gathered
        finished = self.steps is None and g is not None and g.enough  # its light is in the picture
        finished = finished and not light.lacks_gloss(self._solver.frame.background)
        return None if self._solver.light != "best" or finished else self._step

    def _step(self) -> bool:
        from app.rest.reference_store import SAVE_SECONDS, StaticStore

        solver, static = self._solver, self._solver.frame_light.static
        if self.steps is None:
            if static.gathered is None:
                static.gathered = StaticStore(solver.model, solver.seed).load()
            self.steps = solver.gather_steps()
            self._saved_at = self._clock()
        progress = next(self.steps, None)
        if progress is None:
            self.steps = None
        if progress is None or static.gathered.enough or self._clock() - self._saved_at > SAVE_SECONDS:
            self.keep()
        return progress is not None and progress.picture

    def keep(self) -> None:
        """Save the light on show and its paths if the file has others."""
        from app.rest.reference_store import StaticStore

        solver = self._solver
        b, g = solver.frame.background, solver.frame_light.static.gathered
        photons = 0 if b is None else b.estimate.photons
        now = photons, g and g.noise, g and g.state and int(g.state.sets.sum())
        store = StaticStore(solver.model, solver.seed)
        if solver.light != "best" or now == self._saved or not (g or (photons and not store.path.exists())):
            return  # a file that was not read may have less error
        store.keep_light(solver.frame_light.static, b)
        self._saved_at, self._saved = self._clock(), now


class PoseJob:
    """One per solver; only the solver's thread uses it."""

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self.steps: Iterator[Progress] | None = None
        self._begun: tuple | None = None  # poses, photons and levels of the steps

    @property
    def light(self) -> PoseGather | None:
        """The light at the present poses, None before the first step."""
        s = self._solver
        return s.frame_light.gathered_at(s.model.transforms(s.poses))

    def next_work(self) -> Callable[[], bool] | None:
        """Return the next task, None at the end; the task returns whether irradiance has changed."""
        solver = self._solver
        if solver.light != "best" or not solver.model.names or not solver.frame.photons:
            return None
        if self._begun != (now := (solver.poses, solver.frame.photons, solver.levels.tobytes())):
            self._begun, self.steps = now, solver.gather_pose_steps()
        return None if self.steps is None else self._step

    def _step(self) -> bool:
        try:
            progress = next(self.steps, None)
        except Interrupted:
            self._begun = None  # the frame was broken off, and the steps with it
            raise
        if progress is None:
            self.steps = None
        return progress is not None and progress.picture


def restore(solver: Solver, light: Estimate) -> None:
    """Show static light gathered by another solver of the same scene and settings."""
    from gi_core.gather.static import StaticGather

    static = solver.frame_light.static
    static.gathered = StaticGather(solver.model, solver.seed)
    static.gathered.estimate = light
    for progress in solver.gather_steps():
        if progress.stage == "gathering":
            return  # shown, and not a path traced

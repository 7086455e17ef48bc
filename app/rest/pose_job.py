"""The job of gathering light at the present poses, in short tasks: see `gi_core.gather.pose_gather`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from gi_core.frames.progress import Interrupted

if TYPE_CHECKING:
    from gi_core.frames.progress import Progress
    from gi_core.gather.pose_gather import PoseGather
    from gi_core.solver import Solver


class PoseJob:
    """One per solver; only the solver's thread uses it."""

    def __init__(self, solver: Solver, stop: Callable[[], bool] | None = None) -> None:
        self._solver, self._stop = solver, stop
        self._steps: Iterator[Progress] | None = None
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
            self._begun, self._steps = now, solver.gather_pose_steps(self._stop)
        return None if self._steps is None else self._step

    def _step(self) -> bool:
        try:
            progress = next(self._steps, None)
        except Interrupted:
            self._begun = None  # the frame was broken off, and the steps with it
            raise
        if progress is None:
            self._steps = None
        return progress is not None and progress.picture

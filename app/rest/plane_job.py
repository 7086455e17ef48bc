"""The job of measuring a plane at the present poses, in short tasks; see `app.rest.measuring_plane`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.rest.measuring_plane import Level, PlaneLight
    from app.settings import MeasuringPlane
    from gi_core.solver import Solver


class PlaneJob:
    """One per solver; only the solver's thread uses it."""

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self._steps: Iterator[PlaneLight] | None = None
        self._begun: tuple | None = None  # plane, poses and levels of the steps
        self._level: Level | None = None
        self._plane: MeasuringPlane | None = None
        self._light: PlaneLight | None = None
        self._lit: tuple | None = None  # plane, poses and levels of the light

    @property
    def light(self) -> PlaneLight | None:
        """The light on the plane; None without one, or before the first result."""
        if self._light is None or self._plane is None:
            return None
        return self._light._replace(is_current=self._lit == self._asked())

    def next_work(self, plane: MeasuringPlane | None) -> Callable[[], None] | None:
        """Return the next task of a plane, None at the end."""
        self._plane = plane
        if plane is None:
            self._begun = self._steps = self._light = None
            return None
        if self._begun != (asked := self._asked()):
            from app.rest.measuring_plane import level_of, plane_steps

            s = self._solver
            self._level = self._level or level_of(s.model)
            self._begun, self._steps = asked, plane_steps(s.model, plane, self._level, s.poses, s.levels, s.seed)
        return None if self._steps is None else self._step

    def _asked(self) -> tuple:
        return self._plane, tuple(sorted(self._solver.poses.items())), self._solver.levels.tobytes()

    def _step(self) -> None:
        light = next(self._steps, None)
        if light is None:
            self._steps = None
        elif light.fraction > 0:  # the old light stays until there is some
            self._light, self._lit = light, self._begun

"""Jobs at rest: work in short steps, begun for a key and again for another one."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from app.draw.draw_mesh import DrawMesh, meshes_of
from app.draw.fine_mesh import fine_light, fine_meshes, fine_points_of, takes_fine_points
from app.rest.calculation_surface import SurfaceLight, all_steps, maintained_levels, surfaces_of
from app.rest.hold import HeldResult, Inputs, Measured, inputs_of, measured_steps, result_of
from app.rest.reference_store import SAVE_SECONDS, StaticStore
from app.rest.results import Asked, Change, FinePicture, GatherProgress
from app.rest.surface_grid import Level, level_of
from app.settings import CHANGE, Pin, Settings, State
from app.worker import Task
from gi_core.base.pause import Progress, pause, steps
from gi_core.display.fine_points import FinePoints
from gi_core.frames.held_light import HeldLevels
from gi_core.gather.origins import Origins, origin_steps
from gi_core.gather.pose_gather import PoseGather
from gi_core.scene import Pose
from gi_core.scene.pose import to_world, to_world_directions
from gi_core.scene.types import CalculationSurface
from gi_core.scene.validate import parts_of
from gi_core.solver import Solver


class Job:
    """One per solver and kind of work; only the solver's thread uses it."""

    name = ""  # the log names it after a failure

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self.restart()

    def key(self, settings: Settings) -> Any:
        """Return the inputs of the steps, None without work."""
        raise NotImplementedError

    def begin(self) -> Iterator:
        """Return the steps of the present key. They refer to no job: that would be a reference cycle."""
        raise NotImplementedError

    def take(self, result: Any) -> bool:
        """Take over the result of a step; return whether irradiance has changed."""
        return isinstance(result, Progress) and result.picture

    def restart(self) -> None:
        """Drop the steps, and the results that belong to the light."""
        self._key: Any = None
        self._steps: Iterator | None = None  # None: not begun
        self._ended = False

    def drop(self) -> None:
        """Free all that nothing wants any more."""
        self.restart()

    def want(self, settings: Settings) -> None:
        """Follow the settings and the solver."""
        key = self.key(settings)
        if key is None:
            self.drop()
        elif key != self._key:
            self.restart()
            self._key = key

    def tasks(self) -> Iterable[Task]:
        """Return the tasks that are due, the most urgent first."""
        return () if self._key is None or self._ended else (Task(self.name, self.step),)

    def step(self) -> bool:
        """Advance by a step; return whether irradiance has changed. Steps that raise begin again."""
        steps, self._steps = self._steps or self.begin(), None
        for result in steps:
            self._steps = steps
            return self.take(result)
        self._ended = True
        return False


def first_task(jobs: Sequence[Job], settings: Settings, given_up: Collection[str] = ()) -> Task | None:
    """Return the first task of a kind not given up, None at the end of all jobs."""
    for job in jobs:
        job.want(settings)
    return next((task for job in jobs for task in job.tasks() if task.name not in given_up), None)


class StaticJob(Job):
    """Gathers the static part's light, and saves it."""

    name = "gathering the static light"

    def __init__(self, solver: Solver, clock: Callable[[], float]) -> None:
        super().__init__(solver)
        self._clock, self._saved_at = clock, 0.0
        self._saved: tuple | None = None  # photons, and noise and sets of gathered light, in the file

    @property
    def progress(self) -> GatherProgress:
        solver, light = self._solver, self._solver.frame_light
        g, error = light.static.gathered, light.static.error(solver.levels)
        return GatherProgress(g.fraction if g else 0.0, error, light.is_gathered)

    def key(self, settings: Settings) -> bool | None:
        light = self._solver.frame_light
        g = light.static.gathered
        finished = self._steps is None and g is not None and g.enough  # its light is in the picture
        finished = finished and not light.lacks_gloss(self._solver.frame.background)
        return None if self._solver.light != "best" or finished else True

    def begin(self) -> Iterator:
        solver, static = self._solver, self._solver.frame_light.static
        if static.gathered is None:
            static.gathered = StaticStore(solver.model, solver.seed).load()
        self._saved_at = self._clock()
        return solver.gather_steps()

    def step(self) -> bool:
        changed, enough = super().step(), self._solver.frame_light.static.gathered.enough
        if self._ended or enough or self._clock() - self._saved_at > SAVE_SECONDS:
            self.keep()
        self._ended = False  # photons may come that lack gloss
        return changed

    def keep(self) -> None:
        """Save the light on show and its paths if the file has others."""
        solver = self._solver
        static, store = solver.frame_light.static, StaticStore(solver.model, solver.seed)
        g, best = static.gathered, static.best
        now = best and best.error, g and g.noise, g and g.state and int(g.state.sets.sum())
        if solver.light != "best" or now == self._saved or not (g or (best and not store.path.exists())):
            return  # a file that was not read may have less error
        store.keep_light(static)
        self._saved_at, self._saved = self._clock(), now


class PoseJob(Job):
    """Gathers the light at the present poses."""

    name = "gathering the light at these poses"

    @property
    def light(self) -> PoseGather | None:
        """The light at the present poses, None before the first step."""
        s = self._solver
        return s.frame_light.gathered_at(s.model.transforms(s.poses))

    def key(self, settings: Settings) -> tuple | None:
        s = self._solver
        asked = s.light == "best" and s.model.names and s.frame.photons
        asked = asked and s.frame.gathered == s.frame_light.is_gathered  # else the frame is of earlier static light
        return (s.frame.photons, *state_of(s)) if asked else None

    def begin(self) -> Iterator:
        return self._solver.gather_pose_steps()


class FineJob(Job):
    """Finds the fine points of the present poses. Those of earlier poses stay on show until then."""

    name = "refining the picture"

    def __init__(self, solver: Solver) -> None:
        super().__init__(solver)
        self._found: list[tuple[FinePoints, tuple[DrawMesh, ...]]] = []  # the last ones
        self._lit: tuple[FinePoints, np.ndarray, FinePicture] | None = None  # points, the frame's light, and theirs

    @property
    def light(self) -> FinePicture | None:
        """The light of fine points in the frame on show, and the meshes that have them; None: the picture has none."""
        s = self._solver
        if not self._found:
            return None
        points, meshes = self._found[-1]
        if self._lit is None or self._lit[0] is not points or self._lit[1] is not s.irradiance:
            self._lit = points, s.irradiance, FinePicture(fine_light(s, points), meshes)
        return self._lit[2]

    def key(self, settings: Settings) -> tuple | None:
        s = self._solver
        return (s.poses,) if takes_fine_points(s) else None

    def begin(self) -> Iterator:
        return steps(partial(_refine, self._solver, self._found))

    def drop(self) -> None:
        super().drop()
        self._found, self._lit = [], None


def _refine(solver: Solver, out: list[tuple[FinePoints, tuple[DrawMesh, ...]]]) -> None:
    """Write the fine points of a solver's poses, and the meshes that have them, in place of earlier ones.

    The first ones show round after round; those of further poses once they are complete.
    """
    meshes = meshes_of(solver.model)
    rounds = fine_points_of(solver, meshes)
    for points in deque(rounds, maxlen=1) if out else rounds:
        out[:] = [(points, fine_meshes(meshes, points))]
        pause(Progress("refining the picture", 1.0, True))


class HoldJob(Job):
    """Lets frames hold the targets of surfaces, see `app.rest.hold`."""

    name = "finding levels"

    def __init__(self, solver: Solver) -> None:
        super().__init__(solver)
        self.fraction = 0.0  # of the levels' search
        self._measured: Measured | None = None
        self._result: tuple[HeldLevels, HeldResult] | None = None  # of the last frame

    @property
    def result(self) -> HeldResult | None:
        """What holds in the frame on show."""
        if self._measured is None or (answer := self._solver.frame.held) is None:
            return None
        if self._result is None or self._result[0] is not answer:
            self._result = answer, result_of(*self._measured, answer)
        return self._result[1]

    def key(self, settings: Settings) -> Inputs | str | None:
        of = inputs_of(settings, self._solver.scene, moving=True)
        if of is None or not of.surfaces:
            return None if self._measured is None else "release"
        return of

    def begin(self) -> Iterator:
        if isinstance(self._key, str):
            return iter([(1.0, None)])
        return measured_steps(self._solver.model, self._key, self._solver.seed)

    def take(self, result: tuple[float, Measured | None]) -> bool:
        self.fraction = result[0]
        if ended := self.fraction == 1:
            self._measured = result[1]
            self._solver.hold(None if result[1] is None else result[1][0])
        return ended


class SurfacesJob(Job):
    """Measures calculation surfaces at the present poses; see `app.rest.calculation_surface`."""

    name = "measuring surfaces"

    def __init__(self, solver: Solver) -> None:
        super().__init__(solver)
        self._level: Level | None = None
        self._lights: dict[CalculationSurface, tuple[SurfaceLight, tuple]] = {}  # and the state they are of

    @property
    def lights(self) -> tuple[SurfaceLight, ...]:
        """The light on each surface that has a result, of this state or of an earlier one."""
        if self._key is None:
            return ()
        state = (self._key[1], *state_of(self._solver))
        kept = [self._lights[s] for s in self._key[0] if s in self._lights]
        return tuple(light._replace(is_current=of == state) for light, of in kept)

    def key(self, settings: Settings) -> tuple | None:
        s = self._solver
        held = [] if s.frame.held is None else [of.surface for of in s.frame_light.held.surfaces]
        placed = (x for x in surfaces_of(settings, s.scene) if not x.on or x.on in parts_of(s.scene))
        surfaces = tuple(x for x in placed if x not in held)
        if not surfaces:
            return None
        return surfaces, maintained_levels(s.model, s.levels, settings).tobytes(), *state_of(s)

    def begin(self) -> Iterator:
        s = self._solver
        self._level = self._level or level_of(s.model)
        done = [light.surface for light in self.lights if light.is_current and light.fraction == 1]
        left = [surface for surface in self._key[0] if surface not in done]
        levels = np.frombuffer(self._key[1]).reshape(s.levels.shape)
        return all_steps(s.model, left, self._level, s.poses, levels, s.seed)

    def take(self, result: tuple[SurfaceLight, ...]) -> bool:
        # earlier light stays until its successor has values
        kept = {s: self._lights[s] for s in self._key[0] if s in self._lights}
        self._lights = kept | {light.surface: (light, self._key[1:]) for light in result if light.fraction > 0}
        return False

    def drop(self) -> None:
        super().drop()
        self._lights = {}


class AskedJob(Job):
    """Finds where the light at the asked pin comes from; see `gi_core.gather.origins`."""

    name = "asking a pin"

    def __init__(self, solver: Solver) -> None:
        super().__init__(solver)
        self._answer: tuple[Origins, tuple] | None = None  # and the key that it is of

    @property
    def answer(self) -> Asked | None:
        """The light at the pin, of this state or of an earlier one."""
        if self._answer is None or self._key is None or self._answer[1][0] != self._key[0]:
            return None
        origins, of = self._answer
        return Asked(self._key[0], origins, of[1:] == state_of(self._solver))

    def key(self, settings: Settings) -> tuple | None:
        pin, s = settings.asked, self._solver
        is_placed = pin is not None and pin in settings.pins and (not pin.object or pin.object in s.poses)
        return (pin, *state_of(s)) if is_placed else None

    def begin(self) -> Iterator:
        s = self._solver
        (point,), (normal,) = placed([self._key[0]], s.poses)
        return origin_steps(s.model, point, normal, s.poses, s.levels, s.seed)

    def take(self, result: Origins) -> bool:
        self._answer = result, self._key
        return False

    def drop(self) -> None:
        super().drop()
        self._answer = None


class ChangeJob(Job):
    """Finds the change since light A, by one set of photons and paths, each time the light on show improves."""

    name = "comparing with light A"

    def __init__(self, solver: Solver) -> None:
        super().__init__(solver)
        self._result: tuple[Change, tuple] | None = None  # and the states that it is of

    @property
    def result(self) -> Change | None:
        """The change to the present state, which may be newer than the key."""
        of = self._result
        return None if of is None or self._key is None or of[1] != (self._key[0], *state_of(self._solver)) else of[0]

    def key(self, settings: Settings) -> tuple | None:
        a, s = settings.since, self._solver
        if settings.show != CHANGE or a is None or a.model() is not s.model or s.frame.background is None:
            return None
        return a, *state_of(s), id(s.irradiance)  # the result refers to this array

    def begin(self) -> Iterator:
        return _changed(self._solver, self._key[0])

    def take(self, result: Change) -> bool:
        self._result = result, self._key[:-1]
        return False

    def drop(self) -> None:
        super().drop()
        self._result = None


def _changed(solver: Solver, a: State) -> Iterator[Change]:
    """Yield the change, at once."""
    before, deviation = solver.since(dict(a.poses), np.array(a.levels))
    yield Change(before, solver.irradiance, deviation)


def placed(pins: Sequence[Pin], poses: Mapping[str, Pose]) -> tuple[np.ndarray, np.ndarray]:
    """Return positions [m] and normals of pins in the world, (n, 3) each; their objects have poses."""
    points, normals = (np.array([pin[k] for pin in pins], np.float64).reshape(-1, 3) for k in (1, 2))
    for k, pin in enumerate(pins):
        if pin.object:
            points[k : k + 1] = to_world(poses[pin.object], points[k : k + 1])
            normals[k : k + 1] = to_world_directions(poses[pin.object], normals[k : k + 1])
    return points, normals


def state_of(solver: Solver) -> tuple:
    """Return poses and levels as a key."""
    return tuple(sorted(solver.poses.items())), solver.levels.tobytes()

"""The light of one scene while it is looked at: refine, move, play, change settings. No window, no GL.

The window calls `tick` once a frame and shows `irradiance` when `version` has changed. Refinement and moves
run in a thread beside the window, one at a time. A frame waits for refinement as long as its budget allows,
for a move as long as a frame may take: what is not done by then is drawn in a later frame, pose and light
together, and meanwhile the window lives.
"""

from __future__ import annotations

import functools
import statistics
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from app.background import PATIENCE, Job, Worker
from app.history import History
from app.log import WARNING, Log
from app.motion import paths_of
from app.opening import Opened, Opening
from app.settings import Settings
from app.vertex_colours import colours
from gi_core.pose import pose_at, rotation
from gi_core.receivers import Receivers
from gi_core.scene import Pose

BUDGET = 0.008  # s that a frame waits for refinement
GRACE = 0.040  # s that a frame waits for a move: with the drawing it stays under 50 ms
SETTLE = 0.15  # s: a slider's value counts once it has rested so long, or is let go
SMOOTHED = 31  # frames that a shown time is the median of
SOLVER_SETTINGS = ("estimator", "photons", "radius", "neighbours")


class Smoothed:
    """The median of the last values: one slow frame does not show."""

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=SMOOTHED)

    def add(self, value: float) -> None:
        self._values.append(value)

    @property
    def value(self) -> float:
        return statistics.median(self._values) if self._values else 0.0


class Session:
    """`ready` turns True when there is a solver; before that only `opening` is worth a look."""

    def __init__(
        self,
        settings: Settings,
        log: Log,
        open_with: Callable = Opening,
        clock: Callable[[], float] = time.perf_counter,
        worker: Worker | None = None,
    ) -> None:
        self.settings = settings  # as the user wants them
        self.log = log
        self.clock = clock
        self.opening: Opening | None = open_with(settings)
        self.problem: BaseException | None = None  # why there is no scene
        self.solver = None
        self.meshes: tuple = ()
        self.picker = None
        self.version = 0  # of what is to be shown
        self.progress = None  # the last step of the refinement under way, None when there is none
        self.dragging = False
        self.before_drag: dict[str, Pose] = {}  # poses when the drag, or playing, began
        self.playing = False
        self.history = History()
        self.gi_seconds = Smoothed()  # new poses in, irradiance out
        self.steps_this_frame = 0
        self._worker = worker or Worker()
        self._job: Job | None = None  # what the thread is doing
        self._take: Callable[[Job], None]  # what to do with its result
        self._steps = None  # what is still to be refined
        self._moving: dict[str, Pose] = {}  # poses of the move under way
        self._pending: dict[str, Pose] = {}  # poses that wait for their turn
        self._drawn: dict[str, Pose] = {}  # poses that the light on the screen belongs to
        self._irradiance = np.zeros((0, 3))  # that light
        self._applied = settings
        self._changed_at = 0.0
        self._path_time = 0.0
        self._paths: dict = {}

    @property
    def ready(self) -> bool:
        return self.solver is not None

    @property
    def refining(self) -> bool:
        return self._steps is not None or self._job is not None or bool(self._pending) or self._to_apply

    @property
    def poses(self) -> dict[str, Pose]:
        """Where the mobiles are, or will be as soon as the thread gets there."""
        return {**self._drawn, **self._moving, **self._pending}

    @property
    def pose_list(self) -> list[Pose]:
        """Poses as drawn, in the scene's order: those that the light belongs to."""
        return [self._drawn[m.name] for m in self.solver.scene.mobiles]

    @property
    def irradiance(self) -> np.ndarray:
        """Irradiance (R, 3) at the poses as drawn."""
        return self._irradiance

    # Once a frame -----------------------------------------------------------------------------------

    def tick(self, seconds: float, editing: bool = False, budget: float = BUDGET) -> None:
        """Do the work of one frame; `seconds` since the last, `editing` while a slider is held."""
        self.steps_this_frame = 0
        if not self.ready:
            self._wait_for_opening()
            return
        self._move_pending(0.0)
        if self._to_apply and not self.dragging and (not editing or self.clock() - self._changed_at >= SETTLE):
            self._apply()
        if self.playing and not self.dragging:
            self._play(seconds)
        elif not self.dragging:
            self._refine(budget)

    def want(self, settings: Settings) -> None:
        """Ask for other settings; they are taken over once they rest."""
        if settings != self.settings:
            self.settings = settings
            self._changed_at = self.clock()

    def _wait_for_opening(self) -> None:
        if self.opening is None or not self.opening.done:
            return
        opening, self.opening = self.opening, None
        if opening.problem is not None:
            self.problem = opening.problem
            self.log.error("opening", opening.problem)
            return
        self.adopt(opening.result)

    def adopt(self, opened: Opened) -> None:
        """Take over a scene that has its first picture."""
        # What the panel changed meanwhile stays; what was open is filled in.
        filled = {k: v for k, v in vars(opened.settings).items() if getattr(self.settings, k) is None}
        self.settings = self._applied = replace(self.settings, **filled)
        self.solver, self.meshes, self.picker = opened.solver, opened.meshes, opened.picker
        self._start = dict(self.solver.poses)
        static = Receivers(*(column[self.solver.surfaces.receiver_range(0)] for column in self.solver.receivers))
        paths = paths_of(self.solver.scene, static, self.solver.scene_size)
        self._paths = {name: path for name, path in paths.items() if len(path.times) > 1}
        self._steps = self.solver.solve_steps()
        self._show()
        for note in self.solver.scene.notes:
            self.log(note)

    # Refinement -------------------------------------------------------------------------------------

    def _refine(self, budget: float) -> None:
        """Wait for steps until the budget is spent; the one under way then goes on behind the picture."""
        deadline = self.clock() + budget
        while self._steps is not None and not self._pending:
            if self._job is None:
                self._begin(functools.partial(next, self._steps, None), self._take_step)
                self.steps_this_frame += 1
            if not self._wait(deadline - self.clock()):
                break

    def _begin(self, call: Callable, take: Callable[[Job], None]) -> None:
        self._job, self._take = self._worker.submit(call), take

    def _wait(self, seconds: float) -> bool:
        """Wait so long for what is under way, and take it over; True when nothing is under way any more."""
        if self._job is None:
            return True
        if not self._job.wait(seconds):
            return False
        job, self._job = self._job, None
        self._take(job)
        return True

    def _take_step(self, job: Job) -> None:
        try:
            self.progress = job.result()
        except Exception as problem:
            self._steps = self.progress = None
            self.log.error("refining", problem)
            return
        if self.progress is None:
            self._steps = None
        elif self.progress.picture:
            self._show()

    def _show(self) -> None:
        """Let the window draw what the solver has now."""
        # The solver replaces its array with each picture and never writes into it: keeping it is free.
        self._drawn, self._irradiance = dict(self.solver.poses), self.solver.irradiance
        self.version += 1

    @property
    def _to_apply(self) -> bool:
        return self.settings != self._applied

    def _apply(self) -> None:
        """Take over what the panel asks for, going back no further than needed."""
        old, new = self._applied, self.settings
        changed = {name: getattr(new, name) for name in SOLVER_SETTINGS if getattr(new, name) != getattr(old, name)}
        if changed and not self._wait(BUDGET):
            return  # in the next frame, then
        if new.show != old.show:
            self.version += 1
        self._applied = new
        if not changed:
            return
        try:
            # The solver keeps the old picture until the new one is as good.
            self.solver.configure(**changed)
        except Exception as problem:
            self.settings = self._applied = replace(new, **{name: getattr(old, name) for name in changed})
            self.log.error("settings", problem)
            return
        self._steps = self.solver.solve_steps()

    # Motion -----------------------------------------------------------------------------------------

    def move(self, poses: Mapping[str, Pose]) -> None:
        """Put mobiles at poses; unless it takes too long, they are drawn there in this frame, in their light."""
        self._pending.update(poses)
        self._move_pending(GRACE)

    def _move_pending(self, patience: float) -> None:
        deadline = self.clock() + patience
        while self._pending:
            if not self._wait(deadline - self.clock()):
                return
            self._moving, self._pending = self._pending, {}
            self._begin(functools.partial(self._timed_move, self._moving), self._take_move)
        if self._moving:
            self._wait(deadline - self.clock())

    def _timed_move(self, poses: Mapping[str, Pose]) -> float:
        started = self.clock()
        self.solver.move_all(poses)
        return self.clock() - started

    def _take_move(self, job: Job) -> None:
        self._moving = {}
        try:
            self.gi_seconds.add(job.result())
        except Exception as problem:
            self.playing = False
            self.log.error("moving", problem)
            return
        self._show()
        # The iterator may have been left between two steps: begin a new one, nothing is traced twice.
        self._steps = self.solver.solve_steps()

    def begin_drag(self) -> None:
        self.dragging = True
        self.before_drag = self.poses

    def end_drag(self, keep: bool = True) -> None:
        """Finish a drag: one step of undo; or, not kept, the poses as they were at the press."""
        self.dragging = False
        if keep:
            self.history.push(self.before_drag, self.poses)
        elif self.before_drag != self.poses:
            self.move(self.before_drag)

    def undo(self) -> None:
        self._go_back(self.history.undo(), "nothing to undo")

    def redo(self) -> None:
        self._go_back(self.history.redo(), "nothing to redo")

    def _go_back(self, poses: Mapping[str, Pose], otherwise: str) -> None:
        self.playing = False
        if poses:
            self.move(poses)
        else:
            self.log(otherwise)

    def reset_poses(self) -> None:
        self.playing = False
        self._path_time = 0.0
        before = self.poses
        if before != self._start:
            self.move(self._start)
            self.history.push(before, self._start)

    # Playing ----------------------------------------------------------------------------------------

    @property
    def paths(self) -> dict:
        """The paths that mobiles follow: the scene's, else a circle for the first mobile."""
        return self._paths

    def toggle_play(self) -> None:
        if not self.playing and not self.paths:
            self.log("this scene has no mobile to play", WARNING)
            return
        self.playing = not self.playing
        if self.playing:
            self.before_drag = self.poses
        else:
            self.history.push(self.before_drag, self.poses)

    def _play(self, seconds: float) -> None:
        """Go on by the time that has passed, so the speed does not depend on the frame rate."""
        self._path_time += seconds
        self.move({name: pose_at(path, play_head(path, self._path_time)) for name, path in self.paths.items()})

    # To be drawn ------------------------------------------------------------------------------------

    def colours(self, o: int) -> tuple[np.ndarray, np.ndarray]:
        """Return linear radiance (D, 3) float32 of both sides of an object's draw vertices."""
        return colours(self.meshes[o], self.irradiance, self.settings.show == "radiance")

    def models(self) -> tuple[np.ndarray, ...]:
        """Return one (4, 4) object-to-world matrix an object; the static part's is 1."""
        return (np.eye(4), *(matrix(pose) for pose in self.pose_list))

    def close(self) -> None:
        """Stop all work; returns when nothing runs any more, or after a moment."""
        if self.opening is not None:
            self.opening.cancel()
        self._steps = None
        self._wait(PATIENCE)
        self._worker.close()


def matrix(pose: Pose) -> np.ndarray:
    """Return the (4, 4) object-to-world matrix of a pose."""
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = rotation(pose), pose.position
    return M


def play_head(path, seconds: float) -> float:
    """Return the time on a path after playing for so long: round and round if it closes, else there and back."""
    first, length = float(path.times[0]), float(path.times[-1] - path.times[0])
    closed = np.allclose(path.positions[0], path.positions[-1]) and np.isclose(
        abs(float(np.dot(path.quaternions[0], path.quaternions[-1]))), 1.0
    )
    if closed:
        return first + seconds % length
    at = seconds % (2 * length)
    return first + (at if at <= length else 2 * length - at)

"""The user's requests to an open scene: opening, settings, moves, undo, playing. No window, no GL.

The window calls `tick` once per frame and draws the snapshot when `version` has changed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np

from app.draw.motion import play_head
from app.rest.results import MeasuredPoints
from app.session.lights import EXPOSURE_STAYS, changes_exposure, flux_of
from app.session.log import WARNING, Log
from app.session.open_scene import OpenScene
from app.session.opening import Opened, Opening
from app.session.solver_thread import SolverThread
from app.settings import TABLE, Lighting, Settings
from app.worker import PATIENCE, Worker
from gi_core.files.edits import Edit, EditError, names_after, with_edit
from gi_core.scene import Pose
from gi_core.scene.errors import one_line
from gi_core.scene.pose import pose_at

Step = tuple[dict[Any, Any], dict[Any, Any]]  # values before and after


class Field(NamedTuple):
    """The key of a field of Settings in a step; the key of a pose is the name of its mobile."""

    name: str


class History:
    """Steps of ({key: value before}, {key: value after}); a key is the name of a mobile, or a Field.

    press: the number of the press that holds a field of the window; its changes are one step. None: each is one.
    """

    def __init__(self) -> None:
        self._done: list[Step] = []
        self._undone: list[Step] = []
        self.press: int | None = None
        self._last: int | None = None  # press of the last change

    @property
    def goes_on(self) -> bool:
        """Whether the next change belongs to the press of the last one."""
        return self.press is not None and self.press == self._last

    def push(self, before: Mapping[Any, Any], after: Mapping[Any, Any]) -> None:
        """Record a change, in the step of the last one where that goes on; undone steps can no longer be redone."""
        before = {key: value for key, value in before.items() if after.get(key, value) != value}
        if not before:
            return
        done = self._done
        if self.goes_on and done and all(done[-1][1].get(key) == value for key, value in before.items()):
            (was, ended), done = done[-1], done[:-1]
            before, after = {**before, **was}, {**ended, **after}
        before = {key: value for key, value in before.items() if after[key] != value}  # a press may end as it began
        step = [(before, {key: after[key] for key in before})] if before else []
        self._done, self._last = [*done[-199:], *step], self.press if step else None  # 200 steps at most
        self._undone.clear()

    def undo(self) -> dict[Any, Any]:
        """Return the values before the last step; empty without one."""
        if not self._done:
            return {}
        self._undone.append(self._done.pop())
        return self._undone[-1][0]

    def redo(self) -> dict[Any, Any]:
        if not self._undone:
            return {}
        self._done.append(self._undone.pop())
        return self._done[-1][1]

    def change(self, key: Field, new: Callable[[Any], Any]) -> None:
        """Put new values of a field into all steps; steps that then leave it as it is are dropped."""
        self._done, self._undone = _changed(self._done, key, new), _changed(self._undone, key, new)


def _changed(steps: list[Step], key: Field, new: Callable[[Any], Any]) -> list[Step]:
    """Return steps with new values of a field, without those that then leave it as it is."""
    out = []
    for before, after in steps:
        if key not in before:
            out.append((before, after))
        elif new(before[key]) != new(after[key]):
            out.append(({**before, key: new(before[key])}, {**after, key: new(after[key])}))
    return out


LIGHT_TIME = 0.008  # s per frame for refinement
STILL = 0.25  # s without motion in a drag, after which its pose rests
OF_LAMPS = [field.name for field in fields(Lighting)]  # settings of the panel whose changes are steps of undo
SETTLE = 0.15  # s without change after which the value of a held slider counts


class Asked(NamedTuple):
    """Edits of the scene to be opened, and poses to be reached then."""

    edits: tuple[Edit, ...]
    poses: dict[str, Pose]
    follows: bool = False  # an edit that is being opened: it is let finish, as values of a held slider come faster


class Inserted(NamedTuple):
    """Objects inserted in this window, by name."""

    near: dict[str, np.ndarray]  # the points looked at then, and the eyes (2, 3) [m]
    poses: dict[str, Pose]  # the poses that they got near there


@dataclass
class Motion:
    """A drag, or playing; one at most."""

    dragging: bool = False
    playing: bool = False
    before: dict[str, Pose] = field(default_factory=dict)  # poses when it began
    moved_at: float = 0.0  # [s], the last move or dimming
    path_time: float = 0.0  # [s] along the paths

    @property
    def is_active(self) -> bool:
        return self.dragging or self.playing


@dataclass
class Requests:
    """Settings on the way from the user to the solver."""

    applied: Settings  # those that the light on show has, or will have
    changed_at: float = 0.0  # [s], the last request
    filled: dict[str, object] = field(default_factory=dict)  # values of settings that were open
    lamps: tuple = ((), "")  # levels and solo that the light on show has, or will have
    before: Settings | None = None  # a press that has changed lamps; None: no such press


class Session(OpenScene):
    """`ready` is True once there is a solver; until then only `opening` and `problem` change."""

    def __init__(
        self,
        settings: Settings,
        log: Log,
        open_with: Callable = Opening,
        clock: Callable[[], float] = time.perf_counter,
        worker: Worker | None = None,
    ) -> None:
        super().__init__(settings)
        self.log = log
        self.clock = clock
        self.opening: Opening | None = open_with(settings)
        self.start_exposure = 0.0  # [EV], of the scene's file, or metered at its first picture
        self.problem: BaseException | None = None  # of the opening ...
        self.doing = "opening"  # ... and its word for the log
        self.motion = Motion()
        self.history = History()
        self.inserted = Inserted({}, {})
        self.asked: Asked | None = None  # until `Reload` opens the scene with these edits
        self._returning: dict[str, Pose] = {}  # poses that the edits asked for last bring back
        self.points = MeasuredPoints()  # of the error chart
        self.light_by_estimator: dict[str | None, str | None] = {}  # by estimator, as they were left
        self._refreshed = 0  # redraws of the same light
        self._worker = worker or Worker()
        self.requests = Requests(settings)

    @property
    def ready(self) -> bool:
        return self.light is not None

    @property
    def refining(self) -> bool:
        return self.light.busy or self._to_apply

    @property
    def refined(self) -> float:
        """Share of the photons at the settings asked for; below 1 the picture may be that of earlier settings."""
        return 0.0 if self._to_apply or self.is_editing else self.light.refined

    @property
    def is_current(self) -> bool:
        """Whether the picture, and the numbers that belong to it, have the settings asked for."""
        return self.light.is_current and self.settings.method == self.requests.applied.method

    @property
    def in_motion(self) -> bool:
        """Whether objects are in motion, or their light is."""
        return self.has_objects_moving or self.light.is_moving or self.light.partial

    @property
    def has_objects_moving(self) -> bool:
        """Whether objects are in motion; one that a drag holds still is not."""
        return self.motion.playing or (self.motion.dragging and self.has_moved)

    @property
    def has_moved(self) -> bool:
        """Whether something has moved lately: what a drag or a slider holds still rests."""
        return self.clock() - self.motion.moved_at < STILL

    @property
    def version(self) -> int:
        """A number that grows with each new picture."""
        return self.light.version + self._refreshed

    # Once a frame -----------------------------------------------------------------------------------

    def tick(self, seconds: float, editing: bool = False, budget: float = LIGHT_TIME, still: bool = True) -> None:
        """Do the work of one frame.

        seconds: since the last frame; editing: a slider is held; budget: for refinement [s]; still: the camera rests.
        """
        if not self.ready:
            self._wait_for_opening()
            return
        self.light.budget = 1e-3 * self.settings.budget
        self.light.move_pending(0.0)
        self._dim()
        settled = not editing or self.clock() - self.requests.changed_at >= SETTLE
        if settled and self._to_apply and not self.motion.dragging:
            self._apply()
        self.motion.playing &= not self.light.move_failed
        if self.motion.playing and not self.motion.dragging:
            self._play(seconds)
            self.motion.playing &= not self.light.move_failed
        elif not (self.has_moved and (self.motion.dragging or editing)):
            self.light.settle()
            if not self.is_editing:  # the scene after the edit has other light
                self.light.refine(budget, self.settings if still and not editing else None)
            self.points.add(self.light.snapshot.rest.point)
        if not self.settings.show_disc:
            self.held_receiver = -1
        self.light.show_method(self._method_parts)

    def _dim(self) -> None:
        """Follow the settings of the lamps."""
        asked, names = (self.settings.lamps, self.settings.solo), self.model.emitters.lamps.names
        if asked != self.requests.lamps:
            self.requests.lamps, self.motion.moved_at = asked, self.clock()
            # settings may name lamps that have been removed
            self.light.dim({name: level for name, level in self.settings.levels(names).items() if name in names})

    def want(self, settings: Settings) -> None:
        """Request settings; they apply once they rest."""
        if settings != self.settings:
            self.settings = settings
            self.requests.changed_at = self.clock()

    def take(self, settings: Settings, held: bool) -> None:
        """Request the panel's settings; held: its mouse button is down.

        The log has how to meter the exposure where an edit of lamps has ended in other light.
        """
        changed = {name: getattr(settings, name) for name in OF_LAMPS}
        if changed != {name: getattr(self.settings, name) for name in OF_LAMPS}:
            self.requests.before = self.requests.before or self.settings
            self.edit(**changed)
        self.want(settings)
        was, of = self.requests.before, self.model.emitters
        if was is not None and not held:
            self.requests.before = None
            if was.solo != settings.solo or changes_exposure(flux_of(of, was), flux_of(of, settings)):
                self.log(EXPOSURE_STAYS, WARNING)

    def reset_settings(self) -> None:
        """Return to the settings of a scene opened without options, and to its first exposure."""
        s = self.settings
        kept: dict[str, Any] = {name: getattr(s, name) for name, row in TABLE.items() if not row.resets}
        self.want(replace(Settings(), **(kept | {"exposure": self.start_exposure} | self.requests.filled)))

    def choose_estimator(self, name: str) -> None:
        """Show an estimator in the light that it had last; at first its photons alone."""
        s = self.settings
        if name != s.estimator:
            self.light_by_estimator[s.estimator] = s.light
            self.want(replace(s, estimator=name, light=self.light_by_estimator.get(name, "photons")))

    def _wait_for_opening(self) -> None:
        if self.opening is None or not self.opening.done:
            return
        opening, self.opening = self.opening, None
        for warning in opening.warnings:
            self.log(warning, WARNING)
        if opening.problem is not None:
            self.problem = opening.problem
            self.log.error(self.doing, opening.problem)
            return
        self.adopt(opening.result)

    def adopt(self, opened: Opened) -> None:
        """Show a scene that has its first picture."""
        # Changes made in the panel meanwhile stay; open settings get their values.
        filled = {k: v for k, v in vars(opened.settings).items() if getattr(self.settings, k) is None}
        self.requests.filled = {name: value for name, value in filled.items() if value is not None}
        self.settings = self.requests.applied = replace(self.settings, **filled)
        self.requests.lamps = opened.settings.lamps, ""  # a solver knows no solo
        self._show(opened, SolverThread(opened.solver, self.log, self.clock, self._worker))
        logged = {entry.text for entry in self.log.entries}  # each edit opens the same scene again
        for note in self.scene.notes:
            if one_line(note) not in logged:
                self.log(note)

    @property
    def _to_apply(self) -> bool:
        return replace(self.settings, lamps=(), solo="") != replace(self.requests.applied, lamps=(), solo="")

    def _apply(self) -> None:
        """Apply the requested settings; only the work that depends on a change is repeated."""
        old, new = self.requests.applied, self.settings
        changed = {name: value for name, value in new.method.items() if value != old.method[name]}
        try:
            if changed and not self.light.configure(changed, LIGHT_TIME):
                return  # busy: again in the next frame
        except Exception as problem:
            self.settings = new = replace(new, **{name: getattr(old, name) for name in changed})
            self.log.error("settings", problem)
        if any(row.recolours and getattr(new, name) != getattr(old, name) for name, row in TABLE.items()):
            self._refreshed += 1
        self.requests.applied = new

    # Motion -----------------------------------------------------------------------------------------

    def move(self, poses: Mapping[str, Pose]) -> None:
        """Put mobiles at poses; a fast move is drawn in this frame, in its own light.

        The light has as many photons as fit the budget; each single move chooses their number again.
        """
        self.motion.moved_at = self.clock()
        if not self.motion.is_active:
            self.light.begin_motion()
        self.light.move(poses)

    def begin_drag(self) -> None:
        self.motion.dragging = True
        self.light.begin_motion()
        self.motion.before = self.poses

    def end_drag(self, keep: bool = True) -> None:
        """End a drag as one step of undo; not `keep`: return to the poses at the press."""
        self.motion.dragging = False
        if keep:
            self.history.push(self.motion.before, self.poses)
        elif self.motion.before != self.poses:
            self.move(self.motion.before)

    def undo(self) -> None:
        self._go_back(self.history.undo(), "nothing to undo")

    def redo(self) -> None:
        self._go_back(self.history.redo(), "nothing to redo")

    def _go_back(self, step: Mapping[Any, Any], otherwise: str) -> None:
        self.motion.playing = False
        if not step:
            self.log(otherwise)
        fields = {key.name: value for key, value in step.items() if isinstance(key, Field)}
        poses = {key: pose for key, pose in step.items() if not isinstance(key, Field) and pose is not None}
        if (edits := fields.pop("edits", None)) is not None:
            self.edits, self.asked, self._returning = edits, Asked(edits, poses), poses
            return
        if fields:
            self.want(replace(self.settings, **fields))
        if poses := {name: pose for name, pose in poses.items() if name in self.poses}:
            self.move(poses)

    def keep_light(self) -> None:
        """Keep the light on show as light A, to compare later light with it."""
        self.kept = self.light_to_keep or self.kept
        self.light.version += 1
        if self.kept is not None:
            self.want(replace(self.settings, since=self.kept.state))
            self.log("light A is kept: Show / Change since A compares with it")

    def edit(self, **fields: Any) -> None:
        """Change fields of the settings, a step of undo."""
        before = {Field(name): getattr(self.settings, name) for name in fields}
        self.want(replace(self.settings, **fields))
        self.history.push(before, {Field(name): value for name, value in fields.items()})

    # Edits ------------------------------------------------------------------------------------------

    def change_scene(self, *edits: Edit) -> None:
        """Change the scene, one step of undo; `Reload` opens it in the background, this picture staying until then.

        Values of a held slider that come while one is being opened are dropped, except the newest.
        """
        self.motion.playing = False
        before = self.edits
        for edit in edits:
            self.edits = with_edit(self.edits, edit)
        if self.edits == before:
            return
        follows = self.history.goes_on
        poses: dict[Any, Any] = {} if follows else dict(self.poses)
        self.history.push({Field("edits"): before, **poses}, {Field("edits"): self.edits, **dict.fromkeys(poses)})
        self.asked, self._returning = Asked(self.edits, {}, follows), {}

    @property
    def is_editing(self) -> bool:
        """Whether edits asked for are not yet on show."""
        return self.edits != self.settings.edits

    @property
    def moved_after_edits(self) -> dict[str, Pose]:
        """Poses as of `moved`, once the edits asked for are on show."""
        names = names_after(self.poses, self.settings.edits, self.edits)
        return {name: pose for name, pose in {**self.moved, **self._returning}.items() if name in names}

    def edit_failed(self, asked: Asked, problem: BaseException) -> None:
        """Forget the edit that failed, in all steps of undo, and ask for the others again.

        A problem that no single edit has takes all edits that are not on show.
        """
        shown = self.settings.edits
        pending = [edit for edit in asked.edits if edit not in shown]
        failed = [asked.edits[problem.number]] if isinstance(problem, EditError) else pending

        def without_failed(edits: tuple[Edit, ...]) -> tuple[Edit, ...]:
            return tuple(edit for edit in edits if edit not in failed)

        self.edits = without_failed(self.edits) if failed else shown
        self.history.change(Field("edits"), without_failed)
        self.asked = Asked(self.edits, (self.asked or asked).poses) if self.edits != shown else None

    def reset_poses(self) -> None:
        self.motion.playing = False
        self.motion.path_time = 0.0
        before = self.poses
        start = {name: self.inserted.poses.get(name, pose) for name, pose in self._start.items()}
        if before != start:
            self.move(start)
            self.history.push(before, start)

    # Playing ----------------------------------------------------------------------------------------

    def toggle_play(self) -> None:
        if not self.motion.playing and not self.paths:
            self.log("this scene has no mobile to play", WARNING)
            return
        self.motion.playing = not self.motion.playing
        if self.motion.playing:
            self.light.begin_motion()
            self.motion.before = self.poses
        else:
            self.history.push(self.motion.before, self.poses)

    def _play(self, seconds: float) -> None:
        """Advance along the paths by a time, so that the speed does not depend on the frame rate."""
        self.motion.path_time += seconds
        self.move({name: pose_at(path, play_head(path, self.motion.path_time)) for name, path in self.paths.items()})

    def close(self, patience: float = PATIENCE) -> None:
        """Stop all work, waiting for at most `patience` seconds per job. Nothing else may be called afterwards."""
        if self.opening is not None:
            self.opening.cancel(patience)
        if self.light is not None:
            self.light.close(patience)

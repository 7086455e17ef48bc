"""The user's requests to an open scene: opening, settings, moves, undo, playing. No window, no GL.

The window calls `tick` once per frame and draws the snapshot when `version` has changed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from app.rest.measured_points import MeasuredPoints
from app.session.lamp_changes import LampChanges, changes_exposure
from app.session.log import WARNING, Log
from app.session.open_scene import OpenScene
from app.session.opening import Opened, Opening
from app.session.solver_thread import SolverThread
from app.session.undo import Field, History
from app.settings import TABLE, Lighting, Settings
from app.worker import PATIENCE, Worker
from gi_core.scene import Pose
from gi_core.scene.errors import one_line
from gi_core.scene.pose import pose_at

if TYPE_CHECKING:  # heavy imports wait until the window is there, see app/session/opening.py
    import numpy as np

    from gi_core.files.edits import Edit

BUDGET = 0.008  # s per frame for refinement
STILL = 0.25  # s without motion in a drag, after which all photons are shown
OF_LAMPS = [field.name for field in fields(Lighting)]  # settings of the panel whose changes are steps of undo
SETTLE = 0.15  # s without change after which the value of a held slider counts


class Asked(NamedTuple):
    """Edits of the scene to be opened, and poses to be reached then."""

    edits: tuple[Edit, ...]
    poses: dict[str, Pose]
    follows: bool = False  # an edit that is being opened: it is let finish, as values of a held slider come faster


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
        self.lamp_changes = LampChanges(settings, clock)
        self.dragging = False
        self.before_drag: dict[str, Pose] = {}  # poses when the drag, or playing, began
        self.playing = False
        self.history = History()
        self._before_edit: dict[Field, Any] = {}  # fields when an edit began
        self._dimming = False  # the panel holds a lamp's slider
        self.near: dict[str, np.ndarray] = {}  # points (3,) [m] looked at as objects were inserted, by their name
        self.inserted: dict[str, Pose] = {}  # the poses that they got near there
        self.asked: Asked | None = None  # until `Reload` opens the scene with these edits
        self._returning: dict[str, Pose] = {}  # poses that the edits asked for last bring back
        self.points = MeasuredPoints()  # of the error chart
        self.light_by_estimator: dict[str | None, str | None] = {}  # by estimator, as they were left
        self._refreshed = 0  # redraws of the same light
        self._worker = worker or Worker()
        self._applied = settings
        self.filled: dict[str, object] = {}  # values of settings that were open
        self._changed_at = 0.0
        self._moved_at = 0.0
        self._path_time = 0.0

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
    def in_motion(self) -> bool:
        """Whether objects are in motion, or their light is."""
        return self.playing or self.dragging or self.light.is_moving or self.light.partial

    @property
    def version(self) -> int:
        """A number that grows with each new picture."""
        return self.light.version + self._refreshed

    # Once a frame -----------------------------------------------------------------------------------

    def tick(self, seconds: float, editing: bool = False, budget: float = BUDGET, still: bool = True) -> None:
        """Do the work of one frame.

        seconds: since the last frame; editing: a slider is held; budget: for refinement [s]; still: the camera rests.
        """
        if not self.ready:
            self._wait_for_opening()
            return
        self.light.budget = 1e-3 * self.settings.budget
        self.light.move_pending(0.0)
        self._dim()
        if self._to_apply and not self.dragging and (not editing or self.clock() - self._changed_at >= SETTLE):
            self._apply()
        self.playing &= not self.light.move_failed
        if self.playing and not self.dragging:
            self._play(seconds)
            self.playing &= not self.light.move_failed
        elif not self.dragging and not (editing and self.clock() - self._moved_at < STILL):
            self.light.settle()
            if not self.is_editing:  # the scene after the edit has other light
                self.light.refine(budget, self.settings if still and not editing else None)
            self.points.add(self.light.snapshot.rest.point)
        elif self.clock() - self._moved_at >= STILL:
            self.light.settle()
        if not self.settings.show_disc:
            self.held_receiver = -1
        self.light.show_method(self._method_parts)

    def _dim(self) -> None:
        """Follow the settings of the lamps, at once or in a cross-fade."""
        levels = self.lamp_changes.due(self.settings, self.model.emitters.lamps.names)
        if levels is not None:
            self._moved_at = self.clock()
            self.light.dim(levels)

    def fade(self) -> None:
        """Change to the levels asked for in a cross-fade, from those on show."""
        shown = self.light.snapshot.levels.tolist()
        self.lamp_changes.fade(dict(zip(self.model.emitters.lamps.names, shown, strict=True)))

    def want(self, settings: Settings) -> None:
        """Request settings; they apply once they rest."""
        if settings != self.settings:
            self.settings = settings
            self._changed_at = self.clock()

    def take(self, settings: Settings, held: bool) -> None:
        """Request the panel's settings; held: its mouse button is down. Lamps change in one step of undo per press."""
        changed = {name: getattr(settings, name) for name in OF_LAMPS}
        if changed != {name: getattr(self.settings, name) for name in OF_LAMPS}:
            self.edit(first=not self._dimming, last=not held, **changed)
            self._dimming = held
            self._hint_at_exposure(held)
        elif self._dimming and not held:
            self.edit(first=False)
            self._dimming = False
            self._hint_at_exposure(held)
        self.want(settings)

    def _hint_at_exposure(self, held: bool) -> None:
        """Log how to meter the exposure where an edit of lamps has ended in other light."""
        was = replace(self.settings, **{key.name: value for key, value in self._before_edit.items()})
        if not held and changes_exposure(self.model.emitters, was, self.settings):
            self.log("the exposure stays as it was: key A meters it", WARNING)

    def reset_settings(self) -> None:
        """Return to the settings of a scene opened without options, and to its first exposure."""
        s = self.settings
        kept: dict[str, Any] = {name: getattr(s, name) for name, row in TABLE.items() if not row.resets}
        self.want(replace(Settings(), **(kept | {"exposure": self.start_exposure} | self.filled)))

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
        self.filled = {name: value for name, value in filled.items() if value is not None}
        self.settings = self._applied = replace(self.settings, **filled)
        self.lamp_changes.adopt(opened.settings)
        self._show(opened, SolverThread(opened.solver, self.log, self.clock, self._worker))
        known = {entry.text for entry in self.log.entries}  # each edit opens the same scene again
        for note in self.scene.notes:
            if one_line(note) not in known:
                self.log(note)

    @property
    def _to_apply(self) -> bool:
        return replace(self.settings, lamps=(), solo="") != replace(self._applied, lamps=(), solo="")

    def _apply(self) -> None:
        """Apply the requested settings; only the work that depends on a change is repeated."""
        old, new = self._applied, self.settings
        was = old.of_solver
        changed = {name: value for name, value in new.of_solver.items() if value != was[name]}
        try:
            if changed and not self.light.configure(changed, BUDGET):
                return  # busy: again in the next frame
        except Exception as problem:
            self.settings = new = replace(new, **{name: getattr(old, name) for name in changed})
            self.log.error("settings", problem)
        if any(row.recolours and getattr(new, name) != getattr(old, name) for name, row in TABLE.items()):
            self._refreshed += 1
        self._applied = new

    # Motion -----------------------------------------------------------------------------------------

    def move(self, poses: Mapping[str, Pose]) -> None:
        """Put mobiles at poses; a fast move is drawn in this frame, in its own light.

        The light has as many photons as fit the budget; each single move chooses their number again.
        """
        self._moved_at = self.clock()
        if not (self.dragging or self.playing):
            self.light.begin_motion()
        self.light.move(poses)

    def begin_drag(self) -> None:
        self.dragging = True
        self.light.begin_motion()
        self.before_drag = self.poses

    def end_drag(self, keep: bool = True) -> None:
        """End a drag as one step of undo; not `keep`: return to the poses at the press."""
        self.dragging = False
        if keep:
            self.history.push(self.before_drag, self.poses)
        elif self.before_drag != self.poses:
            self.move(self.before_drag)

    def undo(self) -> None:
        self._go_back(self.history.undo(), "nothing to undo")

    def redo(self) -> None:
        self._go_back(self.history.redo(), "nothing to redo")

    def _go_back(self, step: Mapping[Any, Any], otherwise: str) -> None:
        self.playing = False
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

    def edit(self, first: bool = True, last: bool = True, **fields: Any) -> None:
        """Change fields of the settings; the changes from a `first` to a `last` are one step of undo."""
        if first:
            self._before_edit = {}
        for name in fields:
            self._before_edit.setdefault(Field(name), getattr(self.settings, name))
        self.want(replace(self.settings, **fields))
        if last:
            self.history.push(self._before_edit, {key: getattr(self.settings, key.name) for key in self._before_edit})

    # Edits ------------------------------------------------------------------------------------------

    def change_scene(self, *edits: Edit, first: bool = True) -> None:
        """Change the scene, one step of undo; `Reload` opens it in the background, this picture staying until then.

        Not `first`: the next value of a held slider, in the same step of undo. Values that come while one is being
        opened are dropped, except the newest.
        """
        from gi_core.files.edits import with_edit

        self.playing = False
        before = self.edits
        for edit in edits:
            self.edits = with_edit(self.edits, edit)
        if self.edits == before:
            return
        if first:
            poses: dict[Any, Any] = dict(self.poses)
            self.history.push({Field("edits"): before, **poses}, {Field("edits"): self.edits, **dict.fromkeys(poses)})
        else:
            self.history.extend({Field("edits"): before}, {Field("edits"): self.edits})
        self.asked, self._returning = Asked(self.edits, {}, follows=not first), {}

    @property
    def is_editing(self) -> bool:
        """Whether edits asked for are not yet on show."""
        return self.edits != self.settings.edits

    @property
    def moved_after_edits(self) -> dict[str, Pose]:
        """Poses as of `moved`, once the edits asked for are on show."""
        from gi_core.files.edits import names_after

        names = names_after(self.poses, self.settings.edits, self.edits)
        return {name: pose for name, pose in {**self.moved, **self._returning}.items() if name in names}

    def edit_failed(self, asked: Asked, problem: BaseException) -> None:
        """Forget the edit that failed, in all steps of undo, and ask for the others again.

        A problem that no single edit has takes all edits that are not on show.
        """
        from gi_core.files.edits import EditError

        shown = self.settings.edits
        pending = [edit for edit in asked.edits if edit not in shown]
        failed = [asked.edits[problem.number]] if isinstance(problem, EditError) else pending

        def others(edits: tuple[Edit, ...]) -> tuple[Edit, ...]:
            return tuple(edit for edit in edits if edit not in failed)

        self.edits = others(self.edits) if failed else shown
        self.history.change(Field("edits"), others)
        self.asked = Asked(self.edits, (self.asked or asked).poses) if self.edits != shown else None

    def reset_poses(self) -> None:
        self.playing = False
        self._path_time = 0.0
        before = self.poses
        start = {name: self.inserted.get(name, pose) for name, pose in self._start.items()}
        if before != start:
            self.move(start)
            self.history.push(before, start)

    # Playing ----------------------------------------------------------------------------------------

    def toggle_play(self) -> None:
        if not self.playing and not self.paths:
            self.log("this scene has no mobile to play", WARNING)
            return
        self.playing = not self.playing
        if self.playing:
            self.light.begin_motion()
            self.before_drag = self.poses
        else:
            self.history.push(self.before_drag, self.poses)

    def _play(self, seconds: float) -> None:
        """Advance along the paths by a time, so that the speed does not depend on the frame rate."""
        from app.draw.motion import play_head

        self._path_time += seconds
        self.move({name: pose_at(path, play_head(path, self._path_time)) for name, path in self.paths.items()})

    def close(self, patience: float = PATIENCE) -> None:
        """Stop all work, waiting for at most `patience` seconds per job. Nothing else may be called afterwards."""
        if self.opening is not None:
            self.opening.cancel(patience)
        if self.light is not None:
            self.light.close(patience)

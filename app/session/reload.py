"""Reloads of the current scene, and scenes dropped on the window.

The current scene stays in use while the new one opens, and remains if that fails.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from app.cli import saved_scene
from app.session.free_place import free_pose
from app.session.lights import words_for
from app.session.log import WARNING
from app.session.opening import COMPILING, Before
from app.session.session import Asked, Inserted, Session
from app.settings import TABLE, Settings
from gi_core.files.edits import Darken, Daylight, Duplicate, Edit, Finish, Freeze, Insert, Light, Promote, Remove
from gi_core.scene import Pose

# Settings that another scene resets; those of display and estimator stay.
RESET_BY_SCENE = [name for name, row in TABLE.items() if row.of_scene]

QUIET = 3.0  # s of an edit without progress: a held slider opens several per second, and each would flash


class Reload:
    """`again` and `other` start to open a scene; `tick`, once per frame, returns its session once it is ready."""

    def __init__(self, open_with: Callable) -> None:
        self.coming: Session | None = None  # the session being opened
        self.same = False  # the new scene is the current one, reloaded
        self.dropped: list[str] = []  # files dropped on the window, until the next frame
        self.waiting: list[str] = []  # files to open once the first scene is open
        self.problem = ""  # error of the last scene that failed to open; edits that fail are in the log alone
        self._open_with = open_with
        self._begun = 0.0  # s, of the opening
        self._before = Settings()  # of the current session, at the start of the reload
        self._edited: Asked | None = None  # the edits, if the new scene is the current one after an edit

    def again(self, now: Session) -> None:
        """Reload the current scene; the user's settings, poses and edits stay. An edit under way begins again."""
        if self._edited is not None and self.coming is not None:
            self._edit(now, self._edited)
        else:
            self._begin(now, settings_again(now), same=True)

    def other(self, now: Session, files: Sequence[str]) -> None:
        """Open another scene: of several files the first .toml, else the first; the others become mobiles."""
        scene = next((f for f in files if Path(f).suffix.lower() == ".toml"), files[0])
        try:
            settings = settings_for(now, scene, tuple(f for f in files if f != scene))
        except Exception as problem:  # of a saved scene
            self.problem = f"{problem}"
            raise
        self._begin(now, settings, same=False)

    def _edit(self, now: Session, asked: Asked) -> None:
        """Open the current scene with other edits; settings and photons that the edit does not touch stay."""
        settings = replace(now.settings, edits=asked.edits, poses=())
        open_with = partial(self._open_with, before=Before(now.opened, now.light.keep_results))
        self._begin(now, settings, same=True, open_with=open_with, doing="editing")
        self._edited = asked

    def _begin(
        self, now: Session, settings: Settings, same: bool, open_with: Callable | None = None, doing: str = "opening"
    ) -> None:
        self.close()
        self.same, self.problem, self._before, self._edited = same, "", now.settings, None
        self.coming = Session(settings, now.log, open_with or self._open_with)
        self.coming.doing = doing
        self._begun = self.coming.clock()

    @property
    def is_editing(self) -> bool:
        """Whether an edited scene is being opened: work at rest on the one before it is in vain."""
        return self.coming is not None and self._edited is not None

    def news(self, shown: Session) -> str:
        """Return a line for the log: how the scene on show came, by edits of which things; "": of none that is left."""
        if self._edited is not None:
            return words_of(self._before.edits, shown.settings.edits)
        return f"{'reloaded' if self.same else 'opened'}: {shown.settings.document or shown.settings.scene}"

    @property
    def progress(self) -> tuple[str, float | None] | None:
        """Phase and fraction of the opening; None without one, and in the first QUIET seconds of an edit.

        Compiling takes longer than QUIET, so it is shown at once.
        """
        if self.coming is None:
            return None
        opening = self.coming.opening
        if self.is_editing and not self._compiles and self.coming.clock() - self._begun < QUIET:
            return None
        return ("computing light", None) if opening is None else opening.progress

    @property
    def _compiles(self) -> bool:
        """Whether the opening compiles kernels."""
        opening = self.coming.opening if self.coming is not None else None
        return opening is not None and opening.phase in COMPILING.values()

    def tick(self, now: Session) -> Session | None:
        """Return the new session to show; None before it is ready and during a drag.

        An edit breaks off the one before it. Values of a held slider do not, nor do edits while kernels compile: each
        compiler would begin with ten seconds of imports.
        """
        goes_on = self.is_editing and now.asked is not None and (now.asked.follows or self._compiles)
        if now.asked is not None and now.ready and not goes_on:
            asked, now.asked = now.asked, None
            self._edit(now, asked)
        coming = self.coming
        if coming is None:
            return None
        if not coming.ready:
            coming.tick(0.0, budget=0.0)
            if coming.problem is not None:
                self.coming = None
                if self._edited is not None:
                    now.edit_failed(self._edited, coming.problem)
                else:
                    self.problem = f"{coming.problem}"
            return None
        coming.light.move_pending(0.0)
        if coming.light.is_moving or now.motion.dragging or self._moves(now, coming):
            return None
        self._take_over(now, coming)
        self.coming = None
        return coming

    def _moves(self, now: Session, coming: Session) -> bool:
        """Move the new session's mobiles to the current poses; False: nothing to move, or it failed."""
        if not self.same or coming.light.move_failed:
            return False
        wanted = {**now.moved, **(self._edited.poses if self._edited is not None else {})}
        self._choose_places(now, coming, wanted)
        wanted |= coming.inserted.poses
        kept = {name: p for name, p in wanted.items() if coming.poses.get(name, p) != p}
        if kept:
            coming.move(kept)
        return bool(kept)

    def _choose_places(self, now: Session, coming: Session, wanted: Mapping[str, Pose]) -> None:
        """Choose free places of the objects that the edits insert now, once; wanted: poses of others."""
        for edit in coming.settings.edits:
            if isinstance(edit, Insert) and edit.name not in {**now.poses, **wanted, **coming.inserted.poses}:
                poses = {**coming.poses, **wanted, **coming.inserted.poses}
                tried = (free_pose(coming, poses, edit.name, near) for near in (now.inserted.near.get(edit.name), None))
                coming.inserted.poses[edit.name] = next((pose for pose in tried if pose is not None), poses[edit.name])

    def _take_over(self, now: Session, coming: Session) -> None:
        """Copy the settings that the user has changed since the start of the reload."""
        before, theirs = vars(self._before), () if self.same else RESET_BY_SCENE
        changed = {name: v for name, v in vars(now.settings).items() if v != before[name] and name not in theirs}
        coming.light_by_estimator = now.light_by_estimator
        places = coming.model.object_receivers.positions
        if now.kept is not None and np.array_equal(now.kept.places, places):
            coming.kept = now.kept
        elif now.kept is not None and self.same:
            now.log("light A is dropped: the surfaces are others", WARNING)
        if self.same:
            coming.inserted = Inserted(now.inserted.near, {**now.inserted.poses, **coming.inserted.poses})
        if self._edited is not None:
            coming.history, coming.edits, coming.asked = now.history, now.edits, now.asked
            coming.requests.filled = now.requests.filled
        coming.want(replace(coming.settings, **changed))

    def close(self) -> None:
        """Cancel the opening."""
        if self.coming is not None:
            self.coming.close(0.0)
            self.coming = None


def words_of(before: Sequence[Edit], after: Sequence[Edit]) -> str:
    """Return edits in words, from those before: "inserted: armchair", "undone: removed: cat"; "" without a change."""
    came = [edit for edit in after if edit not in before]
    went = [edit for edit in before if edit not in after]
    return _words(came, before) if came else f"undone: {_words(went, after)}" if went else ""


def _words(edits: Sequence[Edit], base: Sequence[Edit]) -> str:
    verbs = {Finish: "edited", Insert: "inserted", Duplicate: "duplicated", Remove: "removed", Promote: "made movable",
             Freeze: "made static", Daylight: "edited", Darken: "removed"}  # fmt: skip
    lights = {(edit.name, edit.number) for edit in base if isinstance(edit, Light)}
    things: dict[str, list[str]] = {}
    for edit in edits:
        thing = edit.of if isinstance(edit, Duplicate) else edit.name
        if isinstance(edit, Finish):
            thing = f"{edit.part} of {edit.name}" if edit.part else f"material {edit.name}"
        verb = verbs.get(type(edit), "")
        if isinstance(edit, Light):
            is_new = (edit.of or "type" in dict(edit.light)) and (edit.name, edit.number) not in lights
            replaced = any(isinstance(other, Darken) and other.name == thing for other in edits)
            verb = "made movable" if replaced else "added" if is_new else "edited"
            thing = words_for(thing)
        elif isinstance(edit, Darken):
            if any(isinstance(other, Light) and other.name == thing for other in edits):
                continue
            thing = words_for(thing)
        elif isinstance(edit, Daylight) and {"place", "date", "hour"} <= dict(edit.light).keys():
            verb = "edited" if any(isinstance(other, Daylight) for other in base) else "added"
        things.setdefault(verb, []).append(thing)
    return "; ".join(f"{verb}: {', '.join(names)}" for verb, names in things.items())


def settings_again(now: Session) -> Settings:
    """Return settings for a reload; settings that the program filled in become None."""
    chosen = {name: None for name, value in now.requests.filled.items() if getattr(now.settings, name) == value}
    return replace(now.settings, **chosen, poses=())


def settings_for(now: Session, scene: str, mobiles: tuple[str, ...]) -> Settings:
    """Return settings for another scene; those of RESET_BY_SCENE become None. Raises SceneError for a bad saved scene.

    A saved scene gives all its settings; others that were not changed then have their defaults again.
    """
    saved = saved_scene.opened(Settings(scene=scene))
    if saved.document:
        of_file = {name: getattr(saved, name) for name, row in TABLE.items() if row.kept or name == "document"}
        return replace(now.settings, **(of_file | {"mobiles": (*saved.mobiles, *mobiles), "solo": ""}))
    left_open = {name: getattr(Settings, name) for name in RESET_BY_SCENE}
    return replace(settings_again(now), **left_open, scene=scene, mobiles=mobiles)

"""Files of the window: open, save, recent files, changes on disk, unsaved changes."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from imgui_bundle import hello_imgui

from app.cli import saved_scene
from app.session.session import Session
from app.settings import TABLE, UsageError
from app.window import dialogs
from app.window.viewport import Viewport
from gi_core.scene.errors import utf8

MOST_RECENT = 10
RECENT, WATCHES = "recent", "reload when files change"  # preferences in the window's ini file
PERIOD = 1.0  # s between two looks at the disk

State = dict[str, tuple[int, int]]  # path -> time of the last change [ns], size


class Files:
    """`load` after the window opens, `adopt` with each scene, `save_preferences` before it closes."""

    def __init__(self) -> None:
        self.recent: list[str] = []
        self.watches = True
        self.dialog = dialogs.FileDialog()
        self.question = dialogs.Question()
        self._watch = Watch()
        self._clean: tuple = ()

    def load_preferences(self) -> None:
        self.recent = [line for line in hello_imgui.load_user_pref(RECENT).splitlines() if line][:MOST_RECENT]
        self.watches = hello_imgui.load_user_pref(WATCHES) != "no"

    def save_preferences(self) -> None:
        hello_imgui.save_user_pref(RECENT, "\n".join(self.recent))
        hello_imgui.save_user_pref(WATCHES, "yes" if self.watches else "no")

    def adopt(self, session: Session, same: bool) -> None:
        """Follow the files of an opened scene; `same`: it was reloaded."""
        s = session.settings
        self._watch.follow(name for names in session.scene.files for name in names)
        if not same:
            self._clean = _state(session)
        if os.path.isfile(name := s.document or s.scene):
            self.remember(name)

    def remember(self, name: str) -> None:
        """Put a file first among the recent ones."""
        path = os.path.abspath(name)
        if path != utf8(path):
            return  # the preferences are UTF-8
        self.recent = [path, *(other for other in self.recent if other != path)][:MOST_RECENT]

    def has_changed(self, session: Session) -> bool:
        """Return whether poses or settings differ from those opened or saved last."""
        return session.ready and bool(self._clean) and _state(session) != self._clean

    def changed_on_disk(self, now: float) -> bool:
        """Return whether files of the scene have changed and are to be read again. now: [s]."""
        return self.watches and self._watch.changed(now)

    # Saving -----------------------------------------------------------------------------------------

    def save(self, session: Session, viewport: Viewport, path: str) -> tuple[Path, list[Path]]:
        """Save the scene; return its file and copies made of others.

        Raises UsageError for the name of the scene itself, OSError.
        """
        file = Path(path)
        file = file if file.suffix.lower() == ".toml" else file.with_name(file.name + ".toml")
        scene = session.settings.scene
        if os.path.isfile(scene) and os.path.realpath(scene) == os.path.realpath(file):
            raise UsageError(f"{file.name} is the scene itself, which stays as it is; choose another name")
        files = None if session.is_editing else session.scene.files
        copies = saved_scene.write(file, self.settings_now(session, viewport), files)
        session.want(replace(session.settings, document=str(file)))
        self._clean = _state(session)
        self.remember(str(file))
        return file, copies

    def suggestion(self, session: Session) -> str:
        """Return a path for a scene to save."""
        s = session.settings
        if s.document:
            return s.document
        folders = ([Path(s.scene).parent] if os.path.isfile(s.scene) else []) + [Path.cwd(), Path.home()]
        usable = (f for f in folders if f.resolve() != f.resolve().parent and os.access(f, os.W_OK))
        return str(next(usable, folders[-1]) / utf8(f"{Path(s.scene).stem}-saved.toml"))

    def settings_now(self, session: Session, viewport: Viewport) -> saved_scene.Settings:
        """Return settings that open the scene as it is on show, with edits that are still being prepared."""
        settings = session.settings.without_solo(session.model.emitters.lamps.names)
        settings = replace(settings, edits=session.edits)
        return saved_scene.with_view(settings, session.moved_after_edits, viewport.view.camera.as_camera())


def _state(session: Session) -> tuple:
    """Return the values that a saved scene would keep, apart from ways of looking at it."""
    settings = session.settings.in_light_scene(session.settings.lamps)
    counted = (getattr(settings, name) for name, row in TABLE.items() if row.kept and row.counts)
    return session.poses, session.edits, tuple(counted)


class Watch:
    """Call `changed` often: it looks at the disk once per PERIOD."""

    def __init__(self) -> None:
        self._files: list[str] = []
        self._known: State = {}
        self._last: State = {}  # at the last look
        self._due = 0.0

    def follow(self, files: Iterable[str]) -> None:
        """Watch files that exist, from their present state on."""
        self._known = _stamps(files)
        self._files = list(self._known)
        self._last = self._known

    def changed(self, now: float) -> bool:
        """Return whether files have changed and rest since the last look: a program may be writing them. now: [s]."""
        if now < self._due:
            return False
        self._due = now + PERIOD
        before, self._last = self._last, _stamps(self._files)
        if self._last != before or self._last == self._known or len(self._last) < len(self._files):
            return False
        self._known = self._last
        return True


def _stamps(files: Iterable[str]) -> State:
    state = {}
    for name in files:
        try:
            stat = Path(name).stat()
        except OSError:
            continue  # replaced at this moment, or gone
        state[name] = (stat.st_mtime_ns, stat.st_size)
    return state

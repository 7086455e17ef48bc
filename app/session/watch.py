"""Files of the open scene, watched for changes on disk."""

from __future__ import annotations

import os
from pathlib import Path

from app.settings import Settings

PERIOD = 1.0  # s between two looks at the disk

State = dict[str, tuple[int, int]]  # path -> time of the last change [ns], size


def files_of(settings: Settings) -> list[str]:
    """Return the scene file, the meshes that it names, and the mobiles; those that exist."""
    from gi_core.files.edits import files_of_edits
    from gi_core.files.find import find_scene
    from gi_core.files.formats.toml_file import read_scene_file
    from gi_core.scene.errors import SceneError

    found = [*settings.mobiles, *files_of_edits(settings.edits)]
    try:
        scene = find_scene(settings.scene)
        found.append(str(scene))
        if scene.suffix.lower() == ".toml":
            described = read_scene_file(scene, settings.scene)
            found += map(str, (*described.static.meshes, *(m.mesh for m in described.mobiles), *described.photometry))
    except (SceneError, OSError):
        pass  # the opening gives the reason
    return [name for name in dict.fromkeys(found) if os.path.isfile(name)]


class Watch:
    """Call `changed` often: it looks at the disk once per PERIOD."""

    def __init__(self) -> None:
        self._files: list[str] = []
        self._known: State = {}
        self._last: State = {}  # at the last look
        self._due = 0.0

    def follow(self, files: list[str]) -> None:
        """Watch files from their present state on."""
        self._files, self._known = files, _state(files)
        self._last = self._known

    def changed(self, now: float) -> bool:
        """Return whether files have changed and rest since the last look: a program may be writing them. now: [s]."""
        if now < self._due:
            return False
        self._due = now + PERIOD
        before, self._last = self._last, _state(self._files)
        if self._last != before or self._last == self._known or len(self._last) < len(self._files):
            return False
        self._known = self._last
        return True


def _state(files: list[str]) -> State:
    state = {}
    for name in files:
        try:
            stat = Path(name).stat()
        except OSError:
            continue  # replaced at this moment, or gone
        state[name] = (stat.st_mtime_ns, stat.st_size)
    return state

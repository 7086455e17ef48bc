"""Paths of scenes: a path, or the name of a shipped scene."""

from __future__ import annotations

import difflib
import os
from importlib import resources
from pathlib import Path

from gi_core.scene.errors import SceneError


def shipped_scenes() -> list[str]:
    """Return the names of the scenes that come with the program, sorted."""
    folder = resources.files("scenes")
    return sorted(p.name[: -len(".toml")] for p in folder.iterdir() if p.name.endswith(".toml"))


def _beside(path: Path) -> list[str]:
    """Return the names of the files in the folder of a path, none if there is no such folder."""
    try:
        return sorted(p.name for p in path.parent.iterdir() if p.suffix)
    except OSError:
        return []


def find_scene(name_or_path: str | Path) -> Path:
    """Return the path of a scene file: an existing path, or a shipped scene by its bare name.

    Raises SceneError naming the shipped scenes if there is neither.
    """
    path = Path(name_or_path)
    if os.path.isfile(path):  # Path.is_file raises where a name is too long
        return path
    name = str(name_or_path)
    shipped = shipped_scenes()
    if name in shipped:
        return Path(str(resources.files("scenes") / f"{name}.toml"))
    listed = ", ".join(shipped)
    if os.path.exists(path):
        kind = "folder" if os.path.isdir(path) else "pipe, socket or device"
        raise SceneError(f"{name}: a scene is a file, this is a {kind}; shipped scenes are {listed}")
    # least likeness of a mistyped name: 0.75 of 1
    meant = difflib.get_close_matches(path.name, _beside(path), 1, 0.75) or difflib.get_close_matches(name, shipped, 1)
    hint = f"did you mean {meant[0]}? " if meant else ""
    raise SceneError(f"{name}: there is no such scene file; {hint}shipped scenes are {listed}")

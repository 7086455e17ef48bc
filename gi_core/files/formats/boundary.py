"""Boundary of a scene: the files that it may name lie in its own folder and below, unless the user allows more.

A scene from a stranger must not read other files of the disk. Absolute paths, `..` and symbolic links are resolved
first. Devices and pipes are never read.
"""

from __future__ import annotations

import os
from pathlib import Path


class Boundary:
    """The folder of the file that the user named; `open` allows files anywhere."""

    def __init__(self, folder: str | Path, open: bool = False) -> None:
        self.folder, self.open = os.path.realpath(folder), open

    def holds(self, path: str | Path) -> bool:
        """Return whether a path may be read; the file need not exist."""
        if self.open:
            return True
        try:
            real = os.path.realpath(path)
        except (OSError, ValueError):  # a name too long, or with a zero byte
            return False
        return Path(real).is_relative_to(self.folder)

    def file(self, path: str | Path) -> bool:
        """Return whether a path may be read and is a file."""
        return os.path.isfile(path) and self.holds(path)  # Path.is_file raises where a name is too long

"""Which files a scene may name: those in its own folder and below, unless the user allows more.

A scene that came by mail must not read what else is on the disk: an absolute path, `..` and a symbolic link
count as what they lead to. Of devices and pipes none is read at all.
"""

from __future__ import annotations

import os
from pathlib import Path


class Boundary:
    """The folder of the file that the user named; `open` lets references lead anywhere."""

    def __init__(self, folder: str | Path, open: bool = False) -> None:
        self.folder, self.open = os.path.realpath(folder), open

    def holds(self, path: str | Path) -> bool:
        """Tell whether a path may be read, whether or not there is such a file."""
        if self.open:
            return True
        try:
            real = os.path.realpath(path)
        except (OSError, ValueError):  # a name too long, or with a zero byte
            return False
        return Path(real).is_relative_to(self.folder)

    def file(self, path: str | Path) -> bool:
        """Tell whether a path may be read and is a file."""
        return os.path.isfile(path) and self.holds(path)  # Path.is_file raises where a name is too long

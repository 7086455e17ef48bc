"""Boundary of a scene: the files that it may name, and the amounts that it may hold.

A scene from a stranger must not read other files of the disk: its files lie in its own folder and below, unless the
user allows more. Absolute paths, `..` and symbolic links are resolved first. Devices and pipes are never read.
Nor must a few kilobytes fill the memory: readers ask `take` before they allocate.
"""

from __future__ import annotations

import io
import os
import stat
from collections import Counter
from pathlib import Path

from gi_core.scene.errors import SceneError

LIMITS = {  # of one scene with all its files
    "files": 1_000,
    "bytes in files": 1 << 30,
    "bytes in a scene file": 4_000_000,
    "lines of text": 12_000_000,
    "values in JSON": 2_000_000,
    "objects": 1_000,  # mobiles, lights, probes, shapes and surfaces
    "key frames": 100_000,
    "nodes": 100_000,
    "primitives": 50_000,
    "materials": 100_000,
    "triangles": 4_000_000,
    "vertices": 12_000_000,
    "elements without data": 1_000_000,  # of glTF accessors that name no bytes
    "numbers": 250_000_000,  # of glTF accessors, each time one is read
    "pixels": 1 << 28,
}
MOST_IMAGE_PIXELS = 1 << 26  # of one image: 8192 x 8192
MOST_KEY_PARTS = 64  # parts of a TOML key
FOLDER = getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_PATH", 0)  # also of folders that may be entered, not listed
MOST_AT_VERTEX = 10_000  # triangles: the rays of a fan of more meet the boxes of all


class Boundary:
    """The folder of the file that the user named, and the amounts taken so far; `open` allows files anywhere."""

    def __init__(self, folder: str | Path, open: bool = False, named: Path | None = None) -> None:
        """named: the user's own file, which may be a link to another folder."""
        self.folder, self.open, self.named = os.path.realpath(folder), open, named
        self.taken: Counter[str] = Counter()
        self.files: list[str] = []  # read so far, absolute paths: the file that the user named first
        self.images: set[bytes] = set()  # digests of the images whose pixels are counted

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
        """Return whether a path may be read and is a regular file."""
        return os.path.isfile(path) and self.holds(path)  # Path.is_file raises where a name is too long

    def read(self, path: str | Path, where: str, small: bool = False) -> bytes:
        """Return the bytes of a regular file. Raises SceneError: outside, not to be read, or beyond the limits.

        small: a file of the scene's own text. All is asked of the open file, as another may take its name meanwhile.
        """
        try:
            with open(path, "rb", opener=_open if self.open or path == self.named else self._without_links) as file:
                state = os.fstat(file.fileno())
                if not stat.S_ISREG(state.st_mode):
                    raise OSError("there is no such file")
                if small:
                    self.take(where, "bytes in a scene file", state.st_size)
                self.take(where, "files")
                self.take(where, "bytes in files", state.st_size)
                self.files.append(os.path.abspath(path))
                data = file.read(state.st_size + 1)
        except SceneError:
            raise
        except ValueError:  # a name with a zero byte
            raise SceneError(f"{where}: there is no such file") from None
        except OSError as error:
            why = f"the file cannot be read: {error.strerror}" if error.errno else error  # of the system, or below
            raise SceneError(f"{where}: {why}") from None
        if len(data) > state.st_size:
            raise SceneError(f"{where}: the file grows while it is read; wait until it is written, and open it again")
        return data

    def _without_links(self, path: str, flags: int) -> int:
        """Open the file that a path leads to now, below the folder; a link put there meanwhile is not followed."""
        real = Path(os.path.realpath(path))
        if not real.is_relative_to(self.folder):
            raise OSError("lies outside the folder of the scene; move it there, or give --allow-outside")
        if os.open not in os.supports_dir_fd or not os.path.isfile(real):  # Windows, where links need a privilege
            return _open(str(real), flags)
        *folders, name = real.relative_to(self.folder).parts
        above = os.open(self.folder, FOLDER)
        for of, name_flags in (*((f, FOLDER) for f in folders), (name, flags | os.O_NONBLOCK)):
            try:
                below = os.open(of, name_flags | os.O_NOFOLLOW, dir_fd=above)
            finally:
                os.close(above)
            above = below
        return above

    def take(self, where: str, what: str, amount: int = 1) -> None:
        """Add to the scene's amount of `what`, a key of LIMITS. Raises SceneError beyond the limit, adding nothing."""
        total = self.taken[what] + amount
        if total > LIMITS[what]:
            raise SceneError(
                f"{where}: a scene must have no more than {LIMITS[what]:,} {what}, got {total:,}; "
                "simplify it, or write two scenes"
            )
        self.taken[what] = total


def _open(path: str, flags: int) -> int:
    """Open a regular file, and no device, which may act on it."""
    if not os.path.isfile(path):
        raise OSError("this is a folder" if os.path.isdir(path) else "there is no such file")
    return at_once(path, flags)


def at_once(path: str, flags: int) -> int:
    """Open a file without waiting for the other end of a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def like_named(path: Path) -> Path:
    """Return a path, or the one file beside it whose name differs in case alone, as other systems do not tell."""
    if os.path.isfile(path):
        return path
    try:
        alike = [name for name in os.listdir(path.parent) if name.lower() == path.name.lower()]
    except (OSError, ValueError):  # no such folder, or a name with a zero byte
        return path
    return path.parent / alike[0] if len(alike) == 1 else path


def text_of(data: bytes, errors: str = "strict") -> str:
    """Return UTF-8 as text with one kind of line end, without the mark that some editors write first."""
    return io.TextIOWrapper(io.BytesIO(data), "utf-8-sig", errors).read()

"""Checks that files and folders can be written, before the work; files written whole or not at all."""

from __future__ import annotations

import os
import re
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from app.settings import Settings, UsageError
from gi_core.scene import Scene


def check_writable(option: str, file: Path, suffix: str = "") -> None:
    """Raise UsageError, one sentence naming the option, if a file cannot be written; the check leaves no file.

    suffix: that the file must have; "": any.
    """
    if suffix and file.suffix.lower() != suffix:
        raise UsageError(f"{option} must name a {suffix} file, got {file}")
    if not os.path.isdir(file.resolve().parent):
        raise UsageError(f"{option} must name a file in a folder that exists, got {file}")
    if os.path.isdir(file):
        raise UsageError(f"{option} must name a file, and {file} is a folder; write {file / 'a'}{file.suffix}")
    remove_parts(file.resolve().parent)
    if os.path.exists(file) and os.access(file, os.W_OK):
        return
    try:
        _try(_part_of(file.resolve()))
    except OSError as error:
        raise UsageError(
            f"{option} {file} cannot be written ({error.strerror or error}); name a file elsewhere"
        ) from None


def check_no_input(option: str, file: Path, settings: Settings, scene: Scene) -> None:
    """Raise UsageError, one sentence naming the option, if a scene or its settings were read from a file."""
    inputs = (settings.document, *(name for names in scene.files for name in names))
    if os.path.realpath(file) in map(os.path.realpath, filter(None, inputs)):
        raise UsageError(f"{option} {file} is a file of the scene, which stays as it is; name another file")


def check_folder(variable: str, folder: Path) -> None:
    """Raise UsageError, one sentence naming an environment variable, if a folder cannot be made or written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _try(folder / f"{os.getpid()}.part")
    except OSError as error:
        raise UsageError(
            f"the folder {folder} cannot be written ({error.strerror or error}); set {variable} to another folder"
        ) from None


def remove_parts(folder: Path) -> None:
    """Remove parts of files that killed processes of this machine left, see replacing(), where that can be done."""
    if os.name != "posix":
        return
    for path in folder.glob("*.part"):
        if (of := re.fullmatch(r"[0-9a-f]{8}\.(\d{1,9})\.part", path.name)) and not _runs(int(of[1])):
            with suppress(OSError):
                path.unlink()


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # of another user
        pass
    return True


def _try(file: Path) -> None:
    """Create and remove a file: permissions alone do not reveal a read-only or full file system."""
    file.touch()
    file.unlink()


def write_whole(file: Path, content: str | bytes) -> None:
    """Replace a file at once by text (UTF-8) or bytes. Raises OSError."""
    with replacing(file) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Yield the path of a new file that replaces `file` at the end: others find the old file or the new one.

    The mode of the old file stays, and so does a link to it. A device or a pipe is written to itself. Raises OSError.
    """
    if file.exists() and not file.is_file() and not file.is_dir():
        yield file
        return
    real = Path(os.path.realpath(file))
    part = _part_of(real)
    try:
        yield part
        if real.is_file():
            shutil.copymode(real, part)
        os.replace(part, real)
    except BaseException as problem:
        part.unlink(missing_ok=True)
        if isinstance(problem, OSError) and problem.filename is None:  # a full disk
            problem.filename = str(file)
        raise


def _part_of(file: Path) -> Path:
    """Return where a file is written first: beside it, by a short name, as its own may be as long as names can be.

    It is no tempfile, which only its owner could read.
    """
    return file.with_name(f"{zlib.crc32(os.fsencode(file.name)):08x}.{os.getpid()}.part")

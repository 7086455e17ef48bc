"""Checks that files and folders can be written, before the work; files written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from app.settings import UsageError


def check_writable(option: str, file: Path) -> None:
    """Raise UsageError, one sentence naming the option, if a file cannot be written; the check leaves no file."""
    if not os.path.isdir(file.resolve().parent):
        raise UsageError(f"{option} must name a file in a folder that exists, got {file}")
    if os.path.isdir(file):
        raise UsageError(f"{option} must name a file, and {file} is a folder; write {file / 'a'}{file.suffix}")
    if os.path.exists(file) and os.access(file, os.W_OK):
        return
    try:
        _try(file.resolve().with_name(f"{file.name}.{os.getpid()}.part"))
    except OSError as error:
        raise UsageError(
            f"{option} {file} cannot be written ({error.strerror or error}); name a file elsewhere"
        ) from None


def check_no_input(option: str, file: Path) -> None:
    """Raise UsageError, one sentence naming the option, if a file belongs to a scene that has been read."""
    from gi_core.files.formats.boundary import files_read

    if os.path.realpath(file) in files_read:
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


def _try(file: Path) -> None:
    """Create and remove a file: permissions alone do not reveal a read-only or full file system."""
    file.touch()
    file.unlink()


def write_whole(file: Path, content: str | bytes) -> None:
    """Replace a file at once: readers and interrupts find the old file or the new one. Raises OSError."""
    part = file.with_name(f"{file.name}.{os.getpid()}.part")  # not a tempfile, which only its owner could read
    try:
        part.write_bytes(content.encode() if isinstance(content, str) else content)
        os.replace(part, file)
    except BaseException as problem:
        part.unlink(missing_ok=True)
        if isinstance(problem, OSError) and problem.filename is None:  # a full disk
            problem.filename = str(file)
        raise

"""The disk cache of compiled kernels: a trusted folder, and damaged files compiled again.

numba unpickles these files, which can run any code, so the folder must belong to this user alone.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path

from numba.core.caching import FunctionCache

problems: list[str] = []  # sentences: why the program is slower than it could be, at most one per cause


class KernelCache(FunctionCache):
    """numba's cache of a function; a file that cannot be read is replaced, one that cannot be written ends caching."""

    ended = False  # of this process

    def load_overload(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # truncated, empty, or no pickle: unpickling raises anything
            return None

    def save_overload(self, sig, data) -> None:
        if KernelCache.ended:
            return
        try:
            try:
                super().save_overload(sig, data)
            except OSError:
                raise
            except Exception:  # a damaged index
                self.flush()
                super().save_overload(sig, data)
        except OSError as error:  # a full disk
            KernelCache.ended = True
            problems.append(_without_cache(self.cache_path, f"cannot be written ({error.strerror or error})"))


def usable_folder(folder: Path) -> Path:
    """Return a folder for compiled kernels: the given one if it can be trusted and written, else a temporary one.

    Child processes share the temporary folder through NUMBA_CACHE_DIR. It is deleted when this process ends.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            reason = _distrust(folder)
    except OSError as error:
        reason = f"cannot be written ({error.strerror or error})"
    if not reason:
        return folder
    problems.append(_without_cache(folder, reason))
    elsewhere = tempfile.mkdtemp(prefix="gi-viewer-")
    atexit.register(shutil.rmtree, elsewhere, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = elsewhere
    return Path(elsewhere)


def _distrust(folder: Path) -> str:
    """Return why files of a folder must not be loaded; "" if only this user and root can have written them."""
    if os.name != "posix":
        return ""
    status, user = folder.stat(), os.geteuid()
    if status.st_uid != user:
        return "belongs to another user"
    if status.st_mode & 0o022:
        return "can be written by other users"
    for path in folder.rglob("*"):
        of = path.lstat()
        if of.st_uid not in (0, user):
            return f"holds {path.name} of another user"
        if status.st_mode & 0o077 and of.st_mode & 0o022 and not path.is_symlink():  # else nobody can reach it
            return f"holds {path.name}, which other users can write"
    return ""


def _without_cache(folder: Path | str, reason: str) -> str:
    return f"{folder} {reason}: kernels are compiled at every start; free it, or set NUMBA_CACHE_DIR to another folder"

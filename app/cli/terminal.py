"""The terminal: exit codes with their line on stderr, printable output, a quiet end at a closed pipe.

Names in files may contain terminal commands, and letters outside its encoding.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable
from contextlib import redirect_stderr, redirect_stdout
from enum import IntEnum

from gi_core.scene.errors import printable


class Exit(IntEnum):
    """Codes that the program exits with."""

    OK = 0
    INCOMPLETE = 1
    USAGE = 2
    SCENE = 3
    NO_GL = 4
    STOPPED = 130


def fail(error: object, code: int) -> int:
    """Print an error as one line on stderr; return `code`."""
    print("gi-viewer: " + re.sub(r"\s*[^\S ]\s*", " ", str(error).strip()), file=sys.stderr)
    return code


class _Printable:
    """A text stream that escapes all but printable characters and line breaks, and a carriage return by itself."""

    def __init__(self, stream) -> None:
        self._stream = stream

    def __getattr__(self, name: str):
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        encoding = self._stream.encoding or "utf-8"
        lines = text if text == "\r" else "\n".join(map(printable, text.split("\n")))
        return self._stream.write(lines.encode(encoding, "backslashreplace").decode(encoding))


def say(lines: Iterable[str]) -> None:
    """Print lines; line breaks of names are escaped, so that no file can add a line."""
    print("\n".join(map(printable, lines)))


def guarded(run: Callable[[], int]) -> int:
    """Call a function with safe output streams; return its exit code, or that of an output which cannot be written."""
    out, err = (stream and _Printable(stream) for stream in (sys.stdout, sys.stderr))
    with redirect_stdout(out), redirect_stderr(err):
        try:
            try:
                return run()
            finally:
                _flush()
        except BrokenPipeError:  # `gi-viewer info | head`
            return 141  # a closed pipe: 128 + SIGPIPE, the shell's convention
        except OSError as error:
            return fail(error, Exit.USAGE)


def _flush() -> None:
    """Flush both streams. A failed one is replaced by the null device, because the interpreter will flush it again."""
    problem = None
    for stream in filter(None, (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except OSError as error:
            problem = error
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    if problem:
        raise problem

"""Child processes: of compilers, first looks and measurements. They end when the program ends, for whatever reason."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def start(module: str, *options: str, **popen) -> subprocess.Popen:
    """Start `python -m module` with an open pipe as its input; popen: arguments of Popen."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *options],
        cwd=Path(__file__).parents[2],  # gi_core and app are importable there, installed or not
        stdin=subprocess.PIPE,  # closes when this process ends for any reason
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        **popen,
    )


@contextmanager
def killed_at_end(process: subprocess.Popen) -> Iterator[subprocess.Popen]:
    """Kill a process at the end of the block, if it still runs."""
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def prepare() -> None:
    """Make this process such a child: it ends with its input, and rarely collects garbage."""
    threading.Thread(target=_end_with_input, daemon=True).start()
    gc.freeze()
    # 100_000 objects between collections: numba makes many that live on; a tenth less time than with Python's 700
    gc.set_threshold(100_000)


def _end_with_input() -> None:
    while os.read(0, 1):  # not by sys.stdin: its lock would abort the interpreter's end
        pass
    os._exit(0)

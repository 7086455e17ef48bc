"""malloc's arenas: few under glibc, untouched elsewhere."""

from __future__ import annotations

import platform
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from app import worker
from app.worker import ARENAS

ROOT = Path(__file__).parents[3]
IN_THREADS = """
import ctypes, re, sys, threading
from app.worker import limit_arenas
if sys.argv[1] == "limited":
    limit_arenas()
together = threading.Barrier(8)
def work():
    together.wait()
    blocks = [ctypes.create_string_buffer(50_000) for _ in range(10)]
    together.wait()
threads = [threading.Thread(target=work) for _ in range(8)]
[t.start() for t in threads]
[t.join() for t in threads]
libc = ctypes.CDLL(None)
with open(sys.argv[2], "w") as out:
    libc.fdopen.restype = ctypes.c_void_p
    file = libc.fdopen(out.fileno(), b"w")
    libc.malloc_info(0, ctypes.c_void_p(file))
    libc.fflush(ctypes.c_void_p(file))
print(len(re.findall("<heap nr", open(sys.argv[2]).read())))
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="malloc_info is glibc's")
def test_many_threads_share_few_arenas(tmp_path):
    def arenas(how):
        ran = [sys.executable, "-c", IN_THREADS, how, tmp_path / "arenas"]
        return int(subprocess.run(ran, cwd=ROOT, capture_output=True, text=True, check=True).stdout)

    assert arenas("limited") <= ARENAS < arenas("as it is")


@pytest.mark.parametrize("problem", [None, OSError, TypeError])
def test_other_c_libraries_are_left_alone(monkeypatch, problem):
    def library(name):
        if problem is not None:
            raise problem("not here")
        return SimpleNamespace()  # another C library

    monkeypatch.setattr(worker.ctypes, "CDLL", library)
    assert worker.limit_arenas() is None

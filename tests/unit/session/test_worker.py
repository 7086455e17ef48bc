"""The end of a program whose threads still work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from app.worker import Worker

RUNS = 6  # of which half aborted
PROGRAM = """
import time
import numpy as np
from app.worker import Worker

numbers = np.random.default_rng(0).integers(0, 1000, 200_000)

def work():
    until = time.monotonic() + 0.3
    while time.monotonic() < until:
        np.unique(numbers)
    print("done")

worker = Worker()
call = worker.submit(work)
assert not call.wait(0.05)
"""


def test_the_end_of_the_program_awaits_a_running_call():
    for _ in range(RUNS):
        ended = subprocess.run(
            [sys.executable, "-c", PROGRAM], cwd=Path(__file__).parents[3], capture_output=True, text=True
        )
        assert (ended.returncode, ended.stdout, ended.stderr) == (0, "done\n", "")


def test_a_call_after_the_end_of_a_worker_fails_at_once():
    for started in (False, True):
        worker = Worker()
        if started:
            assert worker.submit(lambda: 1).result() == 1
        worker.close()
        late = worker.submit(lambda: 2)
        assert late.wait(0.0)
        with pytest.raises(RuntimeError, match="has ended"):
            late.result()

"""Kernels are compiled before a user waits for one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from gi_core import warmup
from gi_core.disc_search import SEARCHES


@pytest.mark.parametrize("name", SEARCHES)
def test_the_warm_up_splats_with_every_search(name, monkeypatch):
    """Sums that are kept when the search is switched must not keep the warm-up from compiling it."""
    calls, made, solver = [], SEARCHES[name], warmup._trace()
    splat = made.splat

    def counted(self, *given):
        calls.append(solver.setting.pretest)
        return splat(self, *given)

    monkeypatch.setattr(made, "splat", counted)
    warmup._search(solver, name)
    assert len(set(calls)) == 2  # without a pre-test, and with one


def test_the_process_that_compiles_from_behind_ends_with_the_one_that_started_it():
    command = [sys.executable, "-m", "gi_core.warmup", warmup.FROM_BEHIND]
    with subprocess.Popen(command, cwd=Path(__file__).parents[1], stdin=subprocess.PIPE) as process:
        process.stdin.close()
        assert process.wait(timeout=60) == 0

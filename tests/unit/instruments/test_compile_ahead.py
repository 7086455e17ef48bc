"""Kernels are compiled before a user waits for one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from gi_core.discs.search import SEARCHES
from gi_core.instruments import compile_ahead


@pytest.mark.parametrize("name", SEARCHES)
def test_the_warm_up_runs_every_search(name, monkeypatch):
    calls, made = [], SEARCHES[name]
    accumulate = made.accumulate

    def counted(self, *given):
        calls.append(len(given))
        return accumulate(self, *given)

    monkeypatch.setattr(made, "accumulate", counted)
    compile_ahead._search(compile_ahead._trace(compile_ahead._tiny_scene(), None), name)
    assert calls


@pytest.mark.slow
def test_background_compiler_ends_with_its_parent():
    command = [sys.executable, "-m", "gi_core.instruments.compile_ahead", compile_ahead.FROM_BEHIND]
    with subprocess.Popen(command, cwd=Path(__file__).parents[3], stdin=subprocess.PIPE) as process:
        process.stdin.close()
        assert process.wait(timeout=60) == 0

"""Kernels are compiled before a user waits for one."""

from __future__ import annotations

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

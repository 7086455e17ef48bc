"""More photons than fit into memory: as many as fit are traced, and the solver reports it."""

from __future__ import annotations

import numpy as np

from gi_core.base import memory
from gi_core.estimators import ESTIMATORS
from gi_core.frames import background
from gi_core.solver import Solver
from tests.support.scene_builders import coloured_room


def test_memory_left_is_a_number_or_unknown(tmp_path, monkeypatch):
    assert memory.available() is None or memory.available() > 0
    monkeypatch.setattr(memory, "_MACHINE", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    assert memory.available() is None
    (tmp_path / "meminfo").write_text("MemTotal: 9 kB\nMemAvailable:     4000 kB\n")
    assert memory.available() == 4_096_000
    (tmp_path / "memory.max").write_text("3000000\n")
    (tmp_path / "memory.current").write_text("1000000\n")
    assert memory.available() == 2_000_000
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.available() == 4_096_000


def test_photons_are_limited_by_memory(estimator, monkeypatch):
    wanted = Solver(coloured_room(), estimator, photons=40_000, radius=0.15)
    taken = [0]
    real = background.PathStore.append

    def counted(store, *given):
        real(store, *given)
        taken[0] = store.photons

    a_photon = 4 * (background.BYTES_PER_VERTEX + ESTIMATORS[estimator](wanted.model, wanted.setting).bytes_per_hit)
    monkeypatch.setattr(background.PathStore, "append", counted)
    monkeypatch.setattr(memory, "available", lambda: background.SPARE_MEMORY + (20_000 - taken[0]) * a_photon)
    assert list(wanted.solve_steps())[-1].stage == "done"
    assert wanted.frame.store.memory_full
    assert 10_000 < wanted.frame.photons < 40_000
    assert np.array_equal(wanted.irradiance, wanted.from_scratch())
    again = [p.picture for p in wanted.solve_steps()]
    assert not any(again)  # nothing to do
    monkeypatch.undo()
    wanted.solve()
    assert not wanted.frame.store.memory_full
    assert wanted.frame.photons == 40_000

"""Warnings about complete light that differs from the request: once in the log, and by `render`."""

from __future__ import annotations

from dataclasses import replace

import pytest

from app.cli.progress import warnings_of
from app.commands import render
from app.session.log import Log
from app.session.opening import Opened
from app.session.session import Session
from app.settings import Settings
from gi_core.solver import Solver
from tests.support.scene_builders import furnace_scene


def solved(reflectance: float, photons: int = 4_000) -> Solver:
    solver = Solver(furnace_scene(1.0, reflectance, 2), "impact_count", photons, threads=1)
    solver.solve()
    return solver


def test_memory_is_reported():
    solver = solved(0.5)
    assert warnings_of(solver) == {}
    solver.frame.store.memory_full = True
    assert warnings_of(solver) == {"memory": "memory holds no more than 4,000 of the 4,000 photons wanted"}


def test_log_reports_truncated_light_once(monkeypatch):
    monkeypatch.setattr("gi_core.base.memory.available", lambda: 0)
    settings = Settings(estimator="impact_count", photons=8_000, radius=0.1, neighbours=50, exposure=0.0)
    session = Session(settings, Log(), open_with=lambda settings: None)
    session.adopt(Opened(settings, solved(0.5), None, (), None))
    for radius in (0.1, 0.2):
        session.want(replace(session.settings, radius=radius))
        while session.refining:
            session.tick(1 / 60)
        session.log(f"radius {radius}")  # separates repeated lines, which the log would merge
    session.close()
    said = [e.text for e in session.log.entries if "memory holds" in e.text]
    assert len(said) == 1


@pytest.mark.parametrize("full", [True, False])
def test_render_says_it(full, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    if full:
        monkeypatch.setattr("gi_core.base.memory.available", lambda: 0)
    settings = Settings(scene="bright", estimator="impact_count", photons=2_000, size=(16, 16))
    monkeypatch.setattr(render, "open_scene", lambda s: furnace_scene(1.0, 0.5, 2))
    render.render(settings, tmp_path / "a.png")
    err = capsys.readouterr().err
    assert err.count("memory holds") == full and err.count("\n") == full

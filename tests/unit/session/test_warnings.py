"""What is said of complete light that is not what was asked for: in the log once, by `info` and by `render`."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from app.commands import render
from app.measure import scene_info
from app.session.log import Log
from app.session.opening import Opened
from app.session.session import Session
from app.session.warnings import caveats
from app.settings import Settings
from gi_core.solver import Solver
from tests.support.scene_builders import furnace_scene


def solved(reflectance: float, photons: int = 4_000) -> Solver:
    solver = Solver(furnace_scene(1.0, reflectance, 2), "impact_count", photons, threads=1)
    solver.solve()
    return solver


@pytest.mark.parametrize("reflectance", [0.5, 0.9, 0.95, 0.98, 0.999])
def test_light_that_is_cut_off_is_told_where_it_is_much(reflectance):
    """rho^63 of a closed room's light: 0.1 % at 0.9, 3.9 % at 0.95, 28 % at 0.98, 94 % at 0.999."""
    share, photons = reflectance**63, 4_000
    text = caveats(solved(reflectance, photons)).get("truncated", "")
    assert bool(text) == (reflectance > 0.94)
    if text:
        told = int(re.match(r"(\d+) % of the light is cut off", text)[1]) / 100
        assert told == pytest.approx(share, abs=5 * np.sqrt(share * (1 - share) / photons) + 0.005)


def test_memory_is_told():
    solver = solved(0.5)
    assert caveats(solver) == {}
    solver.frame.store.memory_full = True
    assert caveats(solver) == {"memory": "memory holds no more than 4,000 of the 4,000 photons wanted"}


def test_the_log_has_it_once():
    settings = Settings(estimator="impact_count", photons=4_000, radius=0.1, neighbours=50, exposure=0.0)
    session = Session(settings, Log(), open_with=lambda settings: None)
    session.adopt(Opened(settings, solved(0.98), (), None))
    for radius in (0.1, 0.2):
        session.want(replace(session.settings, radius=radius))
        while session.refining:
            session.tick(1 / 60)
        session.log(f"radius {radius}")  # a line that comes back at once would be one line anyhow
    session.close()
    said = [e.text for e in session.log.entries if "cut off" in e.text]
    assert len(said) == 1


def test_info_and_render_say_it(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    settings = Settings(scene="bright", estimator="impact_count", photons=2_000, size=(16, 16))
    for reflectance, expected in ((0.98, 1), (0.5, 0)):
        for command in (scene_info, render):
            monkeypatch.setattr(command, "open_scene", lambda s, r=reflectance: furnace_scene(1.0, r, 2))
        told = scene_info.info(settings)
        assert sum(line.startswith("warning: ") and "cut off" in line for line in told) == expected
        render.render(settings, tmp_path / "a.png")
        err = capsys.readouterr().err
        assert err.count("cut off") == expected and err.count("\n") == expected

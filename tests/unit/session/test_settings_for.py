"""Settings for another scene: those of the old scene go; a saved scene gives all that it can hold."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from app.cli import saved_scene
from app.session.reload import settings_for
from app.settings import LampLevel, Settings
from app.window import files

OLD = Settings(
    "a.toml", photons=5_000, lamps=(LampLevel("ceiling", 0.5),), solo="ceiling", tone_map="clip", light="photons",
    poses=(("cat", (0.0, 0.0, 0.0)),), camera=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 40.0), reference=True,
)  # fmt: skip


def test_a_plain_scene_takes_over_looks_alone():
    s = settings_for(SimpleNamespace(settings=OLD, requests=SimpleNamespace(filled={})), "b.glb", ("c.glb",))
    assert s == Settings("b.glb", ("c.glb",), tone_map="clip", light="photons", reference=True)


def test_a_saved_scene_gives_all_that_it_holds(tmp_path):
    path = tmp_path / "b.toml"
    there = Settings("cornell", lamps=(LampLevel("light", 2.0),), poses=(("pawn", (0.1, 0.2, 0.3, 1.0, 0, 0, 0)),))
    saved_scene.write(path, there)
    s = settings_for(SimpleNamespace(settings=OLD, requests=SimpleNamespace(filled={})), str(path), ("c.glb",))
    assert s.levels(()) == there.levels(()) and not s.solo
    assert replace(s, lamps=(), document="") == replace(there, lamps=(), mobiles=("c.glb",), reference=True)


def test_a_dimmed_lamp_and_a_moved_object_are_changes():
    kept = files.Files()
    session = SimpleNamespace(settings=Settings(), poses={"pawn": 1}, edits=(), ready=True)
    kept._clean = files._state(session)
    assert not kept.has_changed(session)
    session.settings = replace(session.settings, lamps=(LampLevel("light", 0.5),))
    assert kept.has_changed(session)
    session.settings = Settings(show="irradiance", estimator="photon_map", light="best")
    assert not kept.has_changed(session)
    session.poses = {"pawn": 2}
    assert kept.has_changed(session)

"""Every command runs to its end: without an option, and with all options of each of its groups at once.

The room has 500 receivers; nothing else makes a command small but its own numbers (`tests.support.small_scale`).
"""

import argparse
from collections.abc import Iterator

import pytest

from app import __main__ as cli
from app.commands import COMMANDS
from gi_core.files import load
from gi_core.instruments import compile_ahead
from gi_core.rays.accelerator import Accelerator
from tests.support.small_scale import small_room, small_work

VALUES = {  # of each option, or of one command's; None: a flag
    "--mobile": "cube.obj", "--pose": "cube=0.4,0.0,0.4", "--camera": "0.5,0.5,0.1,0.5,0.5,0.9,50", "--max-edge": "0.4",
    "--up": "y", "--units": "radiometric", "--allow-outside": None,
    "--estimator": "photon_map", "--photons": "3000", "--radius": "0.12", "--neighbours": "20", "--no-control": None,
    "--no-border-correction": None, "--textbook": None, "--search": "ray_cache", "--light": "best", "--gloss": "list",
    "--lamp": "lamp=0.5", "--watts": "lamp=30", "--maintenance-factor": "0.8", "--hold": None,
    "--rays": "octree", "--seed": "3",
    "--size": "60x40", "--exposure": "1", "--no-white-balance": None, "--tone-map": "clip", "--show": "illuminance",
    "--illuminance-range": "1,100", "--luminance-range": "1,100", "--isolines": "auto", "--no-cull": None,
    "--daylight": "place = [40.4, -3.7], date = 2026-03-21, hour = 9, utc_offset = 1",
    "--surface": 'name = "a", size = [0.6, 0.6]',
    "--budget": "20", "--screenshot": "shot.png", "--error": "30",
    "--frames": "2", "--step": "2", "--json": "a.json", "--check": None, "--csv": "a.csv", "--points": "30",
    "--scale": "2", "--seconds": "0", "--rate": "5", "--still": None, "--truth": "16", "--quick": None,
    "--light-map": "64", "--shares": None,
    ("render", "--out"): "a.webp", ("bake", "--out"): "b.glb", ("chart", "--out"): "c", ("atlas", "--out"): "d",
    ("report", "--out"): "r.html",
}  # fmt: skip
ELSEWHERE = {"--help", "--version", "--no-fallback"}  # test_cli.py
NEEDED = {"atlas": "--out atlas", "report": "--out r.html"}


def groups() -> Iterator[tuple[str, str, list[str]]]:
    """Yield command, name of the group and arguments of every run."""
    for name in ("", *COMMANDS):
        parser = cli._filled(argparse.ArgumentParser(), name or "view")
        yield name, "bare", NEEDED.get(name, "").split()
        for group in parser._action_groups:
            options = [o for a in group._group_actions for o in a.option_strings[-1:] if o not in ELSEWHERE]
            words = [w for o in options for w in (o, VALUES.get((name, o)) or VALUES[o]) if w is not None]
            if options:
                yield name, group.title, words + (NEEDED.get(name, "").split() if "--out" not in options else [])


@pytest.fixture
def small(tmp_path, monkeypatch):
    """Work in a folder with the room, where no window opens."""
    small_work(monkeypatch)
    small_room(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path / "reference"))
    monkeypatch.setattr("app.window.window.why_no_window", lambda: "no display")
    return tmp_path


@pytest.mark.parametrize(("command", "words"), [pytest.param(c, w, id=f"{c or 'view'}, {g}") for c, g, w in groups()])
def test_a_command_runs(command, words, small, monkeypatch, capsys):
    """A structure of rays asked for traces every ray; Embree traces in its place, so that no kernel is compiled.

    Loading traces with the default structure, so that meshes do not depend on the choice.
    """
    asked, make, read = [], Accelerator.__init__, load.load_scene

    def recorded(self, surfaces, threads=1, rays=None):
        asked.append(rays)
        make(self, surfaces, threads)
        self.rays = rays

    def loaded(*arguments, **options):
        scene = read(*arguments, **options)
        asked.clear()
        return scene

    if "--rays" in words:
        monkeypatch.setattr(Accelerator, "__init__", recorded)
        monkeypatch.setattr(compile_ahead, "is_warm", lambda *_: True)
        monkeypatch.setattr(load, "load_scene", loaded)
    room = [] if command == "atlas" else ["room.toml"]
    assert cli.main([*command.split(), *room, *words]) == 0, capsys.readouterr().err
    assert set(asked) == ({"octree"} if "--rays" in words else set())
    for file in (
        w for o, w in zip(words, words[1:], strict=False) if o in ("--out", "--json", "--csv", "--screenshot")
    ):
        assert (small / file).stat().st_size > 0

"""`--rays NAME` reaches every ray that a command traces."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from app import __main__ as cli
from app.cli.options import settings_of
from app.measure.atlas import command as atlas
from app.measure.atlas import row
from app.measure.chart import figure
from gi_core.instruments import compile_ahead
from gi_core.rays.accelerator import Accelerator
from gi_core.rays.structures import STRUCTURES
from tests.support.scene_builders import furnace_scene
from tests.support.small_charts import small_charts

FEW = "cornell --max-edge 0.2 --photons 512"
RUNS = {  # arguments of a small run of every command
    "": f"{FEW} --size 32x24",
    "render": f"{FEW} --size 32x24 --out a.png",
    "bake": f"{FEW} --out a.glb",
    "bench": f"{FEW} --frames 2",
    "tune": f"{FEW} --budget 16",
    "info": FEW,
    "measure": "furnace --plane 0.2,0.2,0.8,0.8,0.5,1,1 --error 20",
    "reference": "furnace --error 50",
    "chart": "cornell --max-edge 0.2 --quick --frames 2 --points 40 --out chart",
    "atlas": "--out atlas",
}


def one_row() -> Iterator[row.AtlasRow]:
    solver = row.solved(furnace_scene(), 100)
    yield row.AtlasRow("a", "a", "0", 0.0, row.Number(float(solver.irradiance.mean())))


def rays_of(words: list[str]) -> str:
    arguments = cli.parse(words)
    return arguments.rays if words[0] == "atlas" else settings_of(arguments).rays


@pytest.mark.parametrize("command", ["", *cli.COMMANDS])
def test_every_command_traces_with_the_structure_asked_for(command, tmp_path, monkeypatch, capsys):
    """All accelerators are asked for an octree; Embree traces in its place, so that no kernel is compiled.

    Loading traces with the default structure, so that meshes do not depend on the choice.
    """
    words, asked, make = [*command.split(), *RUNS[command].split()], [], Accelerator.__init__

    def recorded(self, surfaces, threads=1, rays=None):
        asked.append(rays)
        make(self, surfaces, threads)
        self.rays = rays

    for name in STRUCTURES:
        assert rays_of([*words, "--rays", name]) == name
    small_charts(monkeypatch)
    monkeypatch.setattr("gi_core.files.load.with_corners_at_crossings", lambda mesh, materials: mesh)
    monkeypatch.setattr(figure, "draw", lambda rows, about, out: (out / "chart.svg").write_text("<svg></svg>"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path / "reference"))
    monkeypatch.setattr("app.window.window.why_no_window", lambda: "no display")
    monkeypatch.setattr(compile_ahead, "is_warm", lambda *_: True)
    monkeypatch.setattr(atlas.atlas, "__defaults__", ({"A bright room": one_row}, None))
    monkeypatch.setattr(Accelerator, "__init__", recorded)
    assert cli.main([*words, "--rays", "octree"]) == 0, capsys.readouterr().err
    assert set(asked) == {"octree"}

"""Measurements of few photons, a rough truth and tiny pictures, and the room of every command."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from app import settings
from app.draw import fine_mesh
from app.measure import atlas
from app.measure.atlas import row
from app.measure.chart import measure as chart_measure
from gi_core.display.fine_points import fine_points
from gi_core.photons import pilot
from tests.support.mesh_writers import write_scene
from tests.support.scene_builders import furnace_scene

ROOM = """
[static]
mesh = "room.obj"
max_edge = 0.3
[camera]
position = [0.5, 0.5, 0.1]
target = [0.5, 0.5, 0.9]
[[mobile]]
name = "cube"
mesh = "cube.obj"
position = [0.3, 0.0, 0.3]
[[probe]]
name = "floor"
position = [0.7, 0.0, 0.7]
normal = [0, 1, 0]
[defaults]
photons = 4096
radius = 0.1
"""


def small_room(folder: Path, name: str = "room.toml") -> Path:
    """Write a room of 500 receivers with a lamp called lamp, a cube to move and a probe."""
    return write_scene(folder, ROOM, name)


def small_charts(patch: pytest.MonkeyPatch) -> None:
    """Make every part of `chart` small; without --quick too."""
    less = {"photons": (4096, 8192), "limit_photons": 32_768, "truth": 0.1}
    quick = chart_measure.QUICK._replace(gathered_seconds=0.3, **less)
    full = chart_measure.FULL._replace(
        radii=(1.0, 2.0), paths=(1, 4), frames=3, points=60, poses=2, gathered_noise=0.05, gathered_seconds=0.1, **less
    )
    patch.setattr(chart_measure, "QUICK", quick)
    patch.setattr(chart_measure, "FULL", full)


def one_row() -> Iterator[row.AtlasRow]:
    solver = row.solved(furnace_scene(), 100)
    yield row.AtlasRow("a", "a", "0", 0.0, row.Number(float(solver.irradiance.mean())))


def small_work(patch: pytest.MonkeyPatch) -> None:
    """Make all measurements, pictures, time for gathering and the default settings of bare meshes small."""
    small_charts(patch)
    least = {"limit_photons": 8192, "truth": 0.5, "gathered_seconds": 0.0, "radii": (1.0,), "photons": (4096,)}
    for name in ("QUICK", "FULL"):  # they run, and their numbers are not read
        patch.setattr(chart_measure, name, getattr(chart_measure, name)._replace(**least))
    patch.setattr(pilot, "PHOTONS", 1024)
    patch.setattr(fine_mesh, "fine_points", partial(fine_points, most=100))
    k = list(settings.Settings.__dataclass_fields__).index("size")
    values = settings.Settings.__init__.__defaults__
    patch.setattr(settings.Settings.__init__, "__defaults__", (*values[:k], (60, 40), *values[k + 1 :]))
    patch.setattr(settings, "SECONDS", 0.1)
    patch.setattr("gi_core.defaults.MOST_PHOTONS", 4096)
    patch.setattr("gi_core.files.load.COARSEST", 0.5)
    patch.setattr(
        "matplotlib.figure.Figure.savefig", lambda _, file, **__: file.write_text("<svg>")
    )  # test_chart.py draws
    patch.setattr(atlas.atlas, "__defaults__", ({"A bright room": (one_row,)},))

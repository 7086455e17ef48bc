"""The disc index where a uniform grid is the wrong structure."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.discs.search import SEARCHES
from gi_core.discs.search.disc_grid import MAX_CELLS, DiscGrid
from gi_core.scene.types import PointLight, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import floor, grey, merge, sphere


def stadium() -> Scene:
    """Two detailed balls on a floor a kilometre wide."""
    static = merge(floor(1000.0, 8), sphere((200.0, 100.0, 1.0), 0.5, 4), sphere((-300.0, 50.0, 1.0), 0.5, 4))
    lights = [PointLight(f"lamp {k}", (x, y, 2.5), (100.0,) * 3) for k, (x, y) in enumerate([(200, 101), (-300, 51)])]
    return Scene(static, (grey(0.5),), (), tuple(lights), up=(0.0, 0.0, 1.0), name="stadium")


def index_of(scene: Scene, radius: float, search: str = "disc_index"):
    solver = Solver(scene, photons=20_000, radius=radius, search=search)
    solver.solve()
    return solver, solver.frame.background.estimate.searches[0]


def test_dense_clusters_get_separate_grids():
    _, index = index_of(stadium(), 0.05)
    assert len(index.grids) == 3
    whole = DiscGrid(index.discs, np.arange(len(index.discs.positions)))
    most = max(int(np.diff(g.cells.first).max()) for g in index.grids)
    assert most < 0.1 * int(np.diff(whole.cells.first).max())  # blocks in the fullest cell
    assert sum(len(g.cells.first) for g in index.grids) < MAX_CELLS


@pytest.mark.parametrize("search", SEARCHES)
def test_dense_clusters_give_the_same_bits(search):
    expected = index_of(stadium(), 0.05, "brute_force")[0].irradiance
    assert expected.max() > 0
    assert np.array_equal(index_of(stadium(), 0.05, search)[0].irradiance, expected)


def test_an_ordinary_scene_has_one_grid():
    _, index = index_of(stadium(), 5.0)
    assert len(index.grids) == 1

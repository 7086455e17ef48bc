"""`gi-viewer bench --tables`: measurements and tables; times are not tested."""

import numpy as np
import pytest

from app import __main__ as cli
from app.measure.bench import report
from app.measure.bench.report import Times, markdown
from gi_core.discs.search import SEARCHES
from gi_core.instruments.timing import (
    KINDS,
    Cost,
    Structure,
    built,
    costs,
    photon_lines,
    rays_of,
    search_run,
    static_discs,
)
from gi_core.model import Model
from gi_core.scene.types import Camera, Material, PointLight, Scene
from tests.support.scene_builders import floor, grey, merge, quad, solve


def two_parts() -> Scene:
    """A floor and, apart from it, a two-sided leaf over it."""
    static = merge(floor(2.0, 6), quad((-0.3, -0.3, 0.5), (0.6, 0, 0), (0, 0.6, 0), (3, 3), 1))
    materials = (grey(0.5), Material("leaf", two_sided=True))
    return Scene(static, materials, (), (PointLight("lamp", (0, 0, 1), (1.0,) * 3),), up=(0, 0, 1), name="two parts")


def test_parts_add_up_to_the_whole():
    scene = two_parts()
    solver = solve(scene, "impact_count", photons=2000)
    over = photon_lines(solver, 2000, 0.2)
    sets = (None, (scene.materials[0].name,), ("leaf",))
    for search in SEARCHES:
        made = (SEARCHES[search](static_discs(solver.model, 0.2, m)) for m in sets)
        whole, ground, leaf = (search_run(s, over)() for s in made)
        assert whole == ground + leaf
        assert ground > 100 and leaf > 100


def measured(grid: tuple[float, ...], spheres: tuple[float, ...], radii) -> dict:
    out = {}
    for receivers in ("whole", "tree", "ground"):
        for r, a, b in zip(radii, grid, spheres, strict=True):
            out[receivers, report.DISC_INDEX, r] = Times(a, a / 10, (4.0, 20.0))
            out[receivers, report.RAY_CACHE, r] = Times(b, b / 10, None)
    return out


def test_every_number_of_the_report_is_beside_ours():
    steps = (0.001, 0.002, 0.003, 0.004)
    tree = measured(steps, steps[::-1], report.TREE_RADII)
    found = {"tree 10000": tree, "tree 20000": tree, "second 20000": measured(steps, steps, report.SECOND_RADII)}
    facts = {"machine": "machine", "tree": "tree", "second": "second"}
    text = markdown(facts, found)
    for table in (report.TREE_10000, report.TREE_20000, report.SECOND_20000):
        for numbers in table.values():
            assert all(f"({x:g})" in text for x in numbers)
    for table in (report.VOXELS_10000, report.VOXELS_20000, report.VOXELS_SECOND):
        assert all(f"({x})" in text for numbers in table.values() for x in numbers)
    assert "500, frame" not in text
    assert np.char.count(text, "\n## ") == 3


@pytest.mark.parametrize("arguments", [["--tables"], ["--out", "x"]])
def test_tables_need_a_folder(arguments, capsys):
    assert cli.main(["bench", *arguments]) == cli.Exit.USAGE
    assert "--tables and --out" in capsys.readouterr().err


def test_structures_of_rays_have_a_table_at_their_best_leaf_sizes():
    cost = {name: dict.fromkeys(KINDS, Cost(us * 1e-6, 10.0, 5.0)) for name, us in (("a", 4.0), ("b", 2.0), ("e", 1.0))}
    rows = [(Structure("embree", 0, None, 0.1, 0), cost["e"])]
    rows += [(Structure("bvh", leaf, None, 0.02, 3_000_000), cost[k]) for leaf, k in ((1, "a"), (4, "b"))]
    text = report.partitionings({"cornell": rows})
    assert "| bvh | 4 | 20 | 3 | 2 | 2 | 2 | 2, 2, 2 | 10.0 | 5.0 |" in text
    assert "bvh, us per random ray over leaf sizes: 4 at 1, 2 at 4" in text and text.count("embree") == 1


def test_rays_of_a_table_come_from_the_picture_and_end_at_lamps():
    model = Model(two_parts(), threads=1)
    camera = Camera((0.0, -2.0, 0.6), (0.0, 0.0, 0.4), 30.0)
    found = rays_of(model, camera, 400)
    assert set(found) == set(KINDS)
    shadow = found["shadow"]
    ends = shadow.origin + shadow.limit[:, None] * shadow.direction
    assert np.abs(ends - [0, 0, 1]).max() < 1e-3 and len(ends) > 25
    made = [built(name, [(model.surfaces.vertices[0], model.surfaces.faces[0])]) for name in ("bvh", "none")]
    tree, every = costs(made, found, repeats=1)
    assert every["random"].tests == len(model.surfaces.faces[0]) > tree["random"].tests > 0

"""`gi-viewer bench --tables`: what is measured, and what is made of it; how long things take is no test's business."""

from __future__ import annotations

import numpy as np
import pytest

from app import __main__ as cli
from app.measure import report_facts as report
from app.measure.bench import jobs as bench_jobs
from app.measure.bench.report_tables import Times, crossover, markdown
from gi_core.discs.search import PRETESTS, SEARCHES
from gi_core.instruments.search_timing import SearchTrial, few_receivers, photon_lines, static_discs
from gi_core.scene.types import Material, PointLight, Scene
from gi_core.solver import Solver
from tests.support import control_scenes
from tests.support.scene_builders import floor, grey, merge, quad


def two_parts() -> Scene:
    """A floor and, apart from it, a two-sided leaf over it."""
    static = merge(floor(2.0, 6), quad((-0.3, -0.3, 0.5), (0.6, 0, 0), (0, 0.6, 0), (3, 3), 1))
    materials = (grey(0.5), Material("leaf", two_sided=True))
    return Scene(static, materials, (), (PointLight("lamp", (0, 0, 1), (1.0,) * 3),), up=(0, 0, 1), name="two parts")


def test_parts_add_up_to_the_whole():
    scene = two_parts()
    solver = Solver(scene, "impact_count", photons=2000)
    solver.solve()
    over = photon_lines(solver, 2000, 0.2)
    sets = (None, (scene.materials[0].name,), ("leaf",))
    for search in SEARCHES:
        whole, ground, leaf = (SearchTrial(search, static_discs(solver.model, 0.2, m)).run(over)() for m in sets)
        assert whole == ground + leaf
        assert ground > 100 and leaf > 100


def measured(grid: tuple[float, ...], spheres: tuple[float, ...], radii) -> dict:
    out = {}
    for receivers in ("whole", "tree", "ground"):
        for r, a, b in zip(radii, grid, spheres, strict=True):
            out[receivers, report.DISC_INDEX, r] = Times(a, a / 10, 100, 10, (4.0, 20.0))
            out[receivers, report.RAY_CACHE, r] = Times(b, b / 10, 100, 10, None)
    return out


def test_where_two_curves_cross():
    radii = (1.0, 2.0, 3.0)
    assert "they cross at 2.500" in crossover(measured((1, 5, 15), (10, 10, 10), radii), "every")
    assert crossover(measured((1, 1, 1), (2, 3, 4), radii), "frame").startswith("disc indexing is faster at every")
    assert crossover(measured((5, 5, 5), (2, 3, 4), radii), "frame").startswith("the ray cache is faster at every")


def test_every_number_of_the_report_is_beside_ours():
    steps = (0.001, 0.002, 0.003, 0.004)
    tree = measured(steps, steps[::-1], report.TREE_RADII)
    found = {"tree 10000": tree, "tree 20000": tree, "second 20000": measured(steps, steps, report.SECOND_RADII)}
    pretests = {(s, p): (0.5, 0.25) for s in (report.RAY_CACHE, report.DISC_INDEX) for p in PRETESTS}
    facts = {"machine": "machine", "tree": "tree", "second": "second"}
    estimators = {name: (1.0, 2.0, 3.0) for name in report.ESTIMATORS}
    jobs = [("chair", 764, 1399, dict.fromkeys(bench_jobs.SEARCHES, 0.00125))]
    text = markdown(facts, found, pretests, dict.fromkeys(PRETESTS, 1.5), estimators, jobs)
    for table in (report.TREE_10000, report.TREE_20000, report.SECOND_20000):
        for numbers in table.values():
            assert all(f"({x:g})" in text for x in numbers)
    for table in (report.VOXELS_10000, report.VOXELS_20000, report.VOXELS_SECOND):
        assert all(f"({x})" in text for numbers in table.values() for x in numbers)
    assert all(f"({told[k]:g})" in text for told in report.PRETESTS.values() for k in (1, 3))
    assert "139.54 %" in text and "500, frame" not in text
    assert np.char.count(text, "\n## ") == 7
    assert "they cross at 0.024" in text
    assert "| chair | 764 | 1,399 | 1.2 |" in text


def test_few_receivers_are_those_of_a_frame():
    """A leg on a floor: its own receivers, those of the floor beside it, and probes; crossings are what they are."""
    case = control_scenes.leg(True)
    solver = Solver(case.scene, photons=20_000, radius=case.radius)
    solver.solve()
    jobs = few_receivers(solver, probes=(1, 5))
    assert [job.name for job in jobs] == ["body", "in contact", "a probe", "5 probes"]
    assert len(jobs[1].discs.positions) == solver.control_facts.stale > 0
    assert jobs[0].lines.low.size and jobs[2].lines.low.size == solver.segments_total
    for job in jobs:
        found = {SearchTrial(search, job.discs).run(job.lines)() for search in SEARCHES}
        assert len(found) == 1
    assert found != {0}


@pytest.mark.parametrize("arguments", [["--tables"], ["--out", "x"]])
def test_tables_need_a_folder(arguments, capsys):
    assert cli.main(["bench", *arguments]) == cli.USAGE
    assert "--tables and --out" in capsys.readouterr().err

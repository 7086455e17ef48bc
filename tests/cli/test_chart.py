"""The chart: measurement, resumption, drawing; its errors and shares are correct."""

import csv
import sys
from dataclasses import replace

import numpy as np
import pytest

from app import __main__ as cli
from app.measure.chart import measure
from app.measure.chart.figure import front, styles
from app.measure.chart.measure import Measurer, Walk, errors, rival_light
from app.measure.chart.settings import (
    FULL,
    REPORT,
    RIVAL,
    beside,
    choice_like,
    choices,
)
from app.measure.chart.truth import PoseTruth, cases, choose
from app.settings import LampLevel, Settings, make_solver, open_scene
from gi_core.geometry.error import relative_error
from gi_core.geometry.receiver_classes import CLASSES
from tests.support.small_scale import small_charts

SMALL = Settings("cornell", max_edge=0.2, photons=8192)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Make every part small, and keep truths out of the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path_factory.mktemp("reference")))
        small_charts(patch)
        yield


@pytest.fixture(scope="module")
def measured(small, tmp_path_factory):
    """Return the folder and the rows of a quick run."""
    out = tmp_path_factory.mktemp("measured")
    run = run_of(out)
    run.measure()
    return out, run.rows


def command(out, *more) -> int:
    return cli.main(["chart", "cornell", "--max-edge", "0.2", "--quick", "--frames", "3", "--points", "60", "--out",
                     str(out), *more])  # fmt: skip


def table(out) -> list[dict]:
    with open(out / "results.csv", newline="") as file:
        return list(csv.DictReader(file))


# -- the command --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_run_is_measured_and_drawn(small, tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    out = tmp_path / "chart"
    measured = []
    row = Measurer._row
    monkeypatch.setattr(Measurer, "_row", lambda self, c, *a: measured.append(c) or row(self, c, *a))
    assert command(out) == 0
    first = table(out)
    assert {r["curve"] for r in first} == set(styles()) and len(measured) == 20 and len(first) == 20 + 2
    for r in first:
        assert 0 < float(r["total all"]) < 2 and float(r["frame_ms"]) > 0 and float(r["truth all"]) < 0.2
    said = capsys.readouterr().out
    assert "22 settings" in said and str(out.resolve() / "index.html") in said

    page = (out / "index.html").read_text()
    assert "<svg" in page
    assert 'src="http' not in page and "href=" not in page.replace("xlink:href=", "")  # no rows of other machines
    assert (out / "chart.png").read_bytes()[:4] == b"\x89PNG" and "</svg>" in (out / "chart.svg").read_text()


def test_more_photons_and_paths_are_nearer_the_truth(measured):
    _, rows = measured
    by = {(r["curve"], r["photons"]): r for r in rows}  # of two numbers of paths the larger
    for curve, few, many in (("impact_count", 4096, 8192), ("path gather", 1, 4)):
        assert by[curve, many]["total all"] < by[curve, few]["total all"]
    gathered, rested = "tangent_plane, gathered light", "tangent_plane, at rest"
    assert all(0 < r["noise all"] < 1 for r in by.values() if r["curve"] not in ("path gather", gathered, rested))
    for name in ("affected", "mobile"):
        assert by[rested, 8192][f"total {name}"] < 1.05 * by[gathered, 8192][f"total {name}"]
    assert by[gathered, 4096]["total untouched"] < 0.5 * by["tangent_plane, while dragged", 4096]["total untouched"]
    assert by[gathered, 4096]["total mobile"] < 0.7 * by["tangent_plane", 4096]["total mobile"]
    dragged, all_photons = by["tangent_plane, while dragged", 4096], by["tangent_plane", 4096]
    assert dragged["total untouched"] < all_photons["total untouched"]  # walls keep the light of all photons


def test_a_setting_that_fails_costs_no_other(small, tmp_path, monkeypatch, capsys):
    """All others are in the table and drawn; one sentence names the setting, and the exit code tells."""
    pytest.importorskip("matplotlib")
    row = Measurer._row

    def broken(self, choice, *others):
        if choice.estimator == "photon_map" and choice.photons == 4096:
            raise ArithmeticError("no light")
        return row(self, choice, *others)

    monkeypatch.setattr(Measurer, "_row", broken)
    assert command(tmp_path, "--estimator", "photon_map") == 1
    assert (
        "photon_map, 4,096 photons, k 1000 could not be measured: ArithmeticError('no light')"
        in capsys.readouterr().err
    )
    assert [(r["curve"], r["photons"]) for r in table(tmp_path)] == [
        ("photon_map", "8192"), ("path gather", "1"), ("path gather", "4"),
    ]  # fmt: skip
    assert (tmp_path / "index.html").stat().st_size > 0


def run_of(out) -> measure.Run:
    class Silent:
        def __call__(self, *_):
            pass

    settings = replace(SMALL, photons=None)
    return measure.Run(open_scene(settings), settings, True, 3, 60, out, Silent())


def test_missing_matplotlib_gets_one_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert command(tmp_path / "chart") == 2
    assert "pip install matplotlib" in capsys.readouterr().err


def test_interrupt_prints_what_is_kept(tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")

    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(measure.Run, "measure", interrupted)
    assert command(tmp_path) == 130
    assert "stopped; 0 settings are in" in capsys.readouterr().err


def test_a_scene_without_mobiles_is_refused(tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("app.settings.open_scene", lambda s: replace(open_scene(s), mobiles=()))
    assert command(tmp_path) == 2
    assert "cornell has no mobile to move: add one with --mobile FILE" in capsys.readouterr().err


# -- measured values ----------------------------------------------------------------------------------


def test_given_settings_are_not_varied():
    solver = make_solver(open_scene(SMALL), SMALL)
    every = choices(replace(SMALL, photons=None), solver, FULL)
    assert len({c.radius for c in every}) == 3 and {c.photons for c in every} == set(FULL.photons)
    assert len(every) == len(set(every))
    given = choices(replace(SMALL, radius=0.02, estimator="tangent_plane"), solver, FULL)
    assert {(c.estimator, c.photons) for c in given} == {("tangent_plane", 8192)}
    assert not any(c.control for c in choices(replace(SMALL, control=False), solver, FULL))
    assert {c.curve for c in every} | {RIVAL} == set(styles())


def test_the_truth_has_the_levels_of_the_lamps(small):
    """Also those of a saved scene: the truth of a dimmed lamp was that of the full one."""
    settings = replace(SMALL, lamps=(LampLevel("lamp", 0.25),))
    solvers = [make_solver(open_scene(s), s) for s in (SMALL, settings)]
    for solver in solvers:
        solver.solve()
    full, dimmed = (cases(s, [s.poses], [0], 20, 0.3, 0, lambda *_: None)[0] for s in solvers)
    assert np.array_equal(full.rows, dimmed.rows)
    assert np.array_equal(0.25 * full.truth, dimmed.truth)
    walk = Walk([solvers[0].poses], [full])
    seen = [rival_light(s, walk, 1, 0)[0] for s in solvers]
    assert np.array_equal(0.25 * seen[0], seen[1])


def test_the_choice_of_receivers_stands_for_all():
    """Sums of weights are the areas of the classes; over many choices, so is the mean of any function."""
    random = np.random.default_rng(1)
    areas, side = random.exponential(size=400), random.integers(0, 4, 400)
    f = random.random(400) * (1 + side)
    sides = {name: side == k for k, name in enumerate(CLASSES)}
    sums = []
    for _ in range(300):
        rows, weights, kind = choose(sides, areas, 60, random)
        assert (side[rows] == kind).all()
        for k in range(4):
            assert weights[kind == k].sum() == pytest.approx(areas[side == k].sum())
        sums.append((weights * f[rows]).sum())
    error = np.std(sums, ddof=1) / np.sqrt(len(sums))
    assert abs(np.mean(sums) - (areas * f).sum()) < 4 * error and error < 0.01 * (areas * f).sum()
    rows, weights, _ = choose(sides, areas, 10_000, random)  # more than exist: all of them
    assert sorted(rows) == list(range(400)) and weights == pytest.approx(areas[rows])


def test_errors_are_those_of_error_py():
    random = np.random.default_rng(2)
    E, T, end = random.random((3, 30, 3))
    kind, w = np.repeat([0, 1, 2], 10), random.random(30)
    near, up = np.zeros((15, 3)), np.tile((0.0, 1.0, 0.0), (15, 1))
    poses = enumerate((slice(0, 15), slice(15, 30)))
    cases = [PoseTruth(k, None, w[s], kind[s], T[s], 0.01 * T[s], (near, up)) for k, s in poses]
    seen, limit = ([a[:15], a[15:]] for a in (E, end))
    found = errors(seen, limit, cases)
    assert found["total all"] == pytest.approx(relative_error(E, T, w).l1)
    assert found["total l2 mobile"] == pytest.approx(relative_error(E, T, w, kind == 2).l2)
    assert found["noise affected"] == pytest.approx(relative_error(E, end, w, kind == 1).l1)
    assert found["bias untouched"] == pytest.approx(relative_error(end, T, w, kind == 0).l1)
    assert np.isnan(found["total border"]) and found["points border"] == 0
    assert found["truth all"] == pytest.approx(0.01 * np.sqrt(2 / np.pi))
    same = errors([2 * T[:15], 3 * T[15:]], None, cases)
    assert found["clouds 90"] >= found["clouds"] > 0.1 and same["clouds 90"] == 0, "a factor is no cloud"


def test_front_is_the_pareto_set():
    points = [(1, 9), (2, 9.5), (3, 4), (3, 5), (4, 4), (5, 1)]
    assert front(points) == [(1, 9), (3, 4), (5, 1)] and front([]) == []


def test_rows_of_the_report_find_theirs():
    for then in (REPORT[3], REPORT[4]):
        like = choice_like(then, 2.0, 50)
        assert (like.photons, like.radius, like.control) == (10_000, 0.02, False)
        assert like.textbook == (then.estimator == "photon_map")
        right = {**like._asdict(), "mark": 1}
        rows = [{**right, "mark": 2, **wrong} for wrong in ({"control": True}, {"radius": 0.04}, {"traced": 5})]
        found = dict((t, r) for t, r in beside([*rows, right], 2.0))
        assert found[then]["mark"] == 1 and sum(r is not None for r in found.values()) == 1

"""`bench`: its numbers, their bounds, and the history of fixed cases."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import pytest

from app import __main__ as cli
from app.draw import motion
from app.measure.bench import command, history
from app.measure.bench.row import measure_row
from app.measure.bench.rows import Row
from app.settings import STEP, Settings, make_solver, open_scene

FAST = ["cornell", "--photons", "2000"]
KEYS = """format scene triangles receivers photons estimator control radius threads processor commit frames frame_ms
stages_ms bounds share_cut segments_changed us_per_cut_photon from_scratch_ms from_scratch_ratio first_frame_ms
peak_rss_mb
bits_equal""".split()


def one_line(text: str) -> str:
    assert len(text.splitlines()) == 1 and "Traceback" not in text, text
    return text


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Return a function that runs bench on cornell once for each choice of options; numbers and file."""
    folder, kept = tmp_path_factory.mktemp("bench"), {}

    def run(*options: str):
        if options not in kept:
            file = folder / f"{len(kept)}.json"
            assert cli.main(["bench", *FAST, "--frames", "24", "--json", str(file), *options]) == 0
            kept[options] = json.loads(file.read_text()), file
        return kept[options]

    return run


def test_json_has_every_number_and_light_equals_from_scratch(measured, estimator):
    n, _ = measured("--estimator", estimator)
    assert set(KEYS) <= set(n)
    assert n["bits_equal"] is True and n["frames"] == 24 and n["estimator"] == estimator and n["control"] is True
    f = n["frame_ms"]
    assert 0 < f["min"] <= f["median"] <= f["p95"] <= f["max"]
    assert 0 < f["cpu"] and (n["load"] is None or n["load"] >= 0)
    assert n["photons"] == 2000 and n["first_frame_ms"] > 0 and n["from_scratch_ms"] > 0 and n["stages_ms"]
    assert (n["queries"] is None) == (estimator != "photon_map")


def test_gathering_mobiles_are_timed(measured):
    """Their discs are not searched; bounds used to request the segments near them."""
    n, _ = measured("--light", "best")
    assert n["bits_equal"] is True and "gather" in n["stages_ms"]


def test_step_option_sets_the_distance_per_frame(measured, monkeypatch):
    steps, walk = [], motion.walk
    monkeypatch.setattr(motion, "walk", lambda paths, step, frames: steps.append(step) or walk(paths, step, frames))
    n, _ = measured("--no-control", "--step", "0.2")
    size = make_solver(open_scene(Settings()), Settings(photons=10)).scene_size
    assert steps == [pytest.approx(0.002 * size)] and n["step_percent"] == pytest.approx(0.2)
    assert "one step of 0.2 % of the scene size" in "\n".join(command.table(n))


def test_queries_of_photon_map_are_compared_with_a_full_estimate(measured):
    q = measured("--estimator", "photon_map")[0]["queries"]
    assert 0 < q["stale_share"] < 1 and q["queries"] > 0 and q["us_a_query"] > 0
    assert q["allowed_ms"] == pytest.approx(q["full_estimate_ms"] * q["stale_share"])


def test_artifact_control_is_switched_off_and_shown(measured, capsys):
    n, _ = measured("--no-control")
    assert n["control"] is False
    assert "without artifact control" in "\n".join(command.table(n))
    assert make_solver(open_scene(Settings()), Settings(photons=10, control=False)).setting.control is False


def test_the_table_has_frame_bound_and_memory(measured):
    text = "\n".join(command.table(measured("--no-control")[0]))
    assert "GI frame" in text and "same bits     yes" in text
    assert "x its bound" in text and "rays at" in text and "disc tests" in text and "GB/s" in text
    busy = "\n".join(command.table({**measured("--no-control")[0], "load": 7.0}))
    assert "7.0 threads ran or waited" in busy and "CPU" in busy


def test_bounds_are_sums_of_work_and_below_measured_times(measured, estimator):
    """The machine may be busy with something else, so only a bound above the whole frame is an error."""
    n, _ = measured("--estimator", estimator)
    b = n["bounds"]
    for name, stage in b["stages"].items():
        assert stage["bound_ms"] == pytest.approx(sum(w["ms"] for w in stage["work"].values())), name
        if stage["ratio"] is not None:
            assert stage["ratio"] == pytest.approx(n["stages_ms"][name] / stage["bound_ms"])
    assert b["frame_bound_ms"] == pytest.approx(sum(s["bound_ms"] for s in b["stages"].values()))
    assert 0 < b["frame_bound_ms"] < n["frame_ms"]["max"]
    assert b["frame_cpu_ratio"] == pytest.approx(n["frame_ms"]["cpu"] / (b["frame_bound_ms"] * n["threads"]))
    assert b["copy_gb_per_s"] > 0
    named = {s for s, stage in b["stages"].items() if stage["ratio"] is not None}
    assert "estimate" in named and named <= set(n["stages_ms"])


def test_the_tree_bench_has_light_to_move():
    """Along the tree's path half a percent of the photons or more are cut in the median frame."""
    settings = Settings("tree", photons=10_000, estimator="impact_count")
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    for frames in (50, 200):
        cut = []
        for poses in motion.walk(motion.paths_of(solver), STEP, frames):  # the tree is 1 m in size
            solver.move_all(poses)
            cut.append(solver.frame.changes.photons_cut)
        share = sorted(cut)[frames // 2] / solver.frame.photons
        assert share >= 0.005, f"{frames} frames: {100 * share:.3f} % of the photons cut in the median frame"


def test_bench_needs_a_mobile(capsys, monkeypatch):
    monkeypatch.setattr("app.settings.open_scene", lambda s: replace(open_scene(s), mobiles=()))
    assert cli.main(["bench", *FAST]) == 2
    assert "--mobile FILE" in one_line(capsys.readouterr().err)


# History --------------------------------------------------------------------------------------------


def test_the_history_has_a_row_per_case_and_run_and_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    file = tmp_path / "history.csv"
    cheap = [Row(e, Settings("cornell", photons=500, estimator=e), 3, {}) for e in ("impact_count", "tangent_plane")]
    assert history.history(file, measured=cheap, run=measure_row) == [file]
    assert history.history(file, True, cheap[:1], measure_row) == [file, tmp_path / "history.svg"]
    with open(file, newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [row["case"] for row in rows] == ["impact_count", "tangent_plane", "impact_count"]
    for row in rows:
        assert tuple(row) == history.COLUMNS and row["commit"] and row["processor"] and row["date"].startswith("20")
        assert all(float(row[name]) > 0 for name in history.COLUMNS if name.endswith("_ms"))
    assert "tangent_plane" in (tmp_path / "history.svg").read_text()


def test_the_fixed_cases_are_twelve():
    cases = history.cases()
    assert len({row.key for row in cases}) == len(cases) == 12
    assert {row.settings.scene for row in cases} == {"tree", "cornell", "living_room", "gallery"}


def test_a_history_refuses_other_columns_and_a_plot_without_a_file(tmp_path, capsys):
    file = tmp_path / "other.csv"
    file.write_text("a,b\n1,2\n")
    assert cli.main(["bench", "--history", str(file)]) == 2
    assert "has other columns" in one_line(capsys.readouterr().err)
    assert cli.main(["bench", "--plot"]) == 2
    assert "--plot draws the rows of --history" in one_line(capsys.readouterr().err)

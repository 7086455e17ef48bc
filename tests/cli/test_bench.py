"""`bench`: its numbers, the bounds beside them, memory that does not grow with the frames, ratios of two files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from app import __main__ as cli
from app.draw import motion
from app.measure.bench import command
from app.measure.bench.compare import numbers
from app.measure.bench.series import Series
from app.settings import STEP, Settings, make_solver, open_scene

FAST = ["cornell", "--photons", "2000"]
KEYS = """format scene triangles receivers photons estimator control radius threads processor commit frames frame_ms
stages_ms bounds share_cut segments_changed us_per_cut_photon from_scratch_ms from_scratch_ratio first_frame_ms rss_mb
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


def test_every_number_is_written_and_the_light_is_that_from_scratch(measured, estimator):
    n, _ = measured("--estimator", estimator)
    assert set(KEYS) <= set(n)
    assert n["bits_equal"] is True and n["frames"] == 24 and n["estimator"] == estimator and n["control"] is True
    f = n["frame_ms"]
    assert 0 < f["min"] <= f["median"] <= f["p95"] <= f["max"] and f["first_tenth"] > 0 and f["last_tenth"] > 0
    assert 0 < f["cpu"] and (n["load"] is None or n["load"] >= 0)
    assert n["photons"] == 2000 and n["first_frame_ms"] > 0 and n["from_scratch_ms"] > 0 and n["stages_ms"]
    assert (n["photon_map"] is None) == (estimator != "photon_map")


def test_the_step_that_is_asked_for_is_gone(measured, monkeypatch):
    steps, walk = [], motion.walk
    monkeypatch.setattr(motion, "walk", lambda paths, step, frames: steps.append(step) or walk(paths, step, frames))
    n, _ = measured("--no-control", "--step", "0.2")
    size = make_solver(open_scene(Settings()), Settings(photons=10)).scene_size
    assert steps == [pytest.approx(0.002 * size)] and n["step_percent"] == pytest.approx(0.2)
    assert "one step of 0.2 % of the scene size" in "\n".join(command.table(n))


def test_queries_of_photon_map_are_told_against_a_full_estimate(measured):
    q = measured("--estimator", "photon_map")[0]["photon_map"]
    assert 0 < q["stale_share"] < 1 and q["queries"] > 0 and q["us_a_query"] > 0
    assert q["allowed_ms"] == pytest.approx(q["full_estimate_ms"] * q["stale_share"])


def test_artifact_control_is_switched_off_and_shown(measured, capsys):
    n, _ = measured("--no-control")
    assert n["control"] is False
    assert "without artifact control" in "\n".join(command.table(n))
    assert make_solver(open_scene(Settings()), Settings(photons=10, control=False)).setting.control is False


def test_the_table_tells_frame_bound_and_memory(measured):
    text = "\n".join(command.table(measured("--no-control")[0]))
    assert "GI frame" in text and "same bits     yes" in text
    assert "x its bound" in text and "rays at" in text and "disc tests" in text and "GB a second" in text
    busy = "\n".join(command.table({**measured("--no-control")[0], "load": 7.0}))
    assert "7.0 threads wanted a core" in busy and "CPU" in busy
    assert "first tenth" in text and "last tenth" in text


def test_bounds_are_sums_of_their_work_and_below_what_was_measured(measured, estimator):
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
            cut.append(solver.changes.photons_cut)
        share = sorted(cut)[frames // 2] / solver.photons_traced
        assert share >= 0.005, f"{frames} frames: {100 * share:.3f} % of the photons cut in the median frame"


def test_bench_needs_a_mobile(capsys, monkeypatch):
    monkeypatch.setattr("app.settings.open_scene", lambda s: replace(open_scene(s), mobiles=()))
    assert cli.main(["bench", *FAST]) == 2
    assert "--mobile FILE" in one_line(capsys.readouterr().err)


# Memory ---------------------------------------------------------------------------------------------


def test_a_series_keeps_a_bounded_number_of_its_numbers_and_its_extremes():
    series, short = Series(room=64), Series(room=64)
    values = np.random.default_rng(1).permutation(100_000).astype(float)
    for v in values:
        series.add(v)
    assert len(series._kept) < 64 and series.count == 100_000
    assert (series.min, series.max) == (0, 99_999)
    assert series.median == pytest.approx(50_000, rel=0.35), "32 or more of the numbers, evenly spread"
    place = series.place_of_median()
    assert abs(values[place] - series.median) == min(abs(v - series.median) for v, _ in series._kept)
    for v in range(63):
        short.add(v)
    assert short.median == 31 and short.quantile(1.0) == 62 and short.place_of_median() == 31, "all of few are kept"


def test_frames_leave_nothing_behind_that_grows(monkeypatch):
    """Three times the frames: the same number of poses, and no more numbers kept than there is room for."""
    from app.cli.progress import Bar
    from app.measure.bench import measure

    monkeypatch.setattr(measure, "LAP", 5)
    monkeypatch.setattr(measure, "Series", lambda: Series(room=16))
    settings = Settings(photons=200, estimator="impact_count")
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    lap = [dict(solver.poses)] * 5
    for frames in (60, 180):
        walked = measure._walk(solver, lap, frames, Bar())
        everything = [walked.frame, walked.cut, walked.changed, walked.stale, *walked.stages.values()]
        assert all(s.count == frames and len(s._kept) < 16 for s in everything)
        assert walked.first_tenth.count == walked.last_tenth.count == frames // 10


# Comparing ------------------------------------------------------------------------------------------


def test_compare_prints_ratios_of_what_both_have(measured, tmp_path, capsys):
    n, a = measured("--no-control")
    other = {**n, "from_scratch_ms": 3 * n["from_scratch_ms"], "only_here": 5}
    b = tmp_path / "b.json"
    b.write_text(json.dumps(other))
    capsys.readouterr()
    assert cli.main(["bench", "--compare", str(a), str(b)]) == 0
    lines = {line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines()}
    assert lines["from_scratch_ms"][2] == "3.000" and lines["frame_ms.median"][2] == "1.000"
    assert lines["receivers"][2] == "1.000" and "only_here" not in lines and "bits_equal" not in lines


def test_numbers_are_found_at_any_depth():
    assert numbers({"a": 1, "b": {"c": 2.5, "d": {"e": 3}}, "f": True, "g": "x", "h": None, "asked": {"z": 1}}) == {
        "a": 1,
        "b.c": 2.5,
        "b.d.e": 3,
    }


@pytest.mark.parametrize("text", ["", "[1, 2]", '{"frame_ms": 3}', '{"format": "gi-viewer bench 2"}', "\xff\xfe"])
def test_compare_refuses_a_file_that_is_not_ours_in_one_sentence(text, measured, tmp_path, capsys):
    a = measured("--no-control")[1]
    b = tmp_path / "b.json"
    b.write_bytes(text.encode("latin-1"))
    capsys.readouterr()
    assert cli.main(["bench", "--compare", str(a), str(b)]) == 2
    assert f"{b} was not written by" in one_line(capsys.readouterr().err)
    assert cli.main(["bench", "--compare", str(a), str(tmp_path / "nowhere.json")]) == 2
    assert "nowhere.json" in one_line(capsys.readouterr().err)


def test_compare_refuses_a_run_against_a_sweep(measured, tmp_path, capsys):
    a = measured("--no-control")[1]
    b = tmp_path / "sweep.json"
    b.write_text('{"format": "gi-viewer sweep 1", "rows": {}}')
    capsys.readouterr()
    assert cli.main(["bench", "--compare", str(a), str(b)]) == 2
    assert "the other a sweep" in one_line(capsys.readouterr().err)

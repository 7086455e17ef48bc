"""`bench --sweep`: rows, resumption, complete files, tables."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app import __main__ as cli
from app.measure.bench import sweep as bench_sweep
from app.measure.bench.sweep import markdown, measure_row, photons_key, rows, run_apart
from app.settings import Settings, UsageError

TREE = Settings("tree")
ROOT = Path(__file__).resolve().parents[2]


def numbers(spec: dict, ms: float = 2.0) -> dict:
    """Return invented numbers of the shape that a row's process returns."""
    s = spec["settings"]
    return {
        "scene": s["scene"], "triangles": 72_000, "receivers": 72_000,
        "photons": s["photons"], "estimator": s["estimator"], "control": s["control"], "radius": 0.01, "threads": 2,
        "frame_ms": {"median": ms, "p95": 2 * ms, "cpu": 1.5 * ms}, "load": 0.3,
        "stages_ms": {"scan": 0.5, "estimate": 1.5},
        "share_cut": 0.01, "segments_changed": 100.0, "us_per_cut_photon": 1.2, "from_scratch_ms": 50.0,
        "from_scratch_ratio": 25.0, "first_frame_ms": 400.0, "peak_rss_mb": 900.0, "bits_equal": True,
    }  # fmt: skip


def test_rows_match_the_table():
    keys = [row.key for row in rows(TREE, 100)]
    assert len(set(keys)) == len(keys)
    for photons in (10_000, 100_000, 1_000_000):
        assert {photons_key(photons, e) for e in ("tangent_plane", "photon_map", "impact_count")} <= set(keys)
    assert [row.step for row in rows(TREE, 100) if row.key == bench_sweep.SLOW] == [0.003]
    for row in rows(TREE, 100):
        assert row.settings.control is row.key.endswith("artifact control") and row.settings.neighbours == 50
        assert json.loads(json.dumps(row.spec())) == row.spec(), "or every row would be measured again on resuming"


def test_stopped_sweep_resumes_with_missing_rows(tmp_path):
    """Stopped in the fifth row, which is then missing; files are complete; the second run measures only the rest."""
    asked = []

    def stopped(spec):
        if len(asked) == 4:
            raise KeyboardInterrupt
        asked.append(spec)
        return numbers(spec)

    with pytest.raises(KeyboardInterrupt):
        bench_sweep.sweep(TREE, 10, tmp_path, run=stopped)
    have = json.loads((tmp_path / "sweep.json").read_text())
    assert len(have["rows"]) == 4 and "# Sweep of tree" in (tmp_path / "sweep.md").read_text()

    later = []
    done = bench_sweep.sweep(TREE, 10, tmp_path, run=lambda spec: later.append(spec) or numbers(spec))
    every = [row.spec() for row in rows(TREE, 10)]
    assert [s for s in every if s not in later] == asked and len(later) == len(every) - 4
    assert list(done["rows"]) == [row.key for row in rows(TREE, 10)]
    assert bench_sweep.sweep(TREE, 10, tmp_path, run=None) == json.loads((tmp_path / "sweep.json").read_text())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sweep.json", "sweep.md"], "nothing left aside"


def test_changed_options_measure_rows_again(tmp_path):
    bench_sweep.sweep(TREE, 10, tmp_path, run=numbers)
    asked = []
    bench_sweep.sweep(TREE, 20, tmp_path, run=lambda spec: asked.append(spec) or numbers(spec))
    assert len(asked) == len(rows(TREE, 20))


def test_failed_row_is_listed_and_retried(tmp_path):
    bad = photons_key(100_000, "photon_map")

    def run(spec):
        if spec["settings"]["estimator"] == "photon_map" and spec["settings"]["photons"] == 100_000:
            raise UsageError("no memory left")
        return numbers(spec)

    done = bench_sweep.sweep(TREE, 10, tmp_path, run=run)
    assert done["failed"] == {bad: "no memory left"} and bad not in done["rows"]
    assert f"{bad}: no memory left" in (tmp_path / "sweep.md").read_text()
    done = bench_sweep.sweep(TREE, 10, tmp_path, run=numbers)
    assert done["failed"] == {} and bad in done["rows"]


def test_folder_with_another_sweep_is_refused(tmp_path):
    bench_sweep.sweep(TREE, 10, tmp_path, run=numbers)
    with pytest.raises(UsageError, match="scene tree, now it is cornell"):
        bench_sweep.sweep(Settings("cornell"), 10, tmp_path, run=numbers)
    (tmp_path / "sweep.json").write_text("{}")
    with pytest.raises(UsageError, match="is not a sweep"):
        bench_sweep.sweep(TREE, 10, tmp_path, run=numbers)


@pytest.mark.parametrize("damage", ["no rows", "row cut", "asked", "failed", "Latin-1"])
def test_a_damaged_sweep_gets_one_sentence(damage, tmp_path):
    bench_sweep.sweep(TREE, 10, tmp_path, run=numbers)
    file = tmp_path / "sweep.json"
    have = json.loads(file.read_text())
    first = next(iter(have["rows"].values()))
    match damage:
        case "no rows":
            del have["rows"]
        case "row cut":
            del first["frame_ms"]
        case "asked":
            del first["asked"]
        case "failed":
            have["failed"] = 3
    file.write_bytes(b"\xff" if damage == "Latin-1" else json.dumps(have).encode())
    with pytest.raises(UsageError, match="is damaged: delete it|is not a sweep"):
        bench_sweep.sweep(TREE, 10, tmp_path, run=numbers)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="lists of children are Linux's")
def test_a_row_ends_with_the_sweep(tmp_path):
    """A sweep that SIGTERM ended left a process that went on measuring."""
    code = "from app.measure.bench.sweep import *\nrun_apart(rows(Settings('tree'), 9000)[-1].spec())"
    sweep = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT)
    children, of_row = Path(f"/proc/{sweep.pid}/task/{sweep.pid}/children"), []
    while not of_row:
        assert sweep.poll() is None
        of_row = children.read_text().split()
        time.sleep(0.05)
    sweep.terminate()
    sweep.wait()
    for _ in range(200):
        if not any(Path(f"/proc/{pid}").exists() for pid in of_row):
            return
        time.sleep(0.05)
    os.kill(int(of_row[0]), signal.SIGKILL)
    pytest.fail("the row is still measured")


@pytest.mark.parametrize("bad", [["--sweep"], ["--out", "x"]])
def test_sweep_and_out_go_together(bad, capsys):
    assert cli.main(["bench", *bad]) == 2
    assert "--sweep and --out DIR go together" in capsys.readouterr().err


def test_the_command_writes_and_prints_the_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench_sweep.sweep, "__defaults__", (numbers,))
    assert cli.main(["bench", "tree", "--sweep", "--out", str(tmp_path / "new"), "--frames", "3"]) == 0
    text = capsys.readouterr().out
    assert text.strip() == (tmp_path / "new" / "sweep.md").read_text().strip()


def test_tables_hold_measurements_and_flag_differing_bits():
    every = {row.key: numbers(row.spec(), ms=20.0) for row in rows(TREE, 10)}
    every[bench_sweep.SLOW]["frame_ms"]["median"] = 24.0
    sweep = {"scene": "tree", "commit": "abc", "processor": "chip", "rows": every, "failed": {}}
    text = markdown(sweep)
    assert f"| {bench_sweep.SLOW} | 10,000 | 24 | 40 | 30 | 0.5 | 2.35 | 50 | 25 x | 400 | 900 |" in text
    assert "| 10000 photons, tangent_plane | 100 | 20 | 40 | 30 | 0.5 | 195.00 |" in text, "all else per cut photon"
    assert "| estimate | 1.5 |" in text and "| whole frame | 20 |" in text
    assert "same bits" in text
    every[bench_sweep.SLOW]["bits_equal"] = False
    assert f"differs from scratch in: {bench_sweep.SLOW}" in markdown(sweep)


def test_row_in_a_child_process_equals_a_row_in_process():
    spec = rows(Settings("cornell"), 3)[0].spec()
    spec["settings"].update(photons=500, estimator="impact_count")
    here, apart = measure_row(spec), run_apart(spec)
    same = ("triangles", "receivers", "photons", "radius", "control", "share_cut", "segments", "segments_changed")
    assert [here[k] for k in same] == [apart[k] for k in same] and apart["bits_equal"] and apart["control"] is False


def test_failed_child_process_reports_its_reason():
    spec = rows(Settings("nowhere.toml"), 3)[0].spec()
    with pytest.raises(UsageError, match="nowhere.toml"):
        run_apart(spec)

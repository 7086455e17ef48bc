"""Rows of the frame history, beside those of an earlier commit, and their plot."""

import csv
import subprocess
import sys
from pathlib import Path

import pytest

from app.cli.version import commit
from studies import frame_history
from studies.frame_history import ROOT, Case, Program, bench, checked_out, compare, draw, last_commit
from tests.support.cli_support import one_line

pytestmark = pytest.mark.slow
EARLIER = Program(Path("earlier"), {})


def numbers(ms: float) -> dict:
    times = {"frame_ms": {"median": ms, "cpu": 1.5 * ms}, "first_frame_ms": 9.0, "from_scratch_ms": 8.0}
    return times | {"threads": 2, "commit": "abc", "processor": "chip", "load": 0.5}


def test_the_history_has_a_row_per_case_and_run_beside_the_earlier_commit(tmp_path):
    """Sides alternate; the row and the ratio are those of the least times."""
    pytest.importorskip("matplotlib")
    file, order = tmp_path / "history.csv", []
    times = {EARLIER.root: iter([4.0, 3.0] * 2), ROOT: iter([7.0, 6.0] * 2)}

    def run(case, program):
        order.append(program.root)
        return numbers(next(times[program.root]))

    lines = list(compare(file, [Case("a", ""), Case("b", "")], EARLIER, run))
    assert lines == [f"{k}; 4, 3 -> 7, 6 ms; 6, 4.5 -> 10.5, 9 ms CPU; 2.00 x" for k in "ab"]
    assert order == 4 * [EARLIER.root, ROOT]
    assert list(compare(file, [Case("a", "")], None, lambda *_: numbers(5.0))) == ["a; 5, 5 ms; 7.5, 7.5 ms CPU"]
    with open(file, newline="") as text:
        rows = list(csv.DictReader(text))
    assert [(row["case"], row["frame_ms"]) for row in rows] == [("a", "6"), ("b", "6"), ("a", "5")]
    assert all(tuple(row) == frame_history.COLUMNS and row["date"].startswith("20") for row in rows)
    assert draw(file) == tmp_path / "history.svg" and "<svg" in (tmp_path / "history.svg").read_text()


def test_a_case_runs_in_a_process_of_the_program():
    n = bench(Case("small", "cornell --photons 500 --estimator impact_count --frames 3"), Program(ROOT, {}))
    assert n["frame_ms"]["median"] > 0 and n["frames"] == 3
    with pytest.raises(frame_history.UsageError, match="bad could not be measured in .*no such scene"):
        bench(Case("bad", "nowhere.toml"), Program(ROOT, {}))


def test_the_fixed_cases_are_twelve():
    cases = frame_history.cases()
    assert len({case.key for case in cases}) == len(cases) == 12
    assert {case.words.split()[0] for case in cases} == {"tree", "cornell", "living_room", "gallery"}


@pytest.mark.skipif(commit() is None, reason="needs the git repository")
def test_the_last_commit_of_the_history_is_checked_out(tmp_path):
    git = ["git", "-C", str(ROOT), "rev-list", "--max-count=2", "HEAD"]
    [here, *before] = subprocess.run(git, text=True, capture_output=True, check=True).stdout.split()
    if not before:
        pytest.skip("a clone of one commit")
    rows = [{"commit": c} for c in (before[0][:12], here[:12], f"{here[:12]}-dirty", "unknown")]
    assert last_commit(rows) == before[0] and last_commit(rows[1:]) is None
    with checked_out(before[0]) as program:
        assert (program.root / "app" / "__main__.py").exists()
    assert not program.root.exists()


def test_a_history_refuses_other_columns(tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    file = tmp_path / "other.csv"
    file.write_text("a,commit\n1,2\n")
    monkeypatch.setattr(sys, "argv", ["frame_history", "--out", str(file)])
    assert frame_history.main() == 2
    assert "has other columns" in one_line(capsys.readouterr().err)

"""Rows of the frame history, one per case and run, and their plot."""

from __future__ import annotations

import csv
import sys

import pytest

from app.measure.bench.row import measure_row
from app.measure.bench.rows import Row
from app.settings import Settings
from studies import frame_history
from tests.support.cli_support import one_line

pytestmark = pytest.mark.slow


def test_the_history_has_a_row_per_case_and_run_and_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    file = tmp_path / "history.csv"
    cheap = [Row(e, Settings("cornell", photons=500, estimator=e), 3, {}) for e in ("impact_count", "tangent_plane")]
    for cases in (cheap, cheap[:1]):
        assert frame_history.history(file, cases, measure_row) == tmp_path / "history.svg"
    with open(file, newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [row["case"] for row in rows] == ["impact_count", "tangent_plane", "impact_count"]
    for row in rows:
        assert tuple(row) == frame_history.COLUMNS and row["commit"] and row["processor"]
        assert row["date"].startswith("20")
        assert all(float(row[name]) > 0 for name in frame_history.COLUMNS if name.endswith("_ms"))
    assert "tangent_plane" in (tmp_path / "history.svg").read_text()


def test_the_fixed_cases_are_twelve():
    cases = frame_history.cases()
    assert len({row.key for row in cases}) == len(cases) == 12
    assert {row.settings.scene for row in cases} == {"tree", "cornell", "living_room", "gallery"}


def test_a_history_refuses_other_columns(tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    file = tmp_path / "other.csv"
    file.write_text("a,b\n1,2\n")
    monkeypatch.setattr(sys, "argv", ["frame_history", "--out", str(file)])
    assert frame_history.main() == 2
    assert "has other columns" in one_line(capsys.readouterr().err)

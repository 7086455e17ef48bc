"""Measurements of the report of 2003 in its tree scene, and the settings here that are most like them.

The report's errors are mean differences of luminance from a picture by tangent_plane at very many photons. The noise
in table 2.8 is from photon_map's own picture of 5 million photons. The report gives no k of its photon maps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from app.measure.chart.settings import Choice

if TYPE_CHECKING:
    from gi_core.solver import Solver

SCENES = ("tree", "tree_worst")  # like the report's
RADIUS = 0.01  # of the scene size


class ReportRow(NamedTuple):
    """A row of the report: seconds per frame for tracing and estimating, relative errors, None if not given."""

    table: str
    estimator: str
    photons: int
    seconds: float
    noise: float | None
    bias: float | None
    total: float | None


REPORT = (
    ReportRow("2.1", "tangent_plane", 50_000, 0.85, 0.1610, None, None),
    ReportRow("2.1", "impact_count", 1_000_000, 1.11, None, None, 1.3954),
    ReportRow("2.6", "tangent_plane", 1_000, 0.11, 0.2464, 0.14403, 0.286912),
    ReportRow("2.7", "tangent_plane", 10_000, 0.485, 0.0857, 0.1440, 0.1682),
    ReportRow("2.8", "photon_map", 10_000, 0.20, 1.725, 0.6280, 0.5439),
    ReportRow("2.8", "photon_map", 50_000, 0.47, 0.932, 0.6280, 0.6246),
    ReportRow("2.8", "photon_map", 200_000, 2.29, 0.622, 0.6280, 0.6572),
)


def choice_like(then: ReportRow, scene_size: float, neighbours: int) -> Choice:
    """Return the setting like a row of the report: discs of 1 % of the scene, no corrections."""
    radius = float(f"{RADIUS * scene_size:.3g}")
    like = Choice(then.estimator, then.photons, then.photons, radius, neighbours, False, "photons")
    return like._replace(border_correction=False, textbook=True) if then.estimator == "photon_map" else like


def choices_like_the_report(scene: str, solver: Solver) -> list[Choice]:
    """Return the settings like the report's rows, none for scenes other than its tree."""
    if scene not in SCENES:
        return []
    return [choice_like(then, solver.scene_size, solver.setting.neighbours) for then in REPORT]


def beside(rows: list[dict], scene_size: float) -> list[tuple[ReportRow, dict | None]]:
    """Return each row of the report with the measured row of the same setting, None if there is none."""

    def same(r: dict, like: Choice) -> bool:
        names = [name for name in Choice._fields if name not in ("radius", "neighbours")]
        return abs(r["radius"] - like.radius) <= 1e-3 * like.radius and all(r[n] == getattr(like, n) for n in names)

    likes = [(then, choice_like(then, scene_size, 0)) for then in REPORT]
    return [(then, next((r for r in rows if same(r, like)), None)) for then, like in likes]

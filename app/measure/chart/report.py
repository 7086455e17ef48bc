"""What the report of 2003 measured in its tree scene, row by row, and the settings that come nearest to it here.

Its errors are mean differences of luminance between pictures. In tables 2.1, 2.6 and 2.7 they are taken against
tangent_plane at very many photons, in 2.8 noise against photon_map's own picture of 5 million and total against
tangent_plane's; none against an unbiased answer. The k of its photon maps is not told.
"""

from __future__ import annotations

from typing import NamedTuple

from app.measure.chart.settings import Choice

SCENES = ("tree", "tree_worst")  # ours that are like the report's
RADIUS = 0.01  # of the scene size


class Told(NamedTuple):
    """A row of the report; seconds a frame, tracing and estimating; errors relative, None where there is none."""

    table: str
    estimator: str
    photons: int
    seconds: float
    noise: float | None
    bias: float | None
    total: float | None


REPORT = (
    Told("2.1", "tangent_plane", 50_000, 0.85, 0.1610, None, None),
    Told("2.1", "impact_count", 1_000_000, 1.11, None, None, 1.3954),
    Told("2.6", "tangent_plane", 1_000, 0.11, 0.2464, 0.14403, 0.286912),
    Told("2.7", "tangent_plane", 10_000, 0.485, 0.0857, 0.1440, 0.1682),
    Told("2.8", "photon_map", 10_000, 0.20, 1.725, 0.6280, 0.5439),
    Told("2.8", "photon_map", 50_000, 0.47, 0.932, 0.6280, 0.6246),
    Told("2.8", "photon_map", 200_000, 2.29, 0.622, 0.6280, 0.6572),
)


def choice_like(told: Told, scene_size: float, neighbours: int) -> Choice:
    """Return the setting that is like a row of the report: discs of 1 % of the scene, nothing corrected."""
    radius = float(f"{RADIUS * scene_size:.3g}")
    like = Choice(told.estimator, told.photons, told.photons, radius, neighbours, False, "photons")
    return like._replace(border_correction=False, textbook=True) if told.estimator == "photon_map" else like


def choices_like_the_report(scene: str, solver) -> list[Choice]:
    """Return the settings that redo the report's rows, none for other scenes than its tree."""
    if scene not in SCENES:
        return []
    return [choice_like(told, solver.scene_size, solver.neighbours) for told in REPORT]


def beside(rows: list[dict], scene_size: float) -> list[tuple[Told, dict | None]]:
    """Return each row of the report with the measured one that is like it, None where there is none."""

    def same(r: dict, like: Choice) -> bool:
        names = [name for name in Choice._fields if name not in ("radius", "neighbours")]
        return abs(r["radius"] - like.radius) <= 1e-3 * like.radius and all(r[n] == getattr(like, n) for n in names)

    likes = [(told, choice_like(told, scene_size, 0)) for told in REPORT]
    return [(told, next((r for r in rows if same(r, like)), None)) for told, like in likes]

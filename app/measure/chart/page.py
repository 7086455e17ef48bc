"""`gi-viewer chart SCENE --out DIR`: error against frame time of many settings, as a table, a chart and a page.

The page is one file: the chart, and the report's tables beside ours. `results.csv` has every number.
"""

from __future__ import annotations

import math
from html import escape
from pathlib import Path

from app.cli.progress import opened
from app.cli.version import need
from app.cli.writable import write_whole
from app.measure.chart.figure import draw
from app.measure.chart.measure import Run
from app.measure.chart.settings import SCENES, ReportRow, beside
from app.measure.results import Failure
from app.measure.tables import document, html_table
from app.settings import Settings, open_moving_scene


def chart(
    settings: Settings, out: Path, quick: bool = False, frames: int | None = None, points: int | None = None,
) -> tuple[str, list[Failure]]:  # fmt: skip
    """Measure all settings, write `out`/results.csv, draw them; return a summary with the files.

    Settings that could not be measured are returned beside it; the others are drawn without them.

    Raises SceneError, UsageError (a scene without mobiles, no matplotlib), OSError.
    """
    need("matplotlib", "draws the chart")
    out.mkdir(parents=True, exist_ok=True)
    with opened(settings, open_moving_scene) as (bar, scene):
        run = Run(scene, settings, quick, frames, points, out, bar)
        try:
            run.measure()
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"stopped; {len(run.rows)} settings are in {run.file}") from None
        bar("drawing", 0.0)
        rows, about = run.rows, run.about()
        draw(rows, about, out)
        write_page(rows, about, out)
    soon = [r for r in rows if r["frame_ms"] <= SOON_ENOUGH]
    said = f"{len(rows)} settings"
    if soon:
        least = min(soon, key=lambda r: r["total all"])
        said += f"; within {SOON_ENOUGH:g} ms the least error is {100 * least['total all']:.1f} %, of {least['curve']}"
    files = (str((out / name).resolve()) for name in ("index.html", "chart.svg", "results.csv"))
    return "\n".join([said, *files]), run.failures


SOON_ENOUGH = 40.0  # ms: longest frame of the settings in the summary


def write_page(rows: list[dict], about: dict, out: Path) -> None:
    """Write index.html, whole or not at all. Raises OSError."""
    svg = (out / "chart.svg").read_text(encoding="utf-8")
    parts = [
        f"<p>{escape(_summary(rows, about))}</p>",
        f"<div class='wide'>{svg[svg.index('<svg') :]}</div>",
        *_report(rows, about),
        f"<p>{escape(notes(about))}</p>",
    ]
    write_whole(out / "index.html", document(f"{about['scene']}: speed against accuracy", parts))


def _summary(rows: list[dict], about: dict) -> str:
    lamps = f", lamps at {about['lamps']}" if about["lamps"] else ""
    return (
        f"{len(rows)} settings, {about['frames']} frames each, mobiles move 1.5 % of the scene per frame; "
        f"{about['triangles']:,} triangles, {about['receivers']:,} receivers; {about['processor']}, "
        f"{about['threads']} threads, commit {about['commit']}, seed {about['seed']}{lamps}."
    )


def notes(about: dict) -> str:
    """Return the meaning of the numbers."""
    return (
        f"A GI frame is everything from new poses to irradiance. Errors are relative, at {about['asked_points']:,} "
        f"receivers per pose ({about['poses']} poses), drawn by area in each class. The truth is unbiased path tracing "
        f"with a noise of {about['truth']:.0%}. Noise is the difference from the same estimator at {about['limit']:,} "
        "other photons. Bias is the difference of those from the truth and includes the noise of both. The rival's "
        "times over 4 paths are scaled from 4."
    )


REPORT_HEAD = (
    "table", "estimator", "photons", "frame, 2003", "frame now", "times faster",
    "noise, 2003", "noise now", "bias, 2003", "bias now", "total, 2003", "total now",
)  # fmt: skip
REPORT_NOTE = (
    "Discs of 1 % of the scene, no artifact control. The report's errors are differences from pictures of "
    "tangent_plane with 5 or 100 million photons (noise of photon_map: from its own). Ours are differences of "
    "irradiance from the truth, so only times compare directly. The report gives no k of its photon maps."
)


def _report(rows: list[dict], about: dict) -> list[str]:
    """Return the report's tables 2.1, 2.6, 2.7 and 2.8 redone."""
    if about["scene"] not in SCENES:
        return []
    table = html_table(REPORT_HEAD, [_line(row, now or {}) for row, now in beside(rows, about["scene_size"])])
    return ["<h2>The report's tables, redone</h2>", table, f"<p>{REPORT_NOTE}</p>"]


def _line(row: ReportRow, now: dict) -> list[str]:
    """Return a row of the report beside the measured row of the same setting, {}: there is none."""
    of_2003, ms = 1e3 * row.seconds, now.get("frame_ms")
    times = ["", ""] if ms is None else [f"{ms:,.1f} ms", f"{of_2003 / ms:,.0f}"]
    errors = [_percent(e) for n in ("noise", "bias", "total") for e in (getattr(row, n), now.get(f"{n} all"))]
    return [row.table, row.estimator, f"{row.photons:,}", f"{of_2003:,.0f} ms", *times, *errors]


def _percent(error: float | None) -> str:
    return "" if error is None or not math.isfinite(error) else f"{100 * error:.1f} %"

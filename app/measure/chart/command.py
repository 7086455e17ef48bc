"""`gi-viewer chart SCENE --out DIR`: error against frame time of many settings, as a table, a chart and a page."""

from __future__ import annotations

from pathlib import Path

from app.cli.cluster import Machines
from app.cli.progress import opened
from app.measure.chart.figure import draw, need_matplotlib
from app.measure.chart.page import SOON_ENOUGH, write_page
from app.measure.chart.run import Run
from app.measure.chart.settings import tuned_summary
from app.measure.results import Failure
from app.settings import Settings, open_moving_scene


def chart(
    settings: Settings, out: Path, quick: bool = False, frames: int | None = None, points: int | None = None,
    machines: Machines | None = None,
) -> tuple[str, list[Failure]]:  # fmt: skip
    """Measure the settings missing in `out`/results.csv, draw all of them; return a summary with the files.

    Settings that could not be measured are returned beside it; the others are drawn without them. machines: measure
    the settings in their processes.

    Raises SceneError, UsageError (a scene without mobiles, no matplotlib), OSError.
    """
    need_matplotlib()
    out.mkdir(parents=True, exist_ok=True)
    with opened(settings, open_moving_scene) as (bar, scene):
        run = Run(scene, settings, quick, frames, points, out, bar, machines)
        try:
            run.measure()
        except KeyboardInterrupt:
            kept = f"stopped; {len(run.results.rows)} settings are in {run.results.file}"
            raise KeyboardInterrupt(f"{kept}: the same command goes on from there") from None
        bar("drawing", 0.0)
        rows, about = run.results.rows, run.about()
        draw(rows, about, out)
        write_page(run, rows, about, out)
    soon = [r for r in rows if r["frame_ms"] <= SOON_ENOUGH]
    said = f"{len(rows)} settings"
    if soon:
        least = min(soon, key=lambda r: r["total all"])
        said += f"; within {SOON_ENOUGH:g} ms the least error is {100 * least['total all']:.1f} %, of {least['curve']}"
    near = [words] if (words := tuned_summary(rows)) else []
    files = (str((out / name).resolve()) for name in ("index.html", "chart.svg", "results.csv"))
    return "\n".join([said, *near, *files]), run.failures

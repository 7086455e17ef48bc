"""`gi-viewer chart SCENE --out DIR`: error against frame time of many settings, as a table, a chart and a page.

The page is one file: chart, pictures, the report's tables beside ours and every number.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from html import escape
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.cli.progress import opened
from app.cli.writable import write_whole
from app.draw.colour_map import signed_colours
from app.draw.false_colour import Display
from app.draw.shot import Shot, picture
from app.draw.tonemap import srgb_decode
from app.measure.chart.figure import draw, need_matplotlib
from app.measure.chart.measure import Run
from app.measure.chart.settings import RIVAL, SCENES, Choice, beside
from app.measure.results import Failure
from app.measure.tables import Column, cells, document, fixed, html_table, image, milliseconds, percent
from app.rest.reference_store import ReferenceStore
from app.settings import Settings, open_moving_scene
from gi_core.estimators import ESTIMATORS
from gi_core.geometry.error import relative_error, signed_error


def chart(
    settings: Settings, out: Path, quick: bool = False, frames: int | None = None, points: int | None = None,
) -> tuple[str, list[Failure]]:  # fmt: skip
    """Measure the settings missing in `out`/results.csv, draw all of them; return a summary with the files.

    Settings that could not be measured are returned beside it; the others are drawn without them.

    Raises SceneError, UsageError (a scene without mobiles, no matplotlib), OSError.
    """
    need_matplotlib()
    out.mkdir(parents=True, exist_ok=True)
    with opened(settings, open_moving_scene) as (bar, scene):
        run = Run(scene, settings, quick, frames, points, out, bar)
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
    files = (str((out / name).resolve()) for name in ("index.html", "chart.svg", "results.csv"))
    return "\n".join([said, *files]), run.failures


ALL_COLUMNS = ("noise", "bias", "total", "total l2")
GLOSS_NOTE = (
    " Gloss is the radiance towards the camera at vertices that keep directions of light, in 64 cells each. At grazing "
    "angles a lobe is narrower than a cell: its error stays there with more photons, and at rest."
)


def write_page(run: Run, rows: list[dict], about: dict, out: Path) -> None:
    """Write index.html, whole or not at all. Raises OSError."""
    parts = [
        f"<p>{escape(_summary(rows, about))}</p>",
        _inline((out / "chart.svg").read_text(encoding="utf-8")),
        "<h2>The best of each estimator</h2>",
        f"<p>The least error of all receivers within {SOON_ENOUGH:g} ms per frame. Maps: blue too dark, "
        f"red too bright, full colour at a relative error of {SCALE:.0%}.</p>",
        _pictures(pictures(run, rows)),
        *_report(rows, about),
        "<h2>Every setting</h2>",
        _everything(rows),
        f"<p>{escape(notes(about, has_gloss(rows)))}</p>",
    ]
    write_whole(out / "index.html", document(f"{about['scene']}: speed against accuracy", parts))


def has_gloss(rows: list[dict]) -> bool:
    """Return whether some setting has an error of gloss."""
    return any(Column("", lambda r: r.get("total gloss")).cell(r) for r in rows)


def _summary(rows: list[dict], about: dict) -> str:
    lamps = f", lamps at {about['lamps']}" if about["lamps"] else ""
    return (
        f"{len(rows)} settings, {about['frames']} frames each, mobiles move 1.5 % of the scene per frame; "
        f"{about['triangles']:,} triangles, {about['receivers']:,} receivers; {about['processor']}, "
        f"{about['threads']} threads, commit {about['commit']}, seed {about['seed']}{lamps}."
    )


def notes(about: dict, gloss: bool) -> str:
    """Return the meaning of the columns; gloss: whether there is one of gloss."""
    return (
        f"A GI frame is everything from new poses to irradiance. Errors are relative, at {about['asked_points']:,} "
        f"receivers per pose ({about['poses']} poses), drawn by area in each class. The truth is unbiased path tracing "
        f"with a noise of {about['truth']:.0%}. Noise is the difference from the same estimator at {about['limit']:,} "
        "other photons. Bias is the difference of those from the truth and includes the noise of both. Clouds are the "
        "standard deviation of light / truth within a tenth of the scene, median and 90th percentile. Flicker is the "
        "variation over frames at receivers that no frame changes by a thousandth of the mean. Jump is the change per "
        f"frame at receivers that the mobile changes, relative to the change with {about['limit']:,} photons; 1 is "
        "exact, more is flicker. First frame: scene prepared, photons traced and estimated. The rival's times over 4 "
        "paths are scaled from 4."
    ) + (GLOSS_NOTE if gloss else "")


def _inline(svg: str) -> str:
    return f"<div class='wide'>{svg[svg.index('<svg') :]}</div>"


def _pictures(drawn) -> str:
    out = []
    for p in drawn:
        shown = [(p.image, f"picture: {p.title}"), (p.error_map, f"map of errors: {p.title}")]
        images = "".join(image(picture, text) for picture, text in shown if picture is not None)
        out.append(f"<figure>{images}<figcaption><b>{escape(p.title)}</b>: {escape(p.text)}</figcaption></figure>")
    return f"<div class='row'>{''.join(out)}</div>"


REPORT_COLUMNS = (  # of a row of the report, and the measured row of the same setting or {}
    Column("table", lambda p: p[0].table),
    Column("estimator", lambda p: p[0].estimator),
    Column("photons", lambda p: p[0].photons, "{:,}".format),
    Column("frame, 2003", lambda p: 1e3 * p[0].seconds, "{:,.0f} ms".format),
    Column("frame now", lambda p: p[1].get("frame_ms"), milliseconds),
    Column("times faster", lambda p: 1e3 * p[0].seconds / p[1]["frame_ms"] if p[1] else None, "{:,.0f}".format),
    Column("noise, 2003", lambda p: p[0].noise, percent),
    Column("noise now", lambda p: p[1].get("noise all"), percent),
    Column("bias, 2003", lambda p: p[0].bias, percent),
    Column("bias now", lambda p: p[1].get("bias all"), percent),
    Column("total, 2003", lambda p: p[0].total, percent),
    Column("total now", lambda p: p[1].get("total all"), percent),
)
REPORT_NOTE = (
    "Discs of 1 % of the scene, no artifact control. The report's errors are differences from pictures of "
    "tangent_plane with 5 or 100 million photons (noise of photon_map: from its own). Ours are differences of "
    "irradiance from the truth, so only times compare directly. The report gives no k of its photon maps."
)


def _report(rows: list[dict], about: dict) -> list[str]:
    """Return the report's tables 2.1, 2.6, 2.7 and 2.8 redone."""
    if about["scene"] not in SCENES:
        return []
    pairs = [(row, now or {}) for row, now in beside(rows, about["scene_size"])]
    table = html_table(*cells(REPORT_COLUMNS, pairs))
    return ["<h2>The report's tables, redone</h2>", table, f"<p>{REPORT_NOTE}</p>"]


def _named(row: dict) -> str:
    words = f"{row['photons']} paths per vertex" if row["curve"] == RIVAL else Choice.of(row).summary()
    return f"{row['curve']}: {words}"


def _error(head: str, name: str) -> Column:
    return Column(head, lambda r: r.get(name), percent)


def _everything(rows: list[dict]) -> str:
    kinds = {"affected": "changed", "mobile": "mobile", "border": "borders"}
    kinds |= {"gloss": "gloss"} if has_gloss(rows) else {}
    columns = (
        Column("setting", _named),
        Column("median", lambda r: r["frame_ms"], milliseconds),
        Column("95 %", lambda r: r["frame_p95_ms"], milliseconds),
        Column("first", lambda r: 1e-3 * r["first_frame_ms"], "{:.2f} s".format),
        *(_error(name, f"{name} all") for name in ALL_COLUMNS),
        *(_error(head, f"total {name}") for name, head in kinds.items()),
        _error("median", "clouds"),
        _error("90 %", "clouds 90"),
        Column("flicker", lambda r: r["flicker"], partial(percent, places=2)),
        Column("jump", lambda r: r["jump"], fixed),
    )
    over = [
        ("", 1),
        ("GI frame", 3),
        ("error, all receivers", 4),
        ("total error", len(kinds)),
        ("clouds", 2),
        ("over frames", 2),
    ]
    ordered = sorted(rows, key=lambda r: (r["curve"], r["radius"], r["neighbours"], r["photons"]))
    return html_table(*cells(columns, ordered), over)


SHOT_SIZE = (480, 320)  # pixels
SOON_ENOUGH = 40.0  # ms: longest frame among the best settings
SCALE = 0.5  # relative error at the ends of the colour scale


class PagePicture(NamedTuple):
    """A picture and its caption."""

    title: str
    text: str
    image: np.ndarray  # (h, w, 3) uint8
    error_map: np.ndarray | None


def best_rows(rows: list[dict]) -> list[dict]:
    """Return per estimator the row of least error within SOON_ENOUGH, else its fastest row."""
    out = []
    for estimator in ESTIMATORS:
        own = [r for r in rows if r["estimator"] == estimator]
        soon = [r for r in own if r["frame_ms"] <= SOON_ENOUGH]
        if own:
            out.append(min(soon, key=lambda r: r["total all"]) if soon else min(own, key=lambda r: r["frame_ms"]))
    return out


def pictures(run: Run, rows: list[dict]) -> list[PagePicture]:
    """Return the truth and the best row of each estimator, at the first pose where errors were measured."""
    poses = run.lap[run.truth_frames[0]]
    solver = run.measurer.base.twin()
    solver.move_all(poses)
    store = ReferenceStore(solver.model, solver.poses, seed=run.settings.seed, levels=solver.levels)
    for reached in store.gather(run.effort.picture_truth):
        run.bar("truth of the pictures", reached.fraction)
    truth, areas = reached.state.mean, store.weights
    solver.frame = solver.frame._replace(irradiance=truth)
    shot = Shot(solver, replace(run.settings, size=SHOT_SIZE))
    out = [PagePicture("truth", f"unbiased path tracing, noise {100 * reached.noise:.1f} %", shot.take(), None)]
    settings = replace(run.settings, size=SHOT_SIZE, exposure=shot.exposure)
    for row in best_rows(rows):
        run.bar(f"picture of {row['estimator']}", 0.0)
        choice = Choice.of(row)
        solver, _ = run.measurer.solved(choice)
        solver.move_all(poses, *choice.frame)
        shot = Shot(solver, settings)
        error = signed_error(solver.irradiance, truth, areas)
        total = relative_error(solver.irradiance, truth, areas)
        text = f"{choice.summary()}: {row['frame_ms']:.3g} ms per frame; error {100 * total.l1:.1f} % here"
        out.append(PagePicture(choice.curve, text, shot.take(), _map(shot, error)))
    return out


def _map(shot: Shot, error: np.ndarray) -> np.ndarray:
    """Return an error map (h, w, 3) uint8 of relative errors (R,): blue too dark, red too bright."""
    lit, linear = replace(shot.lit, shows_radiance=False), srgb_decode(signed_colours(np.nan_to_num(error) / SCALE))
    colours = [(linear[m.front], linear[np.maximum(m.back, 0)]) for m in lit.meshes]
    return picture(lit, shot.view, Display(0.0, "clip"), colours)

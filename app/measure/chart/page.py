"""index.html: chart, pictures, the report's tables beside ours and every number, in one file."""

from __future__ import annotations

import math
from collections import Counter
from html import escape
from pathlib import Path

from app.cli.writable import write_whole
from app.measure.chart import pictures
from app.measure.chart.report import SCENES, beside
from app.measure.chart.rival import RIVAL
from app.measure.chart.run import Run
from app.measure.chart.settings import Choice
from app.measure.chart.tuned import summary as tuned_summary
from app.measure.html_page import document, image, table

ALL_COLUMNS = ("noise", "bias", "total", "total l2")
GLOSS_NOTE = (
    " Gloss is the radiance towards the camera at vertices that keep directions of light, in 64 cells each. At grazing "
    "angles a lobe is narrower than a cell: its error stays there with more photons, and at rest."
)


def write_page(run: Run, rows: list[dict], about: dict, out: Path) -> None:
    """Write index.html, whole or not at all. Raises OSError."""
    parts = [
        f"<p>{escape(_summary(rows, about))}</p>",
        *(f"<p>{escape(words[0].upper() + words[1:])}.</p>" for words in [tuned_summary(rows)] if words),
        _inline((out / "chart.svg").read_text(encoding="utf-8")),
        "<h2>The best of each estimator</h2>",
        f"<p>The least error of all receivers within {pictures.SOON_ENOUGH:g} ms per frame. Maps: blue too dark, "
        f"red too bright, full colour at a relative error of {pictures.SCALE:.0%}.</p>",
        _pictures(pictures.pictures(run, rows)),
        *_report(rows, about),
        "<h2>Every setting</h2>",
        _everything(rows),
        f"<p>{escape(notes(about, has_gloss(rows)))}</p>",
    ]
    write_whole(out / "index.html", document(f"{about['scene']}: speed against accuracy", parts))


def has_gloss(rows: list[dict]) -> bool:
    """Return whether some setting has an error of gloss."""
    return any(_there(r.get("total gloss")) for r in rows)


def _summary(rows: list[dict], about: dict) -> str:
    lamps = f", lamps at {about['lamps']}" if about["lamps"] else ""
    return (
        f"{len(rows)} settings, {about['frames']} frames each, mobiles move 1.5 % of the scene per frame; "
        f"{about['triangles']:,} triangles, {about['receivers']:,} receivers; {about['processor']}, "
        f"{_processes(rows, about)}, commit {about['commit']}, seed {about['seed']}{lamps}."
    )


def _processes(rows: list[dict], about: dict) -> str:
    """Return the processes that have timed the frames, in words."""
    timed = Counter((r["process"], r["threads"]) for r in rows if r.get("process"))
    if len(timed) < 2:
        return f"{about['threads']} threads"
    each = ", ".join(f"{name} ({threads} threads) {n} settings" for (name, threads), n in sorted(timed.items()))
    return f"timed by {len(timed)} processes: {each}"


def notes(about: dict, gloss: bool) -> str:
    """Return the meaning of the columns; gloss: whether there is one of gloss."""
    return (
        f"A GI frame is everything from new poses to irradiance. Errors are relative, at {about['asked_points']:,} "
        f"receivers per pose ({about['poses']} poses), drawn by area in each class. The truth is unbiased path tracing "
        f"with a noise of {about['truth']:.0%}. Noise is the difference from the same estimator at {about['limit']:,} "
        "other photons. Bias is the difference of those from the truth and includes the noise of both. Flicker is the "
        "variation over frames at receivers that no frame changes by a thousandth of the mean. Jump is the change per "
        f"frame at receivers that the mobile changes, relative to the change with {about['limit']:,} photons; 1 is "
        "exact, more is flicker. First frame: scene prepared, photons traced and estimated. The rival's times over 4 "
        "paths are scaled from 4."
    ) + (GLOSS_NOTE if gloss else "")


def _inline(svg: str) -> str:
    return f"<div class='wide'>{svg[svg.index('<svg') :]}</div>"


def _pictures(found) -> str:
    out = []
    for p in found:
        shown = [(p.image, f"picture: {p.title}"), (p.error_map, f"map of errors: {p.title}")]
        images = "".join(image(picture, text) for picture, text in shown if picture is not None)
        out.append(f"<figure>{images}<figcaption><b>{escape(p.title)}</b>: {escape(p.text)}</figcaption></figure>")
    return f"<div class='row'>{''.join(out)}</div>"


def _report(rows: list[dict], about: dict) -> list[str]:
    """Return the report's tables 2.1, 2.6, 2.7 and 2.8 redone."""
    if about["scene"] not in SCENES:
        return []
    head = ["table", "estimator", "photons", "frame, 2003", "frame now", "times faster", "noise, 2003", "noise now",
            "bias, 2003", "bias now", "total, 2003", "total now"]  # fmt: skip
    lines = []
    for then, now in beside(rows, about["scene_size"]):
        ms = now and now["frame_ms"]
        lines.append([
            then.table, then.estimator, f"{then.photons:,}", f"{1e3 * then.seconds:,.0f} ms", _ms(ms),
            f"{1e3 * then.seconds / ms:,.0f}" if ms else "", _percent(then.noise), _percent(now and now["noise all"]),
            _percent(then.bias), _percent(now and now["bias all"]), _percent(then.total),
            _percent(now and now["total all"]),
        ])  # fmt: skip
    note = (
        "Discs of 1 % of the scene, no artifact control. The report's errors are differences from pictures of "
        "tangent_plane with 5 or 100 million photons (noise of photon_map: from its own). Ours are differences of "
        "irradiance from the truth, so only times compare directly. The report gives no k of its photon maps."
    )
    return ["<h2>The report's tables, redone</h2>", table(head, lines), f"<p>{note}</p>"]


def _everything(rows: list[dict]) -> str:
    kinds = {"affected": "changed", "mobile": "mobile", "border": "borders"}
    kinds |= {"gloss": "gloss"} if has_gloss(rows) else {}
    over = [("", 1), ("GI frame", 3), ("error, all receivers", 4), ("total error", len(kinds)), ("over frames", 2)]
    head = ["setting", "median", "95 %", "first", *ALL_COLUMNS, *kinds.values(), "flicker", "jump"]
    lines = []
    for r in sorted(rows, key=lambda r: (r["curve"], r["radius"], r["neighbours"], r["photons"])):
        words = f"{r['photons']} paths per vertex" if r["curve"] == RIVAL else Choice.of(r).summary()
        lines.append([
            f"{r['curve']}: {words}", _ms(r["frame_ms"]), _ms(r["frame_p95_ms"]), f"{1e-3 * r['first_frame_ms']:.2f} s",
            *(_percent(r[f"{name} all"]) for name in ALL_COLUMNS),
            *(_percent(r.get(f"total {name}")) for name in kinds),
            _percent(r["flicker"], 2), _number(r["jump"]),
        ])  # fmt: skip
    return table(head, lines, over)


def _there(value) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _percent(value, digits: int = 1) -> str:
    return f"{100 * value:.{digits}f} %" if _there(value) else ""


def _ms(value) -> str:
    return f"{value:.3g} ms" if _there(value) and value < 1000 else f"{value:,.0f} ms" if _there(value) else ""


def _number(value) -> str:
    return f"{value:.2f}" if _there(value) else ""

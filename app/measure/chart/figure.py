"""The chart: error against frame time on logarithmic axes, one panel per class of receivers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from app.measure.chart.settings import DRAGGED, GATHERED, NO_CONTROL, REPORT, RESTED, RIVAL, SCENES
from gi_core.estimators import ESTIMATORS

PANELS = {
    "all": "All receivers",
    "untouched": "Untouched by the mobile",
    "affected": "Changed by the mobile",
    "mobile": "On the mobile",
    "border": "At borders and corners",
}
# Okabe and Ito's colours, which the colour-blind distinguish; markers repeat the distinction.
OWN = (("#0072B2", "o"), ("#CC79A7", "D"), ("#D55E00", "^"), ("#B59F00", "<"), ("#8C510A", ">"))  # per estimator
VARIANTS = {
    DRAGGED: ("#56B4E9", "s"), GATHERED: ("#7A5195", "P"), RESTED: ("#1B1B6B", "h"), NO_CONTROL: ("#009E73", "v"),
}  # fmt: skip
OTHERS = {RIVAL: ("#555555", "X")}
RATES = {1000 / 60: "16.7 ms", 40.0: "40 ms"}
NOTE = {
    "of": "error: sum of area x |E - truth| / sum of area x truth, luminance,\nat {points:,} receivers per pose, "
    "{poses}; truth: unbiased path tracing,\nnoise {truth:.0%}",
    "on": "{processor}, {threads} threads\n{triangles:,} triangles, {receivers:,} receivers, seed {seed}\n"
    "commit {commit}",
    "report": "Hollow: the report's tables 2.1, 2.6 to 2.8, a machine of 2003. Their error is\nthe difference from a "
    "picture by tangent_plane, not from the truth.",
}
INK, FAINT, BEST = "#222222", "#DDDDDD", "#E6C200"


def styles() -> dict[str, tuple[str, str]]:
    """Return colour and shape of every curve, in the order of the legend."""
    out = {}
    for k, name in enumerate(ESTIMATORS):
        out[name] = OWN[k % len(OWN)]
        out |= {name + variant: style for variant, style in VARIANTS.items() if ESTIMATORS[name].controlled}
    return out | OTHERS


def draw(rows: list[dict], about: dict, out: Path) -> None:
    """Write chart.svg and chart.png. Raises OSError."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    look = {"font.size": 11, "axes.titlesize": 12, "axes.titleweight": "bold", "axes.titlelocation": "left",
            "axes.edgecolor": INK, "text.color": INK, "svg.hashsalt": "gi-viewer"}  # fmt: skip
    with matplotlib.rc_context(look):
        figure, axes = pyplot.subplots(2, 3, figsize=(15, 9.4), layout="constrained")
        figure.suptitle(f"{about['scene']}: error against frame time", x=0.012, ha="left", size=17, weight="bold")
        span = _span(rows)
        for axis, (name, title) in zip(axes.flat, PANELS.items(), strict=False):
            _panel(axis, rows, name, title, span, about)
        _legend(axes.flat[-1], rows, about)
        figure.savefig(out / "chart.svg", metadata={"Date": None})
        figure.savefig(out / "chart.png", dpi=110)
        pyplot.close(figure)


def aside(curves: Iterable[str]) -> set[str]:
    """Return the curves that the Pareto front leaves out: no frame of a motion is like them."""
    return {c for c in curves if c == RIVAL or c.endswith(RESTED)}


def front(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the Pareto front: points that no other beats in both time and error, by time."""
    out: list[tuple[float, float]] = []
    for x, y in sorted(points):
        if not out or y < out[-1][1]:
            out.append((x, y))
    return out


def _panel(axis, rows: list[dict], name: str, title: str, span: tuple[float, float], about: dict) -> None:
    points = {curve: _points(rows, curve, name) for curve in styles()}
    every = [p for curve, own in points.items() if curve not in aside(points) for p in own]
    best = front(every)
    if best:
        axis.plot(*_columns(best), color=BEST, linewidth=8, alpha=0.45, solid_capstyle="round", zorder=1)
    for curve, own in points.items():
        colour, shape = styles()[curve]
        if own:
            axis.plot(*_columns(own), shape, color=colour, markersize=4.5, alpha=0.35, markeredgewidth=0, zorder=2)
            axis.plot(*_columns(front(own)), "-" + shape, color=colour, linewidth=1.8, markersize=6, zorder=3)
    report = about["scene"] in SCENES and name == "all"
    if report:
        for row in REPORT:
            y = row.total if row.total is not None else row.noise
            axis.plot(1e3 * row.seconds, 100 * y, styles()[row.estimator][1], color=styles()[row.estimator][0],
                      markerfacecolor="none", markersize=8, markeredgewidth=1.4, zorder=4)  # fmt: skip
    axis.set(xscale="log", yscale="log", xlim=span, title=title)
    axis.set_xlabel("GI frame, median [ms]")
    axis.set_ylabel("error [% of the light]")
    _ticks(axis)
    for ms, label in RATES.items():
        axis.axvline(ms, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
        axis.text(ms, 0.99, label, transform=axis.get_xaxis_transform(), ha="right", va="top", size=9, rotation=90)
    shown = [y for own in points.values() for _, y in own]
    if shown:
        axis.set_ylim(min(shown) / 1.35, max(shown) * 1.25)


def _legend(axis, rows: list[dict], about: dict) -> None:
    """Draw the legend and the conditions into the last panel."""
    axis.axis("off")
    curves = [curve for curve in styles() if any(r["curve"] == curve for r in rows)]
    y = 0.97
    for curve in curves:
        colour, shape = styles()[curve]
        axis.plot([0.02, 0.10], [y, y], "-" + shape, color=colour, linewidth=2, markersize=7, transform=axis.transAxes)
        name = curve + (", no state between frames" if curve == RIVAL else "")
        axis.text(0.14, y, name, color=colour, weight="bold", va="center", transform=axis.transAxes)
        y -= 0.075
    axis.plot([0.02, 0.10], [y, y], color=BEST, linewidth=8, alpha=0.45, transform=axis.transAxes)
    axis.text(0.14, y, "no setting is both faster and more accurate", va="center", transform=axis.transAxes)
    poses = "1 pose" if about["poses"] == 1 else f"{about['poses']} poses"
    shown = {**about, "points": about["asked_points"], "poses": poses}
    notes = [NOTE["of"], NOTE["on"]] + ([NOTE["report"]] if about["scene"] in SCENES else [])
    axis.text(0.0, y - 0.09, "\n\n".join(n.format(**shown) for n in notes), size=9, va="top",
              linespacing=1.35, transform=axis.transAxes)  # fmt: skip
    axis.set(xlim=(0, 1), ylim=(0, 1))


def _points(rows: list[dict], curve: str, name: str) -> list[tuple[float, float]]:
    """Return (ms, %) of a curve's settings, by time; settings without error or receivers are left out."""
    settings = [(r["frame_ms"], r.get(f"total {name}")) for r in rows if r["curve"] == curve]
    return sorted((x, 100 * y) for x, y in settings if isinstance(y, float) and math.isfinite(y) and y > 0 and x > 0)


def _span(rows: list[dict]) -> tuple[float, float]:
    times = [r["frame_ms"] for r in rows] or [1.0, 100.0]
    return min(*times, 10.0) / 1.5, max(*times, 60.0) * 1.5


def _columns(points: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]


def _ticks(axis) -> None:
    """Label axes with plain numbers: 1, 2, 5, 10 ..."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    low, high = axis.get_xlim()
    every_third = (1.0, 3.0) if high < 3e3 * low else (1.0,)
    for side, steps in ((axis.xaxis, every_third), (axis.yaxis, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0))):
        side.set_major_locator(LogLocator(10, subs=steps))
        side.set_minor_locator(NullLocator())
        side.set_major_formatter(FuncFormatter(lambda v, _: f"{v:,.10g}"))
    axis.grid(color=FAINT, linewidth=0.5, zorder=0)
    for edge in ("top", "right"):
        axis.spines[edge].set_visible(False)
    axis.tick_params(length=3)

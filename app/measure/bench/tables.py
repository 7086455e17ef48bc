"""A sweep as Markdown tables. Rows that were not measured are left out."""

from __future__ import annotations

from app.measure.bench.rows import PHOTONS, RADII, TRIANGLES, photons_key, triangles_key
from gi_core.estimators import DEFAULT


def markdown(sweep: dict) -> str:
    """Return the whole report."""
    have = sweep["rows"]
    parts = [_head(sweep), _rows(have), _growth_with_triangles(have), _stages(have), _failed(sweep)]
    return "\n\n".join(p for p in parts if p) + "\n"


def table(head: list[str], lines: list[list[str]]) -> str:
    """Return a Markdown table, "" without lines."""
    if not lines:
        return ""
    rule = ["---"] + ["---:"] * (len(head) - 1)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *lines))


def _head(sweep: dict) -> str:
    rows = sweep["rows"].values()
    threads = ", ".join(sorted({str(r["threads"]) for r in rows})) or "unknown"
    wrong = [key for key, r in sweep["rows"].items() if not r["bits_equal"]]
    bits = "Every row's last frame has the same bits as from scratch." if rows and not wrong else ""
    if wrong:
        bits = f"**The last frame differs from scratch in: {'; '.join(wrong)}.**"
    loads = [r["load"] for r in rows if r.get("load") is not None]
    busy = f" Up to {max(loads):.1f} threads ran or waited in the minute before a row." if loads else ""
    machine = f"{sweep['processor']}, {threads} threads, commit {sweep['commit'] or 'unknown'}. Times in ms, medians"
    return f"# Sweep of {sweep['scene']}\n\n{machine}; artifact control off unless stated.{busy} {bits}".rstrip()


def _section(title: str, body: str) -> str:
    return f"## {title}\n\n{body}" if body else ""


def _rows(have: dict) -> str:
    """Return the table of all rows but those of triangles; frames should grow with the photons cut, plus a scan."""
    head = ["row", "cut", "frame", "95 %", "CPU", "scan", "all else, us per cut photon",
            "from scratch", "ratio", "first frame", "peak MB"]  # fmt: skip
    grown = {triangles_key(n, radius) for n in TRIANGLES for radius in RADII}
    lines = []
    for key, r in have.items():
        if key in grown:
            continue
        f, cut = r["frame_ms"], r["share_cut"] * r["photons"]
        scan = sum(ms for name, ms in r["stages_ms"].items() if "scan" in name)
        lines.append([
            key, f"{cut:,.0f}", _ms(f["median"]), _ms(f["p95"]), _ms(f["cpu"]), _ms(scan),
            _number(1e3 * (f["median"] - scan) / cut if cut else None), _ms(r["from_scratch_ms"]),
            _times(r["from_scratch_ratio"]), _ms(r["first_frame_ms"]), _number(r["peak_rss_mb"], 0),
        ])  # fmt: skip
    return _section("Rows", table(head, lines))


def _growth_with_triangles(have: dict) -> str:
    parts = []
    for radius in RADII:
        measured = [have[key] for n in TRIANGLES if (key := triangles_key(n, radius)) in have]
        lines = [
            [f"{r['triangles']:,}", f"{r['receivers']:,}", f"{r['radius']:.4g}", _ms(r["frame_ms"]["median"]),
             _times(r["frame_ms"]["median"] / measured[0]["frame_ms"]["median"]), f"{r['segments_changed']:,.0f}"]
            for r in measured
        ]  # fmt: skip
        head = ["triangles", "receivers", "radius m", "frame", "ratio", "segments changed"]
        made = table(head, lines)
        if made:
            parts.append(f"Radius {radius}:\n\n{made}")
    return _section("Growth with static triangles (the same surfaces cut finer)", "\n\n".join(parts))


def _stages(have: dict) -> str:
    """Return the time of each stage at the largest number of photons measured."""
    counts = [n for n in PHOTONS if photons_key(n, DEFAULT) in have]
    if not counts:
        return ""
    r = have[photons_key(max(counts), DEFAULT)]
    lines = [[name, _ms(ms)] for name, ms in (r["stages_ms"] | {"whole frame": r["frame_ms"]["median"]}).items()]
    return _section(f"Stages of a frame at {max(counts):,} photons ({DEFAULT})", table(["stage", "took"], lines))


def _failed(sweep: dict) -> str:
    return _section("Failed", "\n".join(f"- {key}: {why}" for key, why in sweep["failed"].items()))


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:,.0f}"


def _number(value: float | None, digits: int = 2) -> str:
    return "" if value is None else f"{value:,.{digits}f}"


def _times(value: float | None) -> str:
    return "" if value is None else f"{value:.3g} x"

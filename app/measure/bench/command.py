"""`gi-viewer bench`: times of one scene under one setting, as a table and as JSON.

Kernels are compiled, structures built and one frame discarded before anything is timed.
"""

from __future__ import annotations

import json
from pathlib import Path

from app.cli.progress import opened
from app.cli.terminal import say
from app.cli.writable import check_writable, write_whole
from app.measure.bench.measure import measure, warm_up
from app.settings import STEP, Settings, open_moving_scene


def bench(settings: Settings, frames: int, json_file: Path | None = None, step: float = STEP) -> dict:
    """Time `frames` frames, print a table, write the numbers to `json_file`; return them.

    step: distance of a mobile per frame / scene size. Raises SceneError, UsageError, OSError.
    """
    if json_file is not None:
        check_writable("--json", json_file)
    with opened(settings, open_moving_scene) as (bar, scene):
        warm_up(scene, settings)
        numbers = measure(scene, settings, frames, bar, step)
    say(table(numbers))
    if json_file is not None:
        write_whole(json_file, json.dumps(numbers, indent=2) + "\n")
    return numbers


def table(n: dict) -> list[str]:
    """Return the lines of the printed table."""
    f = n["frame_ms"]
    per_cut, peak = n["us_per_cut_photon"], n["peak_rss_mb"]
    control = "with" if n["control"] else "without"
    rows = [
        ("scene", f"{n['scene']}: {n['triangles']:,} triangles, {n['receivers']:,} receivers"),
        ("light", f"{n['photons']:,} photons, {n['segments']:,} segments, seed {n['seed']}"),
        ("estimator", f"{n['estimator']}, radius {n['radius']:.4g} m, k {n['neighbours']}, {control} artifact control"),
        ("machine", f"{n['processor']}, {n['threads']} threads, commit {n['commit'] or 'unknown'}"),
        ("rays", f"traced by {n['rays']}"),
        *_busy(n),
        ("GI frame", f"median {f['median']:.2f} ms, p95 {f['p95']:.2f}, min {f['min']:.2f}, max {f['max']:.2f}"),
        ("  CPU", f"{f['cpu']:.2f} ms, all threads together"),
        ("frames", f"{n['frames']}, one step of {n['step_percent']:g} % of the scene size each"),
        *((f"  {name}", f"{ms:.3f} ms") for name, ms in n["stages_ms"].items()),
        ("photons cut", f"{100 * n['share_cut']:.3f} % (median)"),
        ("changed", f"{n['segments_changed']:,.0f} segments, old and new (median)"),
        ("per cut", f"{per_cut:.2f} us per photon that is cut" if per_cut is not None else "no photon was cut"),
        ("control", _affected(n)),
        ("from scratch", f"{n['from_scratch_ms']:.1f} ms, {n['from_scratch_ratio']:.1f} frames"),
        ("first frame", f"{n['first_frame_ms']:.0f} ms, after {n['prepare_ms']:.0f} ms of preparing the scene"),
        ("peak memory", f"{peak:.0f} MB" if peak is not None else "unknown on this platform"),
        ("same bits", "yes" if n["bits_equal"] else "NO: the frame differs from the same pose from scratch"),
    ]
    return [f"{name:<14}{text}" for name, text in rows]


def _busy(n: dict) -> list[tuple[str, str]]:
    """Return a warning if other programs used the processor: times are then too long."""
    if n["load"] is None or n["load"] < 0.5 * n["threads"]:
        return []
    return [("busy", f"{n['load']:.1f} threads ran or waited in the minute before: rely on CPU time")]


def _affected(n: dict) -> str:
    contact = f"{n['control_stale']:,.0f} near mobiles estimated again, {n['control_on_mobiles']:,.0f} on them"
    return f"{100 * n['control_share']:.1f} % of the receivers; {contact} (median)"

"""`gi-viewer bench`: times of one scene under one setting, as a table and as JSON.

Frame times along the mobiles' paths, and a comparison of the last frame with a solution from scratch. A GI frame is
everything from the new poses to the irradiance array. Kernels are compiled, structures built and one frame discarded
before anything is timed.
"""

from __future__ import annotations

import json
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.cli.progress import Bar, opened, solve
from app.cli.terminal import say
from app.cli.version import commit
from app.cli.writable import check_writable, write_whole
from app.draw import motion
from app.measure.results import load, peak_rss_mb, processor
from app.settings import STEP_PER_FRAME, Settings, make_solver, open_moving_scene
from gi_core.solver import Solver

FORMAT = "gi-viewer bench 4"


def warm_up(scene, settings: Settings) -> None:
    """Load compiled kernels and start threads, on a separate solver with few photons."""
    solver = make_solver(scene, replace(settings, photons=1000))
    solver.solve()
    solver.move_all(solver.poses)
    solver.from_scratch()


def measure(scene, settings: Settings, frames: int, bar: Bar, step: float = STEP_PER_FRAME) -> dict:
    """Return every number of `bench` by its JSON key; step: distance of a mobile per frame / scene size."""
    busy = load()
    started = time.perf_counter()
    solver = make_solver(scene, settings)
    prepared = time.perf_counter()
    solve(solver, bar)
    first_frame = time.perf_counter() - prepared

    lap = motion.walk(motion.paths_of(solver), step * solver.scene_size, frames)
    of_frames, stages = walk(solver, lap, bar)
    ms, middle = np.array(of_frames["ms"]), {name: float(np.median(v)) for name, v in of_frames.items()}
    scratch, equal = _from_scratch(solver, bar)
    return {
        "format": FORMAT,
        "scene": settings.scene,
        "triangles": int(solver.surfaces.first_face[-1]),
        "receivers": len(solver.irradiance),
        "photons": solver.frame.photons,
        "estimator": solver.setting.estimator,
        "control": solver.setting.control,
        "control_share": solver.frame.control_facts.share,
        "control_stale": middle["in contact"],
        "control_on_mobiles": middle["on mobiles"],
        "radius": solver.setting.radius,
        "neighbours": solver.setting.neighbours,
        "seed": solver.seed,
        "threads": solver.model.threads,
        "rays": solver.model.accelerator.rays,
        "processor": processor(),
        "commit": commit(),
        "load": busy,
        "frames": frames,
        "step_percent": 100 * step,
        "frame_ms": {
            "median": middle["ms"],
            "p95": float(np.quantile(ms, 0.95)),
            "min": float(ms.min()),
            "max": float(ms.max()),
            "cpu": middle["cpu ms"],
        },
        "stages_ms": {name: float(np.median(v)) for name, v in stages.items()},
        "share_cut": middle["cut"] / max(solver.frame.photons, 1),
        "segments": solver.frame.segments,
        "segments_changed": middle["changed"],
        "us_per_cut_photon": middle.get("us per cut"),
        "from_scratch_ms": 1e3 * scratch,
        "from_scratch_ratio": 1e3 * scratch / middle["ms"],
        "prepare_ms": 1e3 * (prepared - started),
        "first_frame_ms": 1e3 * first_frame,
        "peak_rss_mb": peak_rss_mb(),
        "bits_equal": equal,
    }


def walk(solver: Solver, lap: list[dict], bar: Bar) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """Time each pose of `lap`, after an untimed frame at the last one.

    Return the numbers of each frame (times, counts of photons, segments and receivers), and its stages [ms].
    """
    frames, stages = defaultdict(list), defaultdict(list)
    solver.move_all(lap[-1])
    for k, poses in enumerate(lap):
        bar("moving", k / len(lap))
        clock, cpu = time.perf_counter(), time.process_time()
        solver.move_all(poses)
        cpu, clock = time.process_time() - cpu, time.perf_counter() - clock
        changes, facts = solver.frame.changes, solver.frame.control_facts
        numbers = {
            "ms": 1e3 * clock,
            "cpu ms": 1e3 * cpu,  # all threads together: other programs hardly change it
            "cut": changes.photons_cut,
            "changed": changes.old_segments + changes.new_segments,
            "in contact": facts.stale,
            "on mobiles": facts.on_mobiles,
        }
        if changes.photons_cut:
            numbers["us per cut"] = 1e6 * clock / changes.photons_cut
        for name, number in numbers.items():
            frames[name].append(number)
        for name, seconds in solver.frame.timings.items():
            stages[name].append(1e3 * seconds)
    return frames, stages


def _from_scratch(solver: Solver, bar: Bar) -> tuple[float, bool]:
    """Return the best time [s] of the same frame from scratch, and whether it has the same bits."""
    best_of = 3  # from-scratch runs
    took, equal = [], True
    for k in range(best_of):
        bar("from scratch", k / best_of)
        before = time.perf_counter()
        fresh = solver.from_scratch()
        took.append(time.perf_counter() - before)
        equal = equal and bool(np.array_equal(fresh, solver.irradiance))
    return min(took), equal


def bench(settings: Settings, frames: int, json_file: Path | None = None, step: float = STEP_PER_FRAME) -> dict:
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

"""`gi-viewer bench`: the mobile walks along its path, every frame is timed, and its light is checked.

A GI frame is everything from the new poses to the irradiance array. Kernels are compiled, structures built
and one frame at the start discarded before anything is timed.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import time
from pathlib import Path

import numpy as np

from app import motion
from app.progress import Bar, compile_kernels, solve
from app.render_command import motion_paths
from app.settings import Settings, UsageError, make_solver, open_scene

BEST_OF = 3  # from-scratch runs
MB = 1e6


def bench(settings: Settings, frames: int, json_file: Path | None = None) -> dict:
    """Time `frames` frames, print a table, write the numbers to `json_file`; return them.

    Raises SceneError, UsageError, OSError.
    """
    if json_file is not None and not json_file.resolve().parent.is_dir():
        raise UsageError(f"--json must name a file in a folder that exists, got {json_file}")
    with Bar() as bar:
        bar("loading", 0.0)
        scene = open_scene(settings)
        if not scene.mobiles:
            raise UsageError(f"{settings.scene} has no mobile to move: add one with --mobile FILE")
        compile_kernels(bar)
        _warm_up(scene, settings)
        numbers = measure(scene, settings, frames, bar)
    print("\n".join(table(numbers)))
    if json_file is not None:
        json_file.write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    return numbers


def measure(scene, settings: Settings, frames: int, bar: Bar) -> dict:
    """Return every number that `bench` prints, by its JSON key."""
    started = time.perf_counter()
    solver = make_solver(scene, settings)
    prepared = time.perf_counter()
    solve(solver, bar)
    first_frame = time.perf_counter() - prepared

    walk = motion.walk(motion_paths(solver), motion.STEP * solver.scene_size, frames)
    solver.move_all(walk[-1])  # the frame before the first one, untimed
    seconds, stages, cut, changed = [], [], [], []
    for k, poses in enumerate(walk):
        bar("moving", k / frames)
        before = time.perf_counter()
        solver.move_all(poses)
        seconds.append(time.perf_counter() - before)
        stages.append(dict(solver.timings))
        cut.append(solver.changes.photons_cut)
        changed.append(solver.changes.old_segments + solver.changes.new_segments)

    scratch, equal = [], True
    for k in range(BEST_OF):
        bar("from scratch", k / BEST_OF)
        before = time.perf_counter()
        fresh = solver.from_scratch(walk[-1])
        scratch.append(time.perf_counter() - before)
        equal = equal and bool(np.array_equal(fresh, solver.irradiance))

    per_cut = [1e6 * s / c for s, c in zip(seconds, cut, strict=True) if c]
    return {
        "scene": settings.scene,
        "triangles": int(solver.surfaces.first_face[-1]),
        "receivers": len(solver.irradiance),
        "photons": solver.photons_traced,
        "estimator": solver.estimator,
        "radius": solver.radius,
        "neighbours": solver.neighbours,
        "seed": solver.seed,
        "threads": solver.model.threads,
        "commit": commit(),
        "frames": frames,
        "frame_ms": {
            "median": 1e3 * statistics.median(seconds),
            "p95": 1e3 * float(np.quantile(seconds, 0.95)),
            "min": 1e3 * min(seconds),
            "max": 1e3 * max(seconds),
        },
        "stages_ms": {name: 1e3 * statistics.median(s.get(name, 0.0) for s in stages) for name in _names(stages)},
        "share_cut": statistics.median(cut) / max(solver.photons_traced, 1),
        "segments": solver.segments_total,
        "segments_changed": statistics.median(changed),
        "us_per_cut_photon": statistics.median(per_cut) if per_cut else None,
        "from_scratch_ms": 1e3 * min(scratch),
        "prepare_ms": 1e3 * (prepared - started),
        "first_frame_ms": 1e3 * first_frame,
        "peak_rss_mb": peak_rss_mb(),
        "bits_equal": equal,
    }


def table(n: dict) -> list[str]:
    """Return the numbers as lines for a person."""
    f = n["frame_ms"]
    per_cut, rss = n["us_per_cut_photon"], n["peak_rss_mb"]
    rows = [
        ("scene", f"{n['scene']}: {n['triangles']:,} triangles, {n['receivers']:,} receivers"),
        ("light", f"{n['photons']:,} photons, {n['segments']:,} segments, seed {n['seed']}"),
        ("estimator", f"{n['estimator']}, radius {n['radius']:.4g} m, k {n['neighbours']}"),
        ("machine", f"{n['threads']} threads, commit {n['commit'] or 'unknown'}"),
        ("GI frame", f"median {f['median']:.2f} ms, p95 {f['p95']:.2f}, min {f['min']:.2f}, max {f['max']:.2f}"),
        ("frames", f"{n['frames']}, one step of {100 * motion.STEP:g} % of the scene size each"),
        *((f"  {name}", f"{ms:.2f} ms") for name, ms in n["stages_ms"].items()),
        ("photons cut", f"{100 * n['share_cut']:.3f} % (median)"),
        ("changed", f"{n['segments_changed']:,.0f} segments, old and new (median)"),
        ("a cut photon", f"{per_cut:.2f} us" if per_cut is not None else "none was cut"),
        ("from scratch", f"{n['from_scratch_ms']:.1f} ms, {n['from_scratch_ms'] / f['median']:.1f} frames"),
        ("first frame", f"{n['first_frame_ms']:.0f} ms, after {n['prepare_ms']:.0f} ms of preparing the scene"),
        ("peak memory", f"{rss:.0f} MB" if rss is not None else "unknown on this platform"),
        ("same bits", "yes" if n["bits_equal"] else "NO: the frame differs from the same pose from scratch"),
    ]
    return [f"{name:<14}{text}" for name, text in rows]


def _warm_up(scene, settings: Settings) -> None:
    """Load what is compiled and start the threads, on a solver of its own with few photons."""
    from dataclasses import replace

    solver = make_solver(scene, replace(settings, photons=1000))
    solver.solve()
    solver.move_all(solver.poses)
    solver.from_scratch()


def _names(stages: list[dict]) -> list[str]:
    return list(dict.fromkeys(name for s in stages for name in s))


def peak_rss_mb() -> float | None:
    """Return the most memory this process has held [MB], None where the platform does not tell (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    import sys

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / MB if sys.platform == "darwin" else peak * 1024 / MB


def commit() -> str | None:
    """Return the commit that the program runs from, "-dirty" if changed since; None outside a checkout."""
    root = Path(__file__).resolve().parent.parent
    if not (root / ".git").exists():  # installed: a repository around the environment is not ours
        return None
    command = ["git", "-C", os.fspath(root), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip() or None
    except (OSError, subprocess.SubprocessError):
        return None

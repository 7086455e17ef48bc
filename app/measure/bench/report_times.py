"""`gi-viewer bench --tables --out DIR`: tables 2.1 to 2.5 of the report, our times beside its own.

Searches run on one thread, the least time of several counts; a few minutes in all.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from app.cli.progress import Bar, compile_kernels, solve
from app.cli.version import commit
from app.cli.writable import write_whole
from app.draw import motion
from app.measure.bench import ray_tables
from app.measure.bench.report import DISC_INDEX, ESTIMATORS, RAY_CACHE, SECOND_RADII, TREE_RADII, Times, markdown
from app.measure.machine import processor
from app.settings import STEP, Settings, UsageError, make_solver, open_scene
from gi_core.discs.search.disc_index import DiscIndex
from gi_core.estimators import CHEAPEST, DEFAULT
from gi_core.model import Model
from gi_core.solver import Solver

GROUND, TREE = ("ground", "skirt"), ("bark", "leaf")  # materials of the scene `tree`
MORE_RADII = (0.05, 0.07, 0.10)  # beyond the report's: the searches cross there
REFERENCE = 1_000_000  # photons of the reference of table 2.1
FRAMES = 8  # the median counts
REPEATS = 5  # of a count; the least time counts
LEAST_SECONDS = 0.02  # of all repeats of a count


def tables(settings: Settings, out: Path) -> str:
    """Measure, write DIR/tables.md, return its text. Raises SceneError, UsageError, OSError."""
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out must name a folder, got {out}")
    with Bar() as bar:
        compile_kernels(bar, settings.rays)
        tree, second = _solver("tree", settings, bar), _solver("second_tree", settings, bar)
        found = {
            "tree 10000": _times(tree, 10_000, TREE_RADII + MORE_RADII, {"whole": None}, bar)
            | _times(tree, 10_000, TREE_RADII, {"tree": TREE, "ground": GROUND}, bar),
            "tree 20000": _times(tree, 20_000, TREE_RADII + MORE_RADII, {"whole": None}, bar),
            "second 20000": _times(second, 20_000, SECOND_RADII, {"whole": None}, bar),
        }
        pretests, estimators = _pretests(tree, bar), _estimators(tree, bar)
        asked = {name: Settings(scene=name) for name in ray_tables.SCENES} | {settings.scene: settings}
        rays = {Path(name).stem: ray_tables.measured(Model(open_scene(s)), bar) for name, s in asked.items()}
    facts = {
        "machine": f"{processor()}, one thread, commit {commit() or 'unknown'}",
        "tree": f"{_static(tree):,} static triangles and a mobile of 500",
        "second": f"{_static(second):,} static triangles and a mobile of {len(second.scene.mobiles[0].mesh.faces)}",
    }
    text = markdown(facts, found, pretests, estimators) + "\n" + ray_tables.section(rays) + "\n"
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "tables.md", text)
    ray_tables.draw(rays, out / "rays.svg")
    return text


def _solver(scene: str, settings: Settings, bar: Bar):
    asked = Settings(
        scene=scene, photons=20_000, estimator=CHEAPEST, seed=settings.seed, control=False, rays=settings.rays
    )
    solver = make_solver(open_scene(asked), asked)
    solve(solver, bar)
    return solver


def _static(solver: Solver) -> int:
    return len(solver.scene.static.faces)


def _times(solver: Solver, photons: int, radii, sets: dict, bar: Bar) -> dict[tuple[str, str, float], Times]:
    """Return the times of each search by (receivers, search, radius)."""
    from gi_core.discs.search import SEARCHES
    from gi_core.instruments.search_timing import frame_lines, photon_lines, search_run, static_discs

    solver.move_all(solver.poses, photons=None)
    out = {}
    for k, radius in enumerate(radii):
        size = radius * solver.scene_size
        every, changed = photon_lines(solver, photons, size), frame_lines(solver, size)
        for name, materials in sets.items():
            discs = static_discs(solver.model, size, materials)
            for search in (RAY_CACHE, DISC_INDEX):
                bar(f"{solver.scene.name}: {search}, radius {radius:g}", k / len(radii))
                made = SEARCHES[search](discs)
                grid = made.grids[0] if isinstance(made, DiscIndex) else None
                cells = (grid.cell_radii, grid.discs_a_cell) if grid else None
                all_seconds, few_seconds = (best_seconds(search_run(made, over)) for over in (every, changed))
                out[name, search, radius] = Times(all_seconds, few_seconds, cells)
    return out


def _pretests(solver: Solver, bar: Bar) -> dict[tuple[str, str], tuple[float, float]]:
    """Return seconds by (search, pre-test) for all segments of 10,000 photons and for those of a frame."""
    from gi_core.discs.search import PRETESTS, SEARCHES
    from gi_core.instruments.search_timing import frame_lines, photon_lines, search_run, static_discs

    radius = TREE_RADII[0] * solver.scene_size
    discs, out = static_discs(solver.model, radius), {}
    every, changed = photon_lines(solver, 10_000, radius), frame_lines(solver, radius)
    for k, pretest in enumerate(PRETESTS):
        bar(f"pre-test {pretest}", k / len(PRETESTS))
        for search in (RAY_CACHE, DISC_INDEX):
            made = SEARCHES[search](discs, pretest)
            out[search, pretest] = best_seconds(search_run(made, every)), best_seconds(search_run(made, changed))
    return out


def _estimators(solver: Solver, bar: Bar) -> dict[str, tuple[float, float, float]]:
    """Return simulation and illumination [ms] per frame and the error [%] of the estimators of table 2.1."""
    solver.configure(estimator=DEFAULT, radius=0.01 * solver.scene_size, photons=REFERENCE)
    solve(solver, bar)
    lap = motion.walk(motion.paths_of(solver), STEP * solver.scene_size, FRAMES)
    static = solver.surfaces.receiver_range(0)
    area = solver.receivers.areas[static]
    solver.move_all(lap[-1])
    truth = solver.irradiance[static].mean(axis=1)
    out = {}
    for k, (name, (photons, *_)) in enumerate(ESTIMATORS.items()):
        bar(f"table 2.1: {name}", k / len(ESTIMATORS))
        solver.configure(estimator=name, photons=photons)
        solve(solver, bar)
        taken = []
        for poses in lap:
            solver.move_all(poses)
            t = solver.frame.timings
            light = sum(t.get(stage, 0.0) for stage in ("estimate", "read out"))
            taken.append((1e3 * (sum(t.values()) - light), 1e3 * light))
        error = area * np.abs(solver.irradiance[static].mean(axis=1) - truth)
        simulation, illumination = np.median(taken, axis=0)
        out[name] = float(simulation), float(illumination), 100 * float(error.sum() / (area * truth).sum())
    return out


def best_seconds(run: Callable[[], object]) -> float:
    """Return the least time [s] of a call, after one untimed call.

    On a busy machine CPU time is nearer to it than the clock: the smaller of both counts.
    """
    run()
    best, spent, calls = math.inf, 0.0, 0
    while calls < REPEATS or spent < LEAST_SECONDS:
        before, cpu_before = time.perf_counter(), time.process_time()
        run()
        seconds, cpu = time.perf_counter() - before, time.process_time() - cpu_before
        best = min(best, seconds, cpu or seconds)  # 0: a clock that ticks 64 times per second (Windows)
        spent, calls = spent + seconds, calls + 1
    return max(best, 1e-9)

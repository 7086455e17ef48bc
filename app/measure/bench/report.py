"""`gi-viewer bench --tables --out DIR`: tables 2.2 to 2.4 of the report beside ours, as Markdown.

Then its space partitionings (section 3.4.1) beside bvh and Embree: a table per scene.

The report's times are seconds on a computer of 2003. Searches run on one thread, the least time of several counts; a
few minutes in all.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from app.cli.progress import Bar, compile_kernels, solve
from app.cli.version import commit
from app.cli.writable import write_whole
from app.draw.camera import from_camera, scene_bounds
from app.measure.results import processor
from app.measure.tables import markdown_table, section
from app.settings import Settings, UsageError, make_solver, open_scene
from gi_core.estimators import CHEAPEST
from gi_core.model import Model
from gi_core.solver import Solver

if TYPE_CHECKING:
    from gi_core.instruments.timing import Cost, Structure
    from gi_core.model import Model
    from gi_core.scene.types import Camera


RAY_CACHE, DISC_INDEX = "ray_cache", "disc_index"

# Tables 2.2 to 2.4 a): seconds per frame by radius, of receivers "whole", "tree" or "ground".
TREE_RADII = (0.01, 0.02, 0.03, 0.04)
TREE_10000 = {
    ("whole", RAY_CACHE): (4.45, 5.70, 7.32, 9.24),
    ("whole", DISC_INDEX): (1.46, 3.43, 7.18, 17.79),
    ("tree", RAY_CACHE): (4.03, 5.34, 6.78, 8.38),
    ("tree", DISC_INDEX): (0.89, 2.78, 7.15, 18.37),
    ("ground", RAY_CACHE): (0.39, 0.46, 0.62, 0.74),
    ("ground", DISC_INDEX): (0.21, 0.33, 0.50, 0.68),
}
TREE_20000 = {("whole", RAY_CACHE): (5.50, 8.16, 11.38, 15.89), ("whole", DISC_INDEX): (2.89, 6.82, 14.12, 41.95)}
SECOND_RADII = (0.03, 0.04, 0.05, 0.10)
SECOND_20000 = {("whole", RAY_CACHE): (2.28, 2.86, 3.79, 7.83), ("whole", DISC_INDEX): (1.34, 2.17, 3.22, 10.29)}

# The same tables b): the best number of primitives per voxel. Table 2.4's columns are named as 2.2's are.
VOXELS_10000 = {"whole": (20, 20, 50, 800), "tree": (20, 10, 100, 1600), "ground": (20, 80, 120, 160)}
VOXELS_20000 = {"whole": (20, 20, 200, 1600)}
VOXELS_SECOND = {"whole": (40, 80, 160, 32000)}

NAMES = {RAY_CACHE: "ray cache", DISC_INDEX: "disc indexing"}


class Times(NamedTuple):
    """Cost of one search at one radius."""

    every: float  # s, all segments
    frame: float  # s, the segments that a frame changes
    cells: tuple[float, float] | None  # of a grid: edge [radii], discs per occupied cell


def markdown(facts: dict, measured: dict) -> str:
    """Return the whole text; measured: `Times` by scene and photons, then by (receivers, search, radius)."""
    tree, more, second = measured["tree 10000"], measured["tree 20000"], measured["second 20000"]
    parts = [
        _head(facts),
        section("Table 2.2: tree, 10,000 photons", _searches(tree, TREE_10000, TREE_RADII)),
        _voxels(tree, VOXELS_10000, TREE_RADII),
        section("Table 2.3: tree, 20,000 photons", _searches(more, TREE_20000, TREE_RADII)),
        _voxels(more, VOXELS_20000, TREE_RADII),
        section("Table 2.4: second tree, 20,000 photons", _searches(second, SECOND_20000, SECOND_RADII)),
        _voxels(second, VOXELS_SECOND, SECOND_RADII),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _head(facts: dict) -> str:
    return (
        f"# Tables 2.2 to 2.4 of the report\n\n{facts['machine']}. Our times are milliseconds, the report's (in "
        'brackets) seconds of a computer of 2003. Our times are for all segments of the photons, and after "frame" '
        "for the segments that one move of the mobile removes and adds at 20,000 photons. The report times a frame "
        f"and gives no number of rays. Tree scene: {facts['tree']}, as many as the report's; leaves are two-sided "
        f"here. Second tree: {facts['second']} (the report gives no number)."
    )


def _searches(measured: dict, theirs: dict, radii) -> str:
    lines = []
    for receivers in dict.fromkeys(key[0] for key in theirs):
        for search in (RAY_CACHE, DISC_INDEX):
            cells = []
            for k, r in enumerate(radii):
                t = measured[receivers, search, r]
                cells.append(f"{1e3 * t.every:.3g}, frame {1e3 * t.frame:.2g} ({theirs[receivers, search][k]:g})")
            lines.append([f"{NAMES[search]}, {receivers}", *cells])
    return markdown_table(["receivers / radius", *(f"{r:g}" for r in radii)], lines)


def _voxels(measured: dict, theirs: dict, radii) -> str:
    lines = []
    for receivers, numbers in theirs.items():
        cells = []
        for k, r in enumerate(radii):
            edge, discs = measured[receivers, DISC_INDEX, r].cells
            cells.append(f"{discs:.0f}, {edge:g} radii ({numbers[k]})")
        lines.append([f"discs per voxel, {receivers}", *cells])
    return markdown_table(["b) best", *(f"{r:g}" for r in radii)], lines)


GROUND, TREE = ("ground", "skirt"), ("bark", "leaf")  # materials of the scene `tree`
REPEATS = 5  # of a count; the least time counts
LEAST_SECONDS = 0.02  # of all repeats of a count


def tables(settings: Settings, out: Path) -> str:
    """Measure, write DIR/tables.md, return its text. Raises SceneError, UsageError, OSError."""
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out must name a folder, got {out}")
    with Bar() as bar:
        compile_kernels(bar, settings.rays)
        tree, second = _solver("tree", settings, bar), _solver("second_tree", settings, bar)
        measured = {
            "tree 10000": _search_times(tree, 10_000, TREE_RADII, {"whole": None, "tree": TREE, "ground": GROUND}, bar),
            "tree 20000": _search_times(tree, 20_000, TREE_RADII, {"whole": None}, bar),
            "second 20000": _search_times(second, 20_000, SECOND_RADII, {"whole": None}, bar),
        }
        asked = {name: Settings(scene=name) for name in SCENES} | {settings.scene: settings}
        rays = {Path(name).stem: measured_structures(Model(open_scene(s)), bar) for name, s in asked.items()}
    facts = {
        "machine": f"{processor()}, one thread, commit {commit() or 'unknown'}",
        "tree": f"{_static(tree):,} static triangles and a mobile of 500",
        "second": f"{_static(second):,} static triangles and a mobile of {len(second.scene.mobiles[0].mesh.faces)}",
    }
    text = markdown(facts, measured) + "\n" + partitionings(rays) + "\n"
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "tables.md", text)
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


def _search_times(solver: Solver, photons: int, radii, sets: dict, bar: Bar) -> dict[tuple[str, str, float], Times]:
    """Return the times of each search by (receivers, search, radius)."""
    from gi_core.instruments.timing import SEARCHES, cells_of, frame_lines, photon_lines, search_run, static_discs

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
                all_seconds, few_seconds = (best_seconds(search_run(made, over)) for over in (every, changed))
                out[name, search, radius] = Times(all_seconds, few_seconds, cells_of(made))
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


SCENES = ("cornell", "living_room", "tree")
HEAD = ["structure", "leaf", "build ms", "MB", "primary", "random", "shadow", "over Embree", "cells", "triangles"]
NOTE = (
    "Times per ray are us of one thread, the least of 5 runs in turn. Primary rays go through pixels of the scene's "
    "camera, random ones on from hits of photons, shadow rays from there to points on lamps. Cells and triangles are "
    "those of a random ray. Ratios to Embree have the order of the times. Each structure has its best leaf size for "
    "random rays; that of `grid3d` is per cell."
)


def measured_structures(model: Model, bar: Bar, rays: int = 20_000) -> list[tuple[Structure, dict[str, Cost]]]:
    """Return every structure at every leaf size over a model's static part, with its costs by kind of ray."""
    from gi_core.instruments.timing import LEAVES, STRUCTURES, built, costs, rays_of

    casts = rays_of(model, scene_camera(model), rays)
    meshes = [(model.surfaces.vertices[0], model.surfaces.faces[0])]
    tried: list[Structure] = []
    for name in STRUCTURES:
        for leaf in LEAVES.get(name, (None,)):
            bar(f"{model.scene.name}: {name}", len(tried) / 30)
            tried.append(built(name, meshes, leaf))
    return list(zip(tried, costs(tried, casts), strict=True))


def scene_camera(model: Model) -> Camera:
    """Return the camera of a picture of the model's scene."""
    return from_camera(model.scene.camera, model.scene.up, scene_bounds(model, model.start_poses())).as_camera()


def with_best_leaf(costs_of: list[tuple[Structure, dict[str, Cost]]]) -> list[tuple[Structure, dict[str, Cost]]]:
    """Return each structure at the leaf size of the fastest random rays."""
    names = dict.fromkeys(s.name for s, _ in costs_of)
    return [min((f for f in costs_of if f[0].name == n), key=lambda f: f[1]["random"].seconds) for n in names]


def partitionings(costs_of: dict[str, list[tuple[Structure, dict[str, Cost]]]]) -> str:
    """Return the Markdown section; costs_of: measurements by the title of a scene."""
    parts = ["## Space partitionings (3.4.1)", NOTE]
    for title, rows in costs_of.items():
        chosen = with_best_leaf(rows)
        embree = next((c for s, c in chosen if s.name == "embree"), None)
        lines = [_line(s, c, embree) for s, c in chosen]
        parts += [f"### {title}", markdown_table(HEAD, lines), _over_leaves(rows)]
    return "\n\n".join(p for p in parts if p)


def _line(s: Structure, cost: dict[str, Cost], embree: dict[str, Cost] | None) -> list[str]:
    random = cost["random"]
    return [
        s.name, f"{s.leaf:g}" if s.leaf else "", f"{1e3 * s.build_seconds:.3g}",
        f"{s.bytes / 1e6:.3g}" if s.bytes else "", *(f"{1e6 * cost[k].seconds:.3g}" for k in cost),
        ", ".join(f"{cost[k].seconds / embree[k].seconds:.2g}" for k in cost) if embree else "",
        f"{random.cells:.1f}" if random.cells else "", f"{random.tests:.1f}" if random.tests else "",
    ]  # fmt: skip


def _over_leaves(rows) -> str:
    lines = []
    for name in dict.fromkeys(s.name for s, _ in rows):
        own = [(s, c) for s, c in rows if s.name == name]
        if len(own) > 1:
            lines.append(f"- {name}, us per random ray over leaf sizes: " + ", ".join(
                f"{1e6 * c['random'].seconds:.3g} at {s.leaf:g}" for s, c in own
            ))  # fmt: skip
    return "\n".join(lines)

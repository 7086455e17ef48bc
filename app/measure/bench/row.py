"""One row of a sweep, measured by a separate process, and the variants of a scene that rows measure.

A separate process gives each row its own peak memory, and its failure ends no other row.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.settings import STEP, Settings, UsageError

if TYPE_CHECKING:
    from gi_core.solver import Solver

ROOT = Path(__file__).resolve().parents[3]
GUESSES = 8  # of the longest edge
CLOSE = 0.02  # of the number of triangles wanted


class Failed(Exception):
    """A row that could not be measured, with the reason in one line."""


def run_apart(spec: dict) -> dict:
    """Measure a row by a separate process. Raises Failed."""
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from app.measure.bench.row import main; sys.exit(main())"
    done = subprocess.run([sys.executable, "-c", code], input=json.dumps(spec), text=True, capture_output=True)
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise Failed(lines[-1] if lines else f"ended with code {done.returncode}")
    return json.loads(done.stdout)


def main() -> int:
    """Measure the row on stdin, print its numbers as JSON; return the exit code."""
    from gi_core.scene import SceneError

    try:
        print(json.dumps(measure_row(json.load(sys.stdin))))
    except (SceneError, UsageError, OSError, MemoryError) as problem:
        print(" ".join(str(problem).split()) or type(problem).__name__, file=sys.stderr)
        return 1
    return 0


def measure_row(spec: dict) -> dict:
    """Open the scene, make the row's variant, measure. Raises SceneError, UsageError."""
    from app.cli.progress import Bar, compile_kernels
    from app.measure.bench.measure import measure, warm_up
    from app.settings import open_moving_scene

    settings = Settings(**{name: _tuples(value) for name, value in spec["settings"].items()})
    scene, settings = vary(open_moving_scene(settings), settings, spec["variant"])
    with Bar() as bar:
        compile_kernels(bar, settings.rays)
        warm_up(scene, settings)
        return measure(scene, settings, spec["frames"], bar, spec["variant"].get("step", STEP))


def _tuples(value):
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def vary(scene, settings: Settings, variant: dict):
    """Return scene and settings of a variant with the keys `two_sided` (bool), or `triangles` (int) and `radius`.

    Mobiles cut the same photons in all variants of triangles. Discs of radius "scaled" shrink with the area per
    receiver, so that a segment crosses as many of them; of radius "fixed" they do not.
    """
    from app.settings import make_solver

    if "two_sided" in variant:
        scene = replace(scene, materials=tuple(m._replace(two_sided=variant["two_sided"]) for m in scene.materials))
    if "triangles" in variant:
        own = make_solver(scene, settings)
        scene = replace(scene, static=_cut(scene.static, variant["triangles"]))
        settings = replace(settings, radius=own.setting.radius)
        if variant["radius"] == "scaled":
            share = _static_receivers(own) / _static_receivers(make_solver(scene, settings))
            settings = replace(settings, radius=own.setting.radius * math.sqrt(share))
    return scene, settings


def _static_receivers(solver: Solver) -> int:
    return solver.surfaces.receiver_range(0).stop


def _cut(mesh, triangles: int):
    """Return a mesh cut finer until it has about the number of triangles wanted; one with as many is not changed."""
    from gi_core.geometry.surfaces import face_normals
    from gi_core.geometry.tessellation import tessellate

    if len(mesh.faces) >= (1 - CLOSE) * triangles:
        return mesh
    edge, best = 1.5 * math.sqrt(face_normals(mesh)[1].sum() / triangles), mesh
    for _ in range(GUESSES):
        tried = tessellate(mesh, edge)
        if abs(len(tried.faces) - triangles) < abs(len(best.faces) - triangles):
            best = tried
        if abs(len(tried.faces) - triangles) <= CLOSE * triangles:
            break
        edge *= math.sqrt(len(tried.faces) / triangles)  # half the edge: four times the triangles
    return best

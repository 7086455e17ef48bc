"""One row of a sweep in a process of its own: `python -m app.measure.bench.row`, the row on stdin, its numbers on
stdout.

So each row's peak memory is its own, what it held is given back, and one that fails takes no other along.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from app.settings import STEP, Settings, UsageError

ROOT = Path(__file__).resolve().parents[3]


class Failed(Exception):
    """A row that could not be measured; says why in one line."""


def run_apart(spec: dict) -> dict:
    """Measure a row in a process of its own. Raises Failed."""
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from app.measure.bench.row import main; sys.exit(main())"
    done = subprocess.run([sys.executable, "-c", code], input=json.dumps(spec), text=True, capture_output=True)
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise Failed(said[-1] if said else f"ended with code {done.returncode}")
    return json.loads(done.stdout)


def measure_row(spec: dict) -> dict:
    """Open the scene, make the variant of it, measure. Raises SceneError, UsageError."""
    from app.cli.progress import Bar, compile_kernels
    from app.measure.bench.measure import measure, warm_up
    from app.settings import open_moving_scene

    given = {name: _tuples(value) for name, value in spec["settings"].items()}
    settings = Settings(**given)
    scene = open_moving_scene(settings)
    scene, settings = vary(scene, settings, spec["variant"])
    with Bar() as bar:
        compile_kernels(bar)
        warm_up(scene, settings)
        return measure(scene, settings, spec["frames"], bar, spec["variant"].get("step", STEP))


def vary(scene, settings: Settings, variant: dict):
    """Return scene and settings with the row's variant: `two_sided`, or `triangles` and `radius`.

    `step` is of the motion alone. With `radius` "scaled" discs shrink as they get more, so that a segment crosses as
    many.
    """
    from app.measure.bench.rows import TREE
    from app.measure.bench.scenes import with_sides, with_triangles
    from app.settings import make_solver

    if "two_sided" in variant:
        scene = with_sides(scene, variant["two_sided"])
    if "triangles" in variant:
        own = make_solver(scene, settings)
        scene = with_triangles(scene, variant["triangles"], coarse=settings.scene == TREE)
        settings = replace(settings, radius=own.radius)
        if variant["radius"] == "scaled":
            # Crossings go by receivers, of which coarse leaves have more a triangle than fine ones.
            share = _static_receivers(own) / _static_receivers(make_solver(scene, settings))
            settings = replace(settings, radius=own.radius * math.sqrt(share))
    return scene, settings


def _static_receivers(solver) -> int:
    return solver.surfaces.receiver_range(0).stop


def _tuples(value):
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def main() -> int:
    """Measure the row on stdin; return the exit code."""
    from gi_core.scene import SceneError

    try:
        print(json.dumps(measure_row(json.load(sys.stdin))))
    except (SceneError, UsageError, OSError, MemoryError) as problem:
        print(" ".join(str(problem).split()) or type(problem).__name__, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

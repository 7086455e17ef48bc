"""CPU seconds from launch to the first picture, by stage.

    python -m studies.startup cornell tree room.glb+chair.glb --times 3

A fresh process opens each scene as the window does, without a window; the least of several runs counts. Kernels and
byte code are compiled beforehand. `--profile` prints the most expensive functions instead.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STAGES = ("imports", "loading", "settings", "meshes", "first picture")


def as_installed() -> None:
    """Compile byte code and kernels, as after installation and a first run."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    subprocess.run([sys.executable, "-m", "compileall", "-q", "app", "gi_core", "studies"], cwd=ROOT, check=True)
    subprocess.run([sys.executable, "-m", "gi_core.instruments.compile_ahead"], stdout=subprocess.DEVNULL, check=True)


def open_once(what: str) -> dict[str, float]:
    """Return the CPU seconds of this process at the end of each stage."""
    passed = {}

    def mark() -> None:
        passed[STAGES[len(passed)]] = time.process_time()

    from app.draw.picking import Picker
    from app.draw.vertex_colours import draw_meshes
    from app.settings import Settings, make_solver, open_scene
    from gi_core import solver  # noqa: F401  # both are imported in any case
    from gi_core.instruments import compile_ahead  # noqa: F401  # both are imported in any case

    mark()
    static, *mobiles = what.split("+")
    settings = Settings(scene=static, mobiles=tuple(mobiles))
    scene = open_scene(settings)
    mark()
    made = make_solver(scene, settings)
    mark()
    draw_meshes(made.surfaces), Picker(made.surfaces)
    mark()
    for progress in made.solve_steps():
        if progress.picture:
            break
    made.move_all(made.poses)
    mark()
    return passed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(open_once(asked.scenes[0])))
        return
    if asked.profile:
        profile = cProfile.Profile()
        profile.runcall(open_once, asked.scenes[0])
        pstats.Stats(profile).sort_stats("cumulative").print_stats(60)
        return
    as_installed()
    print("| scene |", " | ".join(STAGES), "| all |")
    for what in asked.scenes:
        command = [sys.executable, "-m", "studies.startup", what, "--one"]
        runs = [json.loads(subprocess.check_output(command)) for _ in range(asked.times)]
        best = min(runs, key=lambda run: run[STAGES[-1]])
        before = 0.0
        for stage in STAGES:
            best[stage], before = best[stage] - before, best[stage]
        print(f"| {what} |", " | ".join(f"{best[s]:.2f}" for s in STAGES), f"| {before:.2f} |", flush=True)


if __name__ == "__main__":
    main()

"""CPU seconds from launch to the first picture, by stage.

    python -m studies.startup cornell tree room.glb+chair.glb --times 3 --stored 60

A fresh process opens each scene as the window does, without a window; the least of several runs counts. Kernels and
byte code are compiled beforehand. Stored light is empty, or with `--stored` gathered beforehand for so many CPU
seconds; *gathered* says whether the first picture shows it, with its stated error. `--profile` prints the most
expensive functions instead.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from app.rest.reference_store import FOLDER_VARIABLE

ROOT = Path(__file__).resolve().parent.parent
STAGES = ("imports", "loading", "settings", "meshes", "stored light", "first picture")


def as_installed() -> None:
    """Compile byte code and kernels, as after installation and a first run."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    subprocess.run([sys.executable, "-m", "compileall", "-q", "app", "gi_core", "studies"], cwd=ROOT, check=True)
    subprocess.run([sys.executable, "-m", "gi_core.instruments.compile_ahead"], stdout=subprocess.DEVNULL, check=True)


def open_once(what: str, gather: float = 0.0) -> dict[str, float]:
    """Return the CPU seconds of this process at the end of each stage, and more about the first picture.

    gather: CPU seconds of gathering afterwards, whose light is stored.
    """
    passed: dict[str, float] = {}

    def mark() -> None:
        passed[STAGES[len(passed)]] = time.process_time()

    from app.draw.draw_mesh import draw_meshes
    from app.draw.picking import Picker
    from app.rest.gather_jobs import load
    from app.rest.reference_store import StaticStore
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
    for _ in load(made) if made.light == "best" else ():
        pass
    mark()
    for progress in made.solve_steps():
        if progress.picture:
            break
    made.move_all(made.poses)
    mark()
    g, end = made.frame_light.static.gathered, time.process_time() + gather
    facts = {
        "photons": made.frame.photons,
        "error": g.estimate.error if made.frame.gathered else None,
        "seconds": time.time(),
    }
    if gather:
        for _ in made.gather_steps():
            g = made.frame_light.static.gathered
            if time.process_time() > end and g.state is not None and g.state.rounds > 2:
                break
        StaticStore(made.model, made.seed).keep(g.state)
    return passed | facts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--stored", type=float, default=0.0, help="CPU seconds of gathering beforehand")
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(open_once(asked.scenes[0], asked.stored)))
        return
    if asked.profile:
        profile = cProfile.Profile()
        profile.runcall(open_once, asked.scenes[0])
        pstats.Stats(profile).sort_stats("cumulative").print_stats(60)
        return
    as_installed()
    print("| scene |", " | ".join(STAGES), "| all | wall | photons | gathered |")
    with tempfile.TemporaryDirectory() as store:
        os.environ[FOLDER_VARIABLE] = store
        for what in asked.scenes:
            measure(what, asked.times, asked.stored)


def measure(what: str, times: int, stored: float) -> None:
    """Print the line of a scene."""
    command = [sys.executable, "-m", "studies.startup", what, "--one"]
    if stored:
        subprocess.run([*command, "--stored", str(stored)], stdout=subprocess.DEVNULL, check=True)
    runs = []
    for _ in range(times):
        begun = time.time()
        runs.append(json.loads(subprocess.check_output(command)))
        runs[-1]["seconds"] -= begun
    best = min(runs, key=lambda run: run[STAGES[-1]])
    spent = np.diff([0.0, *(best[stage] for stage in STAGES)])
    cells = [f"{s:.2f}" for s in (*spent, best[STAGES[-1]], min(run["seconds"] for run in runs))]
    gathered = f"yes, {100 * best['error']:.1f} %" if best["error"] is not None else "no"
    print(f"| {what.rpartition('/')[2]} |", " | ".join(cells), f"| {best['photons']:,} | {gathered} |", flush=True)


if __name__ == "__main__":
    main()

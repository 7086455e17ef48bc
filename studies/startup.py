"""CPU seconds from launch to the first picture, by stage.

    python -m studies.startup cornell tree room.glb+chair.glb --times 3 --stored 60

A fresh process opens each scene as the window does, without a window; the least of several runs counts. Kernels and
byte code are compiled beforehand. Stored light is empty, or with `--stored` that of a session which ended after so many
CPU seconds of work at rest: its stated error and its true one (less 1 % noise of the truth, relative l1 at 500
receivers) stand beside those of the first picture of the next. `--lamp` dims lamps in the latter. `--profile` prints
the most expensive functions instead.
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


def open_once(what: str, rest: float, lamps: list[str], truth: bool) -> dict[str, float]:
    """Return the CPU seconds of this process at the end of each stage, and more about the first picture.

    rest: CPU seconds of work afterwards, about whose last picture more is then returned; truth: whether its
    error is measured.
    """
    passed: dict[str, float] = {}

    def mark() -> None:
        passed[STAGES[len(passed)]] = time.process_time()

    from app.draw.draw_mesh import draw_meshes
    from app.rest.jobs import StaticJob, first_task
    from app.rest.reference_store import StaticStore
    from app.settings import Settings, make_solver, open_scene
    from app.values import lamp
    from gi_core import solver  # noqa: F401  # both are imported in any case
    from gi_core.instruments import compile_ahead  # noqa: F401  # both are imported in any case

    mark()
    static, *mobiles = what.split("+")
    settings = Settings(scene=static, mobiles=tuple(mobiles), lamps=tuple(map(lamp, lamps)))
    scene = open_scene(settings)
    mark()
    made = make_solver(scene, settings)
    mark()
    draw_meshes(made.surfaces)
    mark()
    made.frame_light.static.gathered = StaticStore(made.model, made.seed).load()
    mark()
    for progress in made.solve_steps():
        if progress.picture:
            break
    made.move_all(made.poses)
    mark()
    now, end = time.time(), time.process_time() + rest
    job, steps = StaticJob(made, time.monotonic), made.solve_steps()
    while time.process_time() < end and (next(steps, None) or ((t := first_task((job,), settings)) and (t.run(), 1))):
        pass
    if rest:
        job.keep()
    shown = made.frame_light.static.on_show(made.frame.background)
    areas = made.model.object_receivers.areas[: made.surfaces.receiver_range(0).stop]
    facts = {"photons": made.frame.photons, "seconds": now, "stated": shown and shown.error_at(made.levels, areas)}
    return passed | facts | {"error": error_of(made) if truth else None}


def error_of(solver) -> float:
    """Return the relative l1 error of the picture, without the truth's noise."""
    from app.rest.reference_store import ReferenceStore
    from gi_core.gather.reference_sample import ReferenceSample, draw_by_area

    areas = solver.receivers.areas
    rows, times = draw_by_area(np.flatnonzero(areas > 0), areas, 500, 0)
    store = ReferenceStore(solver.model, solver.poses, rows, 1, times, solver.levels)
    *_, reached = store.gather(0.01)
    return ReferenceSample(rows, times, reached.state.mean, reached.noise, 1.0).error(solver.irradiance)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--stored", type=float, default=0.0, help="CPU seconds of the session before")
    parser.add_argument("--lamp", action="append", default=[], metavar="NAME=LEVEL")
    parser.add_argument("--truth", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(open_once(asked.scenes[0], asked.stored, asked.lamp, asked.truth)))
        return
    if asked.profile:
        profile = cProfile.Profile()
        profile.runcall(open_once, asked.scenes[0], 0.0, asked.lamp, False)
        pstats.Stats(profile).sort_stats("cumulative").print_stats(60)
        return
    as_installed()
    print("| scene |", " | ".join(STAGES), "| all | wall | photons | session before | first picture |")
    with tempfile.TemporaryDirectory() as store:
        os.environ[FOLDER_VARIABLE] = store
        for what in asked.scenes:
            lamps = [word for lamp in asked.lamp for word in ("--lamp", lamp)]
            measure(what, asked.times, asked.stored, [*lamps, "--truth"])


def measure(what: str, times: int, stored: float, more: list[str]) -> None:
    """Print the line of a scene."""
    command = [sys.executable, "-m", "studies.startup", what, "--one", *(more if stored else [])]
    before = ""
    if stored:
        before = _errors(json.loads(subprocess.check_output([*command, "--stored", str(stored)])))
    runs = []
    for _ in range(times):
        begun = time.time()
        runs.append(json.loads(subprocess.check_output(command)))
        runs[-1]["seconds"] -= begun
    best = min(runs, key=lambda run: run[STAGES[-1]])
    spent = np.diff([0.0, *(best[stage] for stage in STAGES)])
    cells = [f"{s:.2f}" for s in (*spent, best[STAGES[-1]], min(run["seconds"] for run in runs))]
    errors = f"{before} | {_errors(best)}"
    print(f"| {what.rpartition('/')[2]} |", " | ".join(cells), f"| {best['photons']:,} | {errors} |", flush=True)


def _errors(facts: dict) -> str:
    stated, true = (f"{100 * e:.2f} %" if e is not None else "unknown" for e in (facts["stated"], facts["error"]))
    return f"stated {stated}, true {true}"


if __name__ == "__main__":
    main()

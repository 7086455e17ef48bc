"""Error of the picture ten seconds after launch, and 1, 3 and 10 seconds after the first picture.

    python -m studies.ten_seconds living_room gallery room.glb+chair.glb

CPU seconds stand for the clock: one core up to the first step, then two that together count GAIN times. This
excludes the CPU time of other programs but not slower cores and caches, so times on a busy machine are too long.
Photons are traced and static light is gathered as in the window without --estimator; frame timing and error
measurement, which the window also does, are left out. Luminance error (l1) at receivers of the first view, drawn by
area, against the unbiased reference, whose noise is subtracted in squares; and the same of all photons alone.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from studies.startup import as_installed
from tests.support.receiver_samples import in_view

GAIN = 1.8  # CPU seconds per second of two threads, which sometimes wait for each other
SECONDS = 10.0
AFTER_FIRST = 1.0, 3.0, 10.0


def measure(what: str, points: int, noise: float) -> str:
    """Return one line of the table."""
    from gi_core.instruments import compile_ahead

    assert compile_ahead.is_warm()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GI_VIEWER_REFERENCE_DIR"] = folder  # nothing is known from before
        return _measure(what, points, noise)


def _measure(what: str, points: int, noise: float) -> str:
    from app.rest.static_job import Gathering
    from app.settings import Settings, make_solver, open_scene
    from gi_core.gather.reference_sample import draw_by_area, gather_sample

    static, *mobiles = what.split("+")
    settings = Settings(scene=static, mobiles=tuple(mobiles), light="best")
    solver = make_solver(open_scene(settings), settings)
    begun = time.process_time()

    def clock() -> float:
        return begun + (time.process_time() - begun) / GAIN

    shown: list[tuple[float, str, np.ndarray]] = []  # time, parts and irradiance of each picture

    def look() -> None:
        E = solver.drawn(solver.irradiance).irradiance
        if not shown or E is not shown[-1][2]:
            shown.append((clock(), _made_of(solver), E))

    gathering = Gathering(solver, clock)
    for progress in solver.solve_steps():
        if progress.picture or shown:
            look()
    ready, all_photons, first = clock(), solver.frame.photons, shown[0][0]
    while clock() <= first + SECONDS and (work := gathering.next_work()) is not None:
        work()
        look()
    solver.configure(prefix_only=True)
    solver.move_all({})
    by_photons = solver.irradiance
    rows, weights = draw_by_area(in_view(solver), solver.receivers.areas, points, 10)
    *_, sample = gather_sample(solver.model, solver.poses, rows, weights, 1, noise)
    then, *early = (_at(shown, seconds) for seconds in (SECONDS, *(first + after for after in AFTER_FIRST)))
    at_ten, at_rest, *at = (100 * sample.error(E) for E in (then[2], by_photons, *(picture[2] for picture in early)))
    after = " | ".join(f"{error:.1f} %" for error in at)
    name = "+".join(part.rpartition("/")[2] for part in what.split("+"))
    return (
        f"| {name} | {first:.1f} s | {then[1]} | {at_ten:.1f} % | {all_photons:,} | {ready:.1f} s "
        f"| {at_rest:.1f} % | {after} | {100 * sample.noise:.1f} % |"
    )


def _at(shown: list[tuple[float, str, np.ndarray]], seconds: float) -> tuple[float, str, np.ndarray]:
    """Return the picture on show at a time, or the first one."""
    return next((picture for picture in reversed(shown) if picture[0] <= seconds), shown[0])


def _made_of(solver) -> str:
    """Return photons and gathered noise of the picture, in words."""
    source = solver.light_source
    gathered = f", gathered to {100 * source.gathered.noise:.1f} %" if source.is_gathered else ""
    return f"{solver.frame.photons:,}{gathered}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--points", type=int, default=400)
    parser.add_argument("--noise", type=float, default=1.0, help="of the truth [%%]")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(measure(asked.scenes[0], asked.points, 1e-2 * asked.noise), flush=True)
        return
    as_installed()
    print(
        "| scene | first picture | photons shown at 10 s | error | photons | ready | error "
        "| 1 s after the first | 3 s | 10 s | noise of truth |"
    )
    for what in asked.scenes:
        options = ["--one", "--points", str(asked.points), "--noise", str(asked.noise)]
        subprocess.run([sys.executable, "-m", "studies.ten_seconds", what, *options], check=True)


if __name__ == "__main__":
    main()

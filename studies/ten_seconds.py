"""Error of the picture ten seconds after launch, and 1, 3 and 10 seconds after the first picture.

    python -m studies.ten_seconds living_room gallery room.glb+chair.glb --chart early.png --pictures out/early

CPU seconds stand for the clock: one core up to the first step, then two that together count GAIN times. This
excludes the CPU time of other programs but not slower cores and caches, so times on a busy machine are too long.
Photons are traced and static light is gathered as in the window without --estimator; frame timing and error
measurement, which the window also does, are left out. Luminance error (l1) at receivers of the first view, drawn by
area, against the unbiased reference, whose noise is subtracted in squares; and the same of all photons alone.
--chart draws the error of every picture, --pictures saves those 1, 3 and 10 seconds after the first. Clouds are the
local deviation within a tenth of the scene (`gi_core.geometry.error.local_deviation`), median / 90th percentile.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gi_core.geometry.error import CLOUD_REACH
from studies.startup import as_installed
from tests.support.receiver_samples import in_view

if TYPE_CHECKING:
    from gi_core.display.dilation import Drawn

GAIN = 1.8  # CPU seconds per second of two threads, which sometimes wait for each other
SECONDS = 10.0
AFTER_FIRST = 1.0, 3.0, 10.0
BAR = 40.0, 25.0, 10.0  # largest error wanted then [%]


def measure(what: str, points: int, noise: float, pictures: Path | None) -> dict:
    """Return a line of the table, and times after the first picture [s] with errors [%]."""
    from gi_core.instruments import compile_ahead

    assert compile_ahead.is_warm()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GI_VIEWER_REFERENCE_DIR"] = folder  # nothing is known from before
        return _measure(what, points, noise, pictures)


def _measure(what: str, points: int, noise: float, pictures: Path | None) -> dict:
    from app.rest.jobs import StaticJob, first_task
    from app.settings import Settings, make_solver, open_scene
    from gi_core.gather.reference_sample import draw_by_area, gather_sample

    static, *mobiles = what.split("+")
    settings = Settings(scene=static, mobiles=tuple(mobiles), light="best")
    solver = make_solver(open_scene(settings), settings)
    begun = time.process_time()

    def clock() -> float:
        return begun + (time.process_time() - begun) / GAIN

    shown: list[tuple[float, str, Drawn]] = []  # time, parts and light of each picture

    def look() -> None:
        drawn = solver.drawn(solver.irradiance)
        if not shown or not np.array_equal(drawn.irradiance, shown[-1][2].irradiance):
            shown.append((clock(), _made_of(solver), drawn))

    gathering = StaticJob(solver, clock)
    for progress in solver.solve_steps():
        if progress.picture or shown:
            look()
    ready, all_photons, first = clock(), solver.frame.photons, shown[0][0]
    while clock() <= first + SECONDS and (work := first_task((gathering,), settings)) is not None:
        work.run()
        look()
    name = "+".join(part.rpartition("/")[2] for part in what.split("+"))
    if pictures is not None:
        _save(solver, settings, {s: _at(shown, first + s)[2] for s in AFTER_FIRST}, pictures, Path(name).stem)
    then, *early = (_at(shown, seconds) for seconds in (SECONDS, *(first + after for after in AFTER_FIRST)))
    solver.configure(subset_only=True)
    solver.move_all({})
    by_photons = solver.irradiance
    rows, weights = draw_by_area(in_view(solver), solver.receivers.areas, points, 10)
    *_, sample = gather_sample(solver.model, solver.poses, rows, weights, 1, noise)
    at_ten, at_rest, *at = (100 * sample.error(E) for E in (_E(then), by_photons, *map(_E, early)))
    reach, receivers = CLOUD_REACH * solver.scene_size, solver.receivers
    clouds = (sample.local_deviation(E, receivers, reach) for E in map(_E, early))
    after = " | ".join(
        f"{error:.1f}, {100 * m:.1f} / {100 * h:.1f} %" for error, (m, h) in zip(at, clouds, strict=True)
    )
    line = (
        f"| {name} | {first:.1f} s | {then[1]} | {at_ten:.1f} % | {all_photons:,} | {ready:.1f} s "
        f"| {at_rest:.1f} % | {after} | {100 * sample.noise:.1f} % |"
    )
    curve = [(picture[0] - first, 100 * sample.error(_E(picture))) for picture in shown]
    return {"name": Path(name).stem, "line": line, "curve": curve}


def _save(solver, settings, shown: dict[float, Drawn], folder: Path, name: str) -> None:
    """Save the pictures of some light, by seconds, at the exposure of the last."""
    from app.draw.picture_files import write_png
    from app.draw.shot import Shot

    folder.mkdir(parents=True, exist_ok=True)
    shot = Shot(solver, settings)
    for seconds in reversed(shown):
        vars(solver)["drawn"] = lambda *_, drawn=shown[seconds]: drawn
        write_png(folder / f"{name}-{seconds:.0f}s.png", shot.take())
    del vars(solver)["drawn"]


def _draw(found: list[dict], file: str) -> None:
    """Draw the errors of all pictures against the time after the first one, and the bar."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.0))
    for each in found:
        times, errors = np.array([point for point in each["curve"] if point[0] <= SECONDS]).T
        axes.step([*times, SECONDS], [*errors, errors[-1]], where="post", label=each["name"].replace("_", " "))
    axes.plot(AFTER_FIRST, BAR, "kv", markersize=7, label="at most")
    axes.set(xlabel="seconds after the first picture, two cores", ylabel="error in view [%]", yscale="log")
    axes.set_xlim(0, SECONDS + 0.3)
    axes.set_yticks([1, 2, 5, 10, 20, 40], labels=["1", "2", "5", "10", "20", "40"])
    axes.minorticks_off()
    axes.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(file, dpi=110)


def _E(picture: tuple[float, str, Drawn]) -> np.ndarray:
    return picture[2].irradiance


def _at(shown: list[tuple[float, str, Drawn]], seconds: float) -> tuple[float, str, Drawn]:
    """Return the picture on show at a time, or the first one."""
    return next((picture for picture in reversed(shown) if picture[0] <= seconds), shown[0])


def _made_of(solver) -> str:
    """Return photons and gathered noise of the picture, in words."""
    static = solver.frame_light.static
    gathered = f", gathered to {100 * static.gathered.noise:.1f} %" if solver.frame_light.is_gathered else ""
    return f"{solver.frame.photons:,}{gathered}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--points", type=int, default=2000)
    parser.add_argument("--noise", type=float, default=1.0, help="of the truth [%%]")
    parser.add_argument("--chart", help="figure to draw")
    parser.add_argument("--pictures", type=Path, help="folder of pictures")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        found = measure(asked.scenes[0], asked.points, 1e-2 * asked.noise, asked.pictures)
        print(found["line"], flush=True)
        Path(asked.one).write_text(json.dumps(found))
        return
    as_installed()
    print(
        "| scene | first picture | photons shown at 10 s | error | photons | ready | error "
        "| 1 s after the first: error, clouds | 3 s | 10 s | noise of truth |"
    )
    every = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "one.json")
        for what in asked.scenes:
            options = ["--one", str(file), "--points", str(asked.points), "--noise", str(asked.noise)]
            options += ["--pictures", str(asked.pictures)] if asked.pictures else []
            subprocess.run([sys.executable, "-m", "studies.ten_seconds", what, *options], check=True)
            every.append(json.loads(file.read_text()))
    if asked.chart:
        _draw(every, asked.chart)


if __name__ == "__main__":
    main()

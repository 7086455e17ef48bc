"""Error of mobiles' light and frame time on the chart's path, by photons and paths, against a truth of little noise.

    python -m studies.mobile_frames tree cornell --sizes 131072,64 131072,128 --poses 6

The chart's truth has 1 % of noise over all receivers, and 7 % on the leaves of tree. Here it has --noise percent on
mobiles alone, at some poses of the path, and is subtracted in squares. Static light is gathered as in the chart. All
mobiles move at once; with --only NAME that one moves, as in a drag, and counts.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from app.measure.chart.measure import Run
from app.measure.chart.settings import Choice
from app.settings import Settings, open_scene
from gi_core.estimators import DEFAULT
from gi_core.frames.light_setting import PATHS
from gi_core.gather.reference_sample import ReferenceSample, draw_by_area, gather_sample
from gi_core.geometry.error import bias_left, luminance, relative_error
from gi_core.scene.errors import SceneError
from gi_core.scene.rules import one_of
from gi_core.solver import Solver

SIZES = ("16384,32", "131072,64", "131072,128", "131072,256")
FRAMES = 12  # of the path
LAPS = 6  # of the path
TRUTH_SEED = 77  # of nothing else


def report(
    name: str, sizes: list[tuple[int, int]], poses: int, points: int, noise: float, only: str | None = None
) -> None:
    """Print the table of a scene; only: the mobile that moves, None: all."""
    settings = Settings(scene=name, estimator=DEFAULT)
    with tempfile.TemporaryDirectory() as folder:
        run = Run(open_scene(settings), settings, False, FRAMES, None, Path(folder), lambda stage, fraction: None)
    for photons, paths in sizes:  # before the truth, which takes minutes
        one_of(run.effort.photons).check(f"{name}: the photons of a frame", photons)
        one_of(PATHS).check("the paths per receiver and frame", paths)
    base, frames = run.base, [(2 * k + 1) * FRAMES // (2 * poses) for k in range(poses)]
    areas = base.receivers.areas
    lap, of_mobiles = run.lap, np.arange(base.surfaces.receiver_range(0).stop, len(areas))
    if only is not None:
        lap = [{**lap[-1], only: at[only]} for at in lap]
        rows = base.surfaces.receiver_range(1 + base.model.names.index(only))
        of_mobiles = np.arange(rows.start, rows.stop)
    rows, weights = draw_by_area(of_mobiles[areas[of_mobiles] > 0], areas, points, TRUTH_SEED)
    truths = [_truth(base, lap[k], rows, weights, noise) for k in frames]
    T, w = np.concatenate([t.irradiance for t in truths]), np.tile(weights, poses)
    chance = float(np.mean([t.noise for t in truths]))
    print(f"{name}: {len(rows):,} receivers on mobiles, {poses} poses, noise of truth {100 * chance:.1f} %")
    print("| photons | paths | error | sum | frame, median of all, ms |\n|---|---|---|---|---|")
    for photons, paths in sizes:
        size = Choice(DEFAULT, photons, max(run.effort.photons), base.setting.radius, base.setting.neighbours, True,
                      "best", paths=paths)  # fmt: skip
        solver, _ = run.measurer.solved(size)
        found, ms = _along(solver, lap, size, frames, rows)
        E = np.concatenate(found)
        error = bias_left(relative_error(E, T, w).l1, chance)
        total = float((w * luminance(E)).sum() / (w * luminance(T)).sum()) - 1
        print(f"| {photons:,} | {paths} | {100 * error:.2f} % | {100 * total:+.1f} % | {ms:.1f} |", flush=True)


def _truth(solver: Solver, poses: dict, rows: np.ndarray, weights: np.ndarray, noise: float) -> ReferenceSample:
    *_, found = gather_sample(solver.model, poses, rows, weights, TRUTH_SEED, 1e-2 * noise)
    return found


def _along(
    solver: Solver, lap: list, size: Choice, frames: list[int], rows: np.ndarray
) -> tuple[list[np.ndarray], float]:
    """Return the irradiance (n, 3) at receivers in some frames of a lap, and the median time of a frame [ms].

    The first of LAPS laps fills caches, the others are timed.
    """
    ms, found = [], []
    for _ in range(LAPS):
        ms.append([])
        for k, poses in enumerate(lap):
            started = time.perf_counter()
            solver.move_all(poses, *size.frame)
            ms[-1].append(1e3 * (time.perf_counter() - started))
            if k in frames and len(ms) == 1:
                found.append(solver.irradiance[rows])
    return found, float(np.median(ms[1:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--sizes", nargs="+", default=SIZES, metavar="PHOTONS,PATHS")
    parser.add_argument("--poses", type=int, default=6)
    parser.add_argument("--points", type=int, default=300, help="receivers on mobiles")
    parser.add_argument("--noise", type=float, default=1.0, help="of the truth [%%]")
    parser.add_argument("--only", metavar="NAME", help="the mobile that moves")
    asked = parser.parse_args()
    sizes = [tuple(int(n) for n in size.split(",")) for size in asked.sizes]
    for name in asked.scenes:
        try:
            report(name, sizes, asked.poses, asked.points, asked.noise, asked.only)
        except SceneError as error:
            parser.error(str(error))


if __name__ == "__main__":
    main()

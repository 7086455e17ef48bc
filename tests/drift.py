"""Many moves, back to the start: `python -m tests.drift --scene cornell --photons 1000 --moves 100000`.

Prints the memory of the process along the way. Exit code 1 where light at the end differs by a bit from that of the
start, or from a solution from scratch. `--malloc` also asks the C library to give back what is free, and tells how
much of the growth that was; `--trace` tells what Python's own allocations grew by. Linux alone (it reads /proc).
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from soak import resident  # noqa: E402

NOTES = 10  # lines of memory


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="cornell")
    parser.add_argument("--photons", type=int, default=1000)
    parser.add_argument("--moves", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--estimator", default="tangent_plane")
    parser.add_argument("--path", action="store_true", help="along the scene's path instead of anywhere")
    parser.add_argument("--malloc", action="store_true")
    parser.add_argument("--trace", action="store_true")
    options = parser.parse_args()
    from app.render_command import motion_paths
    from gi_core.pose import pose_at
    from gi_core.scene import Pose, load_scene
    from gi_core.solver import Solver

    solver = Solver(load_scene(options.scene), photons=options.photons, estimator=options.estimator)
    solver.solve()
    start, begun = dict(solver.poses), solver.irradiance.copy()
    low, high, rng = solver.chosen.low, solver.chosen.high, np.random.default_rng(options.seed)
    paths = motion_paths(solver)
    if options.trace:
        tracemalloc.start()
        first = tracemalloc.take_snapshot()
    clock, changed = time.perf_counter(), False
    for k in range(options.moves):
        if options.path:
            poses = {n: pose_at(p, p.times[0] + (k % 240) / 240 * np.ptp(p.times)) for n, p in paths.items()}
        else:
            q = rng.normal(size=4)
            q = tuple(q / np.sqrt((q * q).sum()))
            poses = {name: Pose(tuple(rng.uniform(low, high)), q) for name in start}
        solver.move_all(poses)
        changed |= not np.array_equal(solver.irradiance, begun)
        if (k + 1) % max(options.moves // NOTES, 1) == 0:
            print(f"{k + 1} moves, {time.perf_counter() - clock:.0f} s, {resident():.1f} MB", flush=True)
    scratch = np.array_equal(solver.irradiance, solver.from_scratch())
    solver.move_all(start)
    back = np.array_equal(solver.irradiance, begun)
    if options.trace:
        gc.collect()
        for line in tracemalloc.take_snapshot().compare_to(first, "lineno")[:6]:
            print(line)
    if options.malloc:
        gc.collect()
        before = resident()
        ctypes.CDLL(None).malloc_trim(0)
        print(f"{before:.1f} MB, {resident():.1f} MB after malloc_trim")
    print(f"light moved: {changed}; last frame as from scratch: {scratch}; back at the start: {back}")
    return int(not (changed and scratch and back))


if __name__ == "__main__":
    sys.exit(main())

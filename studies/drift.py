"""Many moves and a return to the start: `python -m studies.drift --scene cornell --photons 1000 --moves 100000`.

Prints moves, memory and ms per move every minute. Ctrl+C ends the moves early, and the light is still checked. Exit
code 1 if the light differs by a bit from the first frame or from a solution from scratch. `--trace` prints the growth
of Python's own allocations. Linux alone.
"""

from __future__ import annotations

import argparse
import gc
import signal
import sys
import threading
import time
import tracemalloc

import numpy as np

from tests.support.memory_use import memory_use, trim

FRAMES = 240  # of a path


def along(paths: dict, k: int) -> dict:
    """Return the k-th pose of each mobile on its repeated path."""
    from gi_core.scene.pose import pose_at

    return {n: pose_at(p, p.times[0] + (k % FRAMES) / FRAMES * np.ptp(p.times)) for n, p in paths.items()}


def anywhere(rng: np.random.Generator, low, high, names) -> dict:
    """Return a random position and rotation in the scene per mobile."""
    from gi_core.scene import Pose

    poses = {}
    for name in names:
        q = rng.normal(size=4)
        poses[name] = Pose(tuple(rng.uniform(low, high)), tuple(q / np.sqrt((q * q).sum())))
    return poses


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="cornell")
    parser.add_argument("--photons", type=int, default=1000)
    parser.add_argument("--moves", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--estimator", default="tangent_plane")
    parser.add_argument("--path", action="store_true", help="along the scene's path instead of anywhere")
    parser.add_argument("--every", type=float, default=60.0, help="seconds between lines")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--trace", action="store_true")
    options = parser.parse_args()
    from app.draw import motion
    from gi_core.files.load import load_scene
    from gi_core.solver import Solver

    kept = {"estimator": options.estimator, "threads": options.threads}
    solver = Solver(load_scene(options.scene), photons=options.photons, **kept)
    solver.solve()
    start, begun = dict(solver.poses), solver.irradiance.copy()
    low, high, rng = solver.chosen.low, solver.chosen.high, np.random.default_rng(options.seed)
    paths = motion.paths_of(solver)
    if options.trace:
        tracemalloc.start()
        first = tracemalloc.take_snapshot()
    stop = threading.Event()
    for what in (signal.SIGINT, signal.SIGTERM):  # ends after a whole move; the light is checked
        signal.signal(what, lambda *_: stop.set())
    clock, changed, noted = time.perf_counter(), False, (0.0, 0)
    print(f"0 moves, {memory_use()}", flush=True)
    for k in range(options.moves):
        if stop.is_set():
            break
        solver.move_all(along(paths, k) if options.path else anywhere(rng, low, high, start))
        changed |= not np.array_equal(solver.irradiance, begun)
        now = time.perf_counter() - clock
        if now - noted[0] >= options.every or k + 1 == options.moves:
            ms = 1e3 * (now - noted[0]) / (k + 1 - noted[1])
            print(f"{k + 1} moves, {now:.0f} s, {ms:.2f} ms a move, {memory_use()}", flush=True)
            noted = now, k + 1
    scratch = np.array_equal(solver.irradiance, solver.from_scratch())
    solver.move_all(start)
    back = np.array_equal(solver.irradiance, begun)
    if options.trace:
        gc.collect()
        for line in tracemalloc.take_snapshot().compare_to(first, "lineno")[:6]:
            print(line)
    gc.collect()
    print(f"at the end {memory_use()}", flush=True)
    trim()
    print(f"trimmed {memory_use()}")
    print(f"light moved: {changed}; last frame as from scratch: {scratch}; back at the start: {back}")
    return int(not (changed and scratch and back))


if __name__ == "__main__":
    sys.exit(main())

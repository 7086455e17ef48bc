"""Error of the light of a scene's mobiles, by photons and gathered, at the first poses.

    python -m studies.mobile_error cornell tree --photons 1048576 --noise 1.5 --seeds 8

Luminance error (l1, gi_core.geometry.error) of all receivers on mobiles, by area. The truth uses other paths until
its noise is `--noise` percent, which is subtracted in squares. *signed*: relative error of the sum. Gathered light is
the mean over seeds, with the variation between seeds and the remaining bias apart. CPU ms of one thread, the
least of three: of a whole frame, and of gathering alone after all mobiles have moved.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from itertools import count

import numpy as np

from gi_core.files.load import load_scene
from gi_core.frames.light_setting import PATHS
from gi_core.gather.mobile import MobileGather
from gi_core.gather.reference_sample import gather_sample
from gi_core.geometry.error import bias_left, luminance, relative_error
from gi_core.solver import Solver

STEPS = 3  # of which the fastest counts
TRUTH_SEED = 77  # of nothing else
FRAMES = (1 << 14, 1 << 16, 1 << 18)  # photons, besides all


def measured(call) -> tuple[object, float]:
    """Return the result of a call and its least CPU time of three [ms]."""
    best = float("inf")
    for _ in range(STEPS):
        started = time.process_time()
        found = call()
        best = min(best, time.process_time() - started)
    return found, 1e3 * best


def report(name: str, photons: int, wanted: float, seeds: int) -> None:
    """Print the table of a scene."""
    solver = Solver(load_scene(name), photons=photons, threads=1)
    solver.solve()
    model, receivers, gather = solver.model, solver.receivers, MobileGather(solver.model, solver.seed)
    rows = np.arange(gather.first, len(receivers.areas))
    w = receivers.areas[rows]
    *_, truth = gather_sample(model, solver.poses, rows, w, TRUTH_SEED, 1e-2 * wanted)
    noise = truth.noise
    light = float((w * luminance(truth.irradiance)).sum())

    def error(E: np.ndarray) -> float:
        return relative_error(E, truth.irradiance, w).l1

    def line(what: str, total: float, parts: str, E: np.ndarray, ms: float) -> None:
        signed = float((w * luminance(E)).sum()) / light - 1
        print(f"| {what} | {100 * total:.1f} % | {parts} | {100 * signed:+.1f} % | {ms:.1f} |", flush=True)

    print(f"{name}: {len(w):,} receivers on mobiles, noise of truth {100 * noise:.1f} %")

    for n in (*(n for n in FRAMES if n < photons), None):
        _, ms = measured(partial(solver.move_all, solver.poses, n))
        E = solver.irradiance[rows]
        line(f"{n or photons:,} photons", bias_left(error(E), noise), "", E, ms)
    at, static = model.transforms(solver.poses), solver.irradiance
    gathers = [gather, *(MobileGather(model, solver.seed + 1 + k) for k in range(seeds - 1))]
    steps, mobiles = count(1), np.arange(len(at.position))[:, None] > 0

    def moved(paths: int) -> None:
        """Gather after a small move of all mobiles, which makes most cached hits useless."""
        away = at.position + 1e-6 * next(steps) * model.world.size * mobiles
        gather.irradiance(at._replace(position=away), static, paths)

    for paths in PATHS:
        _, ms = measured(partial(moved, paths))
        found = [g.irradiance(at, static, paths) for g in gathers]
        mean, total = sum(found) / seeds, sum(bias_left(error(E), noise) for E in found) / seeds
        chance = sum(float((w * np.abs(luminance(E - mean))).sum()) for E in found) / seeds / light
        chance *= (seeds / max(seeds - 1, 1)) ** 0.5
        bias = bias_left(error(mean), noise, chance / seeds**0.5)
        parts = f"noise {100 * chance:.1f}, bias {100 * bias:.1f}" if seeds > 1 else ""
        line(f"{paths} paths", total, parts, mean, ms)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--photons", type=int, default=1 << 20)
    parser.add_argument("--noise", type=float, default=1.5, help="of the truth [%%]")
    parser.add_argument("--seeds", type=int, default=8, help="of the gathering")
    asked = parser.parse_args()
    for name in asked.scenes:
        report(name, asked.photons, asked.noise, asked.seeds)


if __name__ == "__main__":
    main()

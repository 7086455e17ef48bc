"""Stated against true error of gathered light: `python -m studies.stated_error room.glb --cpu 300`.

One line per picture of the static part without mobiles: CPU seconds since gathering began; the error that the window
states; the relative l1 error of luminance against whole paths of another seed at receivers drawn by area, whose noise
is subtracted in squares; the total of the light there over the truth's.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from gi_core.gather.reference_sample import draw_by_area, gather_sample
from studies.light_error import SAMPLE_SEED, TRUTH_SEED, static_solver


def measure(what: str, points: int, noise: float, cpu: float) -> None:
    solver = static_solver(what, light="best")
    solver.solve()
    areas = solver.receivers.areas
    rows, times = draw_by_area(np.flatnonzero(areas > 0), areas, points, SAMPLE_SEED)
    begun = time.process_time()
    *_, truth = gather_sample(solver.model, solver.poses, rows, times, TRUTH_SEED, noise)
    spent = time.process_time() - begun
    name = what.rpartition("/")[2]
    print(f"\n{name}: {solver.photons:,} photons")
    print(f"truth of {len(rows)} receivers: {100 * truth.noise:.1f} % noise, {spent:.0f} CPU s")
    print("\n| CPU s | light | stated | true | total |\n|---|---|---|---|---|", flush=True)
    begun = time.process_time()
    for progress in solver.gather_steps():
        spent, g = time.process_time() - begun, solver.frame_light.static.gathered
        if progress.picture:
            light = "whole paths" if g.state is not None and g.noise == g.state.noise(g.weights) else "single bounces"
            true, total = truth.error(solver.irradiance), truth.relative_total(solver.irradiance)
            print(
                f"| {spent:.0f} | {light} | {100 * g.estimate.error:.1f} % | {100 * true:.1f} % | {total:.3f} |",
                flush=True,
            )
        if spent > cpu:
            return


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--points", type=int, default=400, help="receivers of the truth")
    parser.add_argument("--noise", type=float, default=0.5, help="of the truth [%%]")
    parser.add_argument("--cpu", type=float, default=300.0, help="seconds of gathering per scene")
    asked = parser.parse_args()
    for scene in asked.scenes:
        measure(scene, asked.points, asked.noise / 100, asked.cpu)


if __name__ == "__main__":
    main()

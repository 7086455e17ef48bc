"""Error of light at rest where mobiles change it, while it is gathered: `python -m studies.pose_light SCENE ...`.

Static light is gathered to the end first; then the light at the scene's poses. Luminance errors (l1) against the
reference at POINTS receivers of each class, the reference's noise taken out in squares.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from gi_core.files.load import load_scene
from gi_core.gather.reference_sample import draw_by_area, gather_sample
from gi_core.geometry.receiver_classes import receiver_classes
from gi_core.solver import Solver

CLASSES = ("affected", "mobile")
POINTS, TRUTH, SEED = 400, 0.007, 99  # receivers per class; noise of the reference there


def study(name: str, photons: int | None, error: float, seconds: float) -> None:
    """Print a row per result; end after `seconds` CPU seconds."""
    solver = Solver(load_scene(name), photons=photons, light="best")
    solver.solve()
    for progress in solver.gather_steps():
        if (
            progress.picture
            and solver.frame_light.is_gathered
            and solver.frame_light.static.gathered.estimate.error <= error
        ):
            break
    background = np.zeros_like(solver.irradiance)
    background[: len(solver.static_irradiance)] = solver.static_irradiance
    kinds = receiver_classes(solver.surfaces, solver.receivers, solver.irradiance, background)
    samples = []
    for kind in CLASSES:
        rows = np.flatnonzero(kinds[kind] & (solver.receivers.areas > 0))
        drawn = draw_by_area(rows, solver.receivers.areas, POINTS, SEED)
        *_, sample = gather_sample(solver.model, solver.poses, *drawn, SEED, TRUTH)
        samples.append(sample)

    def row(at: str) -> None:
        errors = " | ".join(f"{100 * s.error(solver.irradiance):.2f}" for s in samples)
        print(f"| {name} | {at} | {errors} |", flush=True)

    row(f"static light, {100 * solver.frame_light.static.gathered.estimate.error:.2g} %")
    started = time.process_time()
    for progress in solver.gather_pose_steps():
        spent = time.process_time() - started
        if progress.picture:
            row(f"{spent:.0f} CPU s")
        if spent > seconds:
            break
    row(f"{time.process_time() - started:.0f} CPU s, end")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--photons", type=int, help="the scene's, if not given")
    parser.add_argument("--static-error", type=float, default=0.0, help="of static light, at which it is left")
    parser.add_argument("--seconds", type=float, default=120.0)
    options = parser.parse_args()
    print("| scene | light | affected (%) | mobile (%) |\n|---|---|---|---|")
    for name in options.scenes:
        study(name, options.photons, options.static_error, options.seconds)


if __name__ == "__main__":
    main()

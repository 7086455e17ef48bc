"""Noise of mobiles' light in frames with and without rays to bright faces, by paths, in a sunlit room or any scene.

    python -m studies.bright_faces --paths 8 16 24 48
    python -m studies.bright_faces living_room office --seconds 12

Error (l1, by area) of light gathered at the start poses, mean over seeds, per mobile. The truth is gathered from the
same static light by 4,096 paths, half of them with rays to bright faces. CPU ms of one thread, least of five moves.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from gi_core.files.load import load_scene
from gi_core.gather.mobile import MobileGather
from gi_core.geometry.error import luminance, relative_error
from gi_core.solver import Solver
from tests.support.scene_builders import sunny_room

PHOTONS, SEEDS, MOVES = 1 << 20, 8, 5
TRUTH_PATHS, TRUTHS = 512, 8


def report(name: str | None, paths: list[int], seconds: float) -> None:
    """Print the table of a scene, None: the sunlit room."""
    scene = sunny_room() if name is None else load_scene(name)
    solver = Solver(scene, photons=PHOTONS)
    solver.solve()
    until = time.perf_counter() + seconds
    for _ in solver.gather_steps():
        if time.perf_counter() > until:
            break
    model, b, areas = solver.model, solver.frame.background, solver.receivers.areas
    at, static, light = model.transforms(solver.poses), solver.irradiance, solver.frame_light
    rest = light.at_rest(b)
    given = rest.reflectance, model.lights_at(solver.levels)
    kinds = {"without": None, "with": rest.irradiance}
    truths = [
        MobileGather(model, 100 + k).irradiance(at, static, TRUTH_PATHS, *given, kinds["with" if k % 2 else "without"])
        for k in range(TRUTHS)
    ]
    T = np.mean(truths, axis=0)
    gathers = [MobileGather(model, seed) for seed in range(SEEDS)]
    first, w = gathers[0].first, areas[gathers[0].first :]
    sums = [sum(float(w @ luminance(E)) for E in truths[k::2]) for k in (1, 0)]
    print(f"{scene.name}: light with rays to bright faces over that without {sums[0] / sums[1]:.4f}")
    print("| paths | error without | with | ms without | with |\n|---|---|---|---|---|")
    model.threads = 1
    for n in paths:
        errors, ms = {}, {}
        for kind, resting in kinds.items():
            found = [g.irradiance(at, static, n, *given, resting) for g in gathers]
            errors[kind] = ", ".join(
                f"{100 * np.mean([relative_error(E[rows], T[rows], w[rows]).l1 for E in found]):.1f}"
                for rows in (_rows(model, o, first) for o in range(1, len(at.position)))
            )
            took = []
            for k in range(MOVES):
                moved = at.position.copy()
                moved[1:] += 1e-6 * (k + 1) * model.world.size
                started = time.process_time()
                gathers[0].irradiance(at._replace(position=moved), static, n, *given, resting)
                took.append(1e3 * (time.process_time() - started))
            ms[kind] = min(took)
        print(
            f"| {n} | {errors['without']} % | {errors['with']} % | {ms['without']:.1f} | {ms['with']:.1f} |", flush=True
        )


def _rows(model, o: int, first: int) -> slice:
    rows = model.surfaces.receiver_range(o)
    return slice(rows.start - first, rows.stop - first)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", help="none: the sunlit room")
    parser.add_argument("--paths", nargs="+", type=int, default=[8, 16, 24, 48])
    parser.add_argument("--seconds", type=float, default=10.0, help="of gathering static light")
    asked = parser.parse_args()
    for name in asked.scenes or [None]:
        report(name, asked.paths, asked.seconds)


if __name__ == "__main__":
    main()

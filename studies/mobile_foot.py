"""Worst vertices of mobiles at rest: `python -m studies.mobile_foot [SCENE ...] [--mobile FILE]`.

Best light at rest against the reference, at each vertex that a disc of 1 cm can see: three quarters of its
cosine-distributed directions are free for 1 cm, and it is not dark. The worst by few paths are measured again by more,
of another seed.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from gi_core.display.dilation import DIRECTIONS, directions
from gi_core.files.load import load_scene
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.rays.accelerator import nearest_in_world
from gi_core.solver import Solver

SCENES = ("cornell", "living_room", "gallery", "tree", "tree_worst", "second_tree")
BAR, REACH, LIFT = 0.15, 0.01, 1e-5  # relative error; [m]; [m]
FREE = 0.75  # of the directions
DARK = 0.02  # of the brightest tenth: less does not show
FIRST, AGAIN, MOST, DOUBTFUL = 128, 4096, 3000, 60  # paths, paths, vertices measured, vertices measured again


def seen(solver: Solver, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return which points (n,) bool a disc of radius REACH can see."""
    model, at = solver.model, solver.model.transforms(solver.poses)
    origins = np.repeat(points - model.origins[0] + LIFT * normals, DIRECTIONS, axis=0).astype(np.float32)
    limits = np.full(len(origins), REACH, np.float32)
    _, face = nearest_in_world(model.accelerator, at, origins, directions(normals).reshape(-1, 3), limits)
    return (face < 0).reshape(-1, DIRECTIONS).mean(axis=1) >= FREE


def study(name: str, mobiles: list[str], gather: bool, seconds: float) -> float:
    """Print the errors at the mobiles of a scene; return the largest."""
    solver = Solver(load_scene(name, mobiles=mobiles), light="best")
    solver.solve()
    for progress in solver.gather_steps() if gather else ():
        if progress.picture and solver.frame.gathered:
            break
    started = time.process_time()
    for _ in solver.gather_pose_steps() if gather else ():
        if time.process_time() - started > seconds:
            break
    first = solver.surfaces.receiver_range(0).stop
    points, normals = (a[first:] for a in evaluation_points(solver.surfaces, solver.receivers))
    lit = luminance(solver.irradiance[first:])
    bright = float(np.quantile(lit, 0.9))
    rows = np.flatnonzero(seen(solver, points, normals))
    rows = np.sort(np.random.default_rng(0).permutation(rows)[:MOST])

    def error(some: np.ndarray, paths: int, seed: int) -> np.ndarray:
        given = solver.scene, points[some], normals[some], paths, seed, solver.poses
        truth = luminance(reference_irradiance(*given, model=solver.model)[0])
        return np.where(truth > DARK * bright, lit[some] / np.maximum(truth, DARK * bright) - 1, 0.0)

    off = error(rows, FIRST, 1)
    worst = rows[np.argsort(-np.abs(off))[:DOUBTFUL]]
    again = error(worst, AGAIN, 2)
    up = np.asarray(solver.scene.up) / np.linalg.norm(solver.scene.up)
    heights = points @ up
    low = heights.min()
    print(
        f"{name} {' '.join(mobiles)}: {len(rows):,} vertices, mean |error| {100 * np.abs(off).mean():.1f} %, ", end=""
    )
    print(f"{(np.abs(again) > BAR).sum()} of the {len(worst)} worst beyond {100 * BAR:.0f} %")
    for k in np.argsort(-np.abs(again))[:5]:
        print(
            f"  {100 * again[k]:+.0f} % at {heights[worst[k]] - low:.3f} m, light {lit[worst[k]]:.4g} of {bright:.3g}"
        )
    return float(np.abs(again).max(initial=0.0))


def main() -> int:
    """Return 1 if a vertex is beyond the bar."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--mobile", action="append", default=[])
    parser.add_argument("--seconds", type=float, default=60.0, help="CPU time for light at the poses")
    parser.add_argument("--photons-only", action="store_true", help="static light of photons instead of gathered")
    options = parser.parse_args()
    return int(max(study(s, options.mobile, not options.photons_only, options.seconds) for s in options.scenes) > BAR)


if __name__ == "__main__":
    sys.exit(main())

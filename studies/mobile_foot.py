"""Vertices of mobiles that are far off at rest: `python -m studies.mobile_foot [SCENE ...] [--mobile FILE]`.

Best light at rest against the reference, at each vertex that a disc of 1 cm can see: three quarters of its
cosine-distributed directions are free for 1 cm, and it is not dark. Without scenes: all shipped ones. Paths are added
at a vertex until its error is below the bar by three standard errors of the reference, or above it and the reference's
noise is 4 %, or until MOST paths.
A row per state of the light: single bounces, then light at the poses after `--seconds` of CPU time, at its end or,
with `--each`, whenever it changes. The worst vertices follow with the standard errors of truth and light (0: not
known), and their heights.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import NamedTuple

import numpy as np

from gi_core.display.dilation import DIRECTIONS, directions
from gi_core.files.load import load_scene
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.rays.all_objects import nearest_in_world
from gi_core.solver import Solver

SCENES = ("cornell", "living_room", "gallery", "office", "tree", "tree_worst", "second_tree")
BAR, REACH, LIFT = 0.15, 0.01, 1e-5  # relative error; [m]; [m]
FREE = 0.75  # of the directions
DARK = 0.02  # of the brightest tenth: less does not show
FIRST, MOST = 256, 1 << 17  # paths per vertex
SURE, SMALL = 3.0, 0.04  # standard errors; relative noise of the reference, at which an error beyond the bar counts
SAMPLE = 4000  # vertices


class Truth:
    """Luminance of the reference at n points, with more paths where they are asked for."""

    def __init__(self, solver: Solver, points: np.ndarray, normals: np.ndarray):
        self._solver, self._points, self._normals = solver, points, normals
        n = len(points)
        self.paths, self._sum, self._squares = np.zeros(n, np.int64), np.zeros(n), np.zeros(n)
        self.grow(np.arange(n))

    @property
    def mean(self) -> np.ndarray:
        return self._sum / self.paths

    @property
    def error(self) -> np.ndarray:
        """Standard error."""
        return np.sqrt(self._squares) / self.paths

    def grow(self, rows: np.ndarray) -> None:
        """Trace as many paths again as there are, or the first."""
        for had in np.unique(self.paths[rows]):
            some, n = rows[self.paths[rows] == had], int(had) or FIRST
            given = self._solver.scene, self._points[some], self._normals[some], n, 1 + int(had)
            E, error = reference_irradiance(*given, self._solver.poses, model=self._solver.model)
            self._sum[some] += n * luminance(E)
            self._squares[some] += (n * luminance(error)) ** 2
            self.paths[some] += n


class Found(NamedTuple):
    """Errors of the light at n vertices."""

    error: np.ndarray  # relative to the reference; 0 at dark vertices
    sigma: np.ndarray  # of the reference, relative

    @property
    def beyond(self) -> np.ndarray:
        return np.abs(self.error) > BAR


def errors(lit: np.ndarray, truth: Truth, dark: float) -> Found:
    """Return the errors of luminance lit (n,); adds paths to the truth where it is not known on which side they are."""
    while True:
        T = np.maximum(truth.mean, 1e-300)
        found = Found(np.where(T > dark, lit / T - 1, 0.0), np.where(T > dark, truth.error / T * lit / T, 0.0))
        doubtful = np.abs(np.abs(found.error) - BAR) < SURE * found.sigma
        open_ = (doubtful | (found.beyond & (found.sigma > SMALL))) & (truth.paths < MOST)
        if not open_.any():
            return found
        truth.grow(np.flatnonzero(open_))


def seen(solver: Solver, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return which points (n,) bool a disc of radius REACH can see."""
    model, at = solver.model, solver.model.transforms(solver.poses)
    origins = np.repeat(points - model.origins[0] + LIFT * normals, DIRECTIONS, axis=0).astype(np.float32)
    limits = np.full(len(origins), REACH, np.float32)
    _, face = nearest_in_world(model.accelerator, at, origins, directions(normals).reshape(-1, 3), limits)
    return (face < 0).reshape(-1, DIRECTIONS).mean(axis=1) >= FREE


def study(name: str, mobiles: list[str], gather: bool, seconds: float, each: bool) -> int:
    """Print the errors at the mobiles of a scene; return how many vertices are beyond the bar at the end."""
    solver = Solver(load_scene(name, mobiles=mobiles), light="best")
    solver.solve()
    for progress in solver.gather_steps() if gather else ():
        if progress.picture and solver.frame_light.is_gathered:
            break
    first = solver.surfaces.receiver_range(0).stop
    points, normals = (a[first:] for a in evaluation_points(solver.surfaces, solver.receivers))
    rows = np.flatnonzero(seen(solver, points, normals))
    rows = np.sort(np.random.default_rng(0).permutation(rows)[:SAMPLE])
    truth = Truth(solver, points[rows], normals[rows])
    dark = DARK * float(np.quantile(truth.mean, 0.9))
    at = solver.model.transforms(solver.poses)
    up = np.asarray(solver.scene.up) / np.linalg.norm(solver.scene.up)
    heights = points @ up - (points @ up).min()
    what = " ".join([name, *(m.rpartition("/")[2] for m in mobiles)])
    print(f"\n{what}: {len(rows):,} vertices\n\n| light | beyond {BAR:.0%} | worst, height |\n|---|---|---|")

    def row(state: str) -> int:
        found = errors(luminance(solver.irradiance[first:])[rows], truth, dark)
        worst = np.argsort(-np.abs(found.error))[:5]
        stated = solver.frame_light.deviation(at, solver.frame.background)[first:][rows] / np.maximum(
            truth.mean, 1e-300
        )
        text = ", ".join(
            f"{found.error[k]:+.0%} +- {found.sigma[k]:.0%} +- {stated[k]:.0%} {heights[rows[k]]:.2f} m" for k in worst
        )
        print(f"| {state} | {found.beyond.sum()} | {text} |", flush=True)
        return int(found.beyond.sum())

    left, measuring, begun = row("single bounces"), 0.0, time.process_time()
    for progress in solver.gather_pose_steps() if gather else ():
        spent = time.process_time() - begun - measuring
        if each and progress.picture:
            left = row(f"{spent:.0f} CPU s")
            measuring = time.process_time() - begun - spent
        if spent > seconds:
            break
    return left if each else row(f"{spent:.0f} CPU s")


def main() -> int:
    """Return 1 if a vertex is beyond the bar."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--mobile", action="append", default=[])
    parser.add_argument("--seconds", type=float, default=60.0, help="CPU time for light at the poses")
    parser.add_argument("--each", action="store_true", help="a row per change of the light")
    parser.add_argument("--photons-only", action="store_true", help="static light of photons instead of gathered")
    options = parser.parse_args()
    how = not options.photons_only, options.seconds, options.each
    return int(sum(study(s, options.mobile, *how) for s in options.scenes) > 0)


if __name__ == "__main__":
    sys.exit(main())

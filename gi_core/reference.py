"""The unbiased answer: irradiance at points by gathering along random paths.

From each point a path bounces by the cosine until it leaves the scene or dies. At each vertex, point,
spot and directional lights are joined to it directly; emissive faces are found in two ways whose shares
add up to 1 (balance heuristic, Veach 1997): by joining a point sampled on them, and by hitting them. A
path that leaves sees the sky. Nothing here is shared with the photons but the surfaces, the accelerator
and the reflection model, and there is no bias: no radius, no limit to the number of bounces.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.accelerator import ORIGIN_LIFT
from gi_core.evaluation_points import evaluation_points
from gi_core.light_sampling import Lights, area_lights, sky_of, small_lights
from gi_core.model import Model
from gi_core.path_gather import gather
from gi_core.pose import as_pose
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Pose, Scene

__all__ = ["Estimate", "evaluation_points", "reference_irradiance", "reference_steps"]

BATCH = 1 << 17  # paths at once: some 40 MB, and embree wants 10k rays or more
STREAM = 0x9E1E  # keeps the reference's random numbers apart from those of photons with the same seed
PATHS_A_POINT = 1 << 32  # path k of point i is number i * this + k: it does not depend on how many there are


class Estimate(NamedTuple):
    """The running answer of reference_steps()."""

    paths: int  # a point, so far
    mean: np.ndarray  # (n, 3) float64 [W/m2]
    standard_error: np.ndarray  # (n, 3) float64 [W/m2], of the mean; inf after a single path


def reference_irradiance(
    scene: Scene,
    positions: np.ndarray,
    normals: np.ndarray,
    paths: int,
    seed: int,
    poses: Mapping[str, Pose | np.ndarray] | None = None,
    light_sampling: bool = True,
    model: Model | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return irradiance at points and its standard error, both (n, 3) float64 [W/m2].

    positions (n, 3) [m] and normals (n, 3) in the world; `paths` >= 1 a point; `poses` of mobiles, by
    name, that differ from the scene's own; `light_sampling` False finds emissive faces by hitting them
    only: the same answer, with more noise. `model` saves preparing the scene again. The result depends
    on seed and arguments alone. Points without a normal get 0. Raises SceneError for a bad pose,
    ValueError for bad points or paths.
    """
    *_, last = reference_steps(scene, positions, normals, paths, seed, poses, light_sampling, model)
    return last.mean, last.standard_error


def reference_steps(
    scene: Scene,
    positions: np.ndarray,
    normals: np.ndarray,
    paths: int,
    seed: int,
    poses: Mapping[str, Pose | np.ndarray] | None = None,
    light_sampling: bool = True,
    model: Model | None = None,
) -> Iterator[Estimate]:
    """As reference_irradiance(), yielding the running answer after each round over all points."""
    if not 1 <= int(paths) < PATHS_A_POINT:
        raise ValueError(f"paths must be a whole number >= 1, got {paths}")
    gatherer = Gatherer(scene, positions, normals, seed, poses, light_sampling, model)
    points, n = gatherer.lit, len(gatherer.positions)
    mean = np.zeros((n, 3))
    squares = np.zeros((n, 3))  # sum of squared differences from the mean (Chan, Golub, LeVeque 1979)
    done = 0
    while done < paths:
        more = int(min(paths - done, max(1, BATCH // max(len(points), 1))))
        for first in range(0, len(points), BATCH):
            rows = points[first : first + BATCH]
            values = gatherer.paths(rows, done, more)
            new = values.mean(axis=1)
            off = new - mean[rows]
            squares[rows] += ((values - new[:, None]) ** 2).sum(axis=1) + off * off * (done * more / (done + more))
            mean[rows] += off * (more / (done + more))
        done += more
        error = np.sqrt(squares / max(done - 1, 1) / done) if done > 1 else np.full((n, 3), np.inf)
        yield Estimate(done, mean.copy(), error)


class Gatherer:
    """Points of a scene, ready to be gathered at: what the paths of any of them bring."""

    def __init__(
        self, scene: Scene, positions, normals, seed: int, poses=None, light_sampling=True, model=None, mobiles=True
    ):
        """Arguments are those of reference_irradiance(); `mobiles` False leaves those out. Raises as it does."""
        positions, normals = _checked(positions, normals)
        self.model = model or Model(scene)
        self._at = self.model.transforms(_poses(self.model, poses)) if mobiles else self.model.static
        self._lights = Lights(area_lights(self.model.surfaces), small_lights(scene), sky_of(scene))
        self._seed = (int(seed) ^ (STREAM << 40)) & (2**63 - 1)
        self._light_sampling = light_sampling
        length = np.sqrt((normals * normals).sum(axis=1))
        self.lit = np.flatnonzero(length > 0)  # points that have a normal
        self._normals = normals / np.where(length > 0, length, 1)[:, None]
        self.positions = positions + ORIGIN_LIFT * self.model.world.size * self._normals

    def paths(self, rows: np.ndarray, first: int, count: int, m: int = 0, stream: int = 0) -> np.ndarray:
        """Return what paths first .. first + count - 1 of some points bring, (rows, count, 3) float64 [W/m2].

        In sets of 2^m, see strata.py; `stream` picks other paths of the same numbers.
        """
        path = (rows[:, None] * PATHS_A_POINT + first + np.arange(count)).reshape(-1)
        start = (np.repeat(a[rows], count, axis=0) for a in (self.positions, self._normals))
        seed = self._seed ^ (stream << 24)
        values = gather(self.model, self._at, self._lights, seed, path, *start, self._light_sampling, m)
        values = values.reshape(len(rows), count, 3)
        if len(self.lit) < len(self.positions):
            values[~np.isin(rows, self.lit)] = 0.0
        return values


def _checked(positions, normals) -> tuple[np.ndarray, np.ndarray]:
    positions, normals = np.asarray(positions, np.float64), np.asarray(normals, np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3 or normals.shape != positions.shape:
        raise ValueError(
            f"positions and normals must both have shape (n, 3), got {positions.shape} and {normals.shape}"
        )
    if not (np.isfinite(positions).all() and np.isfinite(normals).all()):
        raise ValueError("positions and normals must be finite")
    return positions, normals


def _poses(model: Model, poses) -> dict[str, Pose]:
    out = model.start_poses()
    for name, pose in (poses or {}).items():
        if name not in out:
            have = ", ".join(f'"{n}"' for n in out) or "none"
            raise SceneError(f'{model.scene.name}: no mobile is called "{name}"; there is {have}')
        out[name] = as_pose(pose, f'{model.scene.name}: mobile "{name}"')
    return out

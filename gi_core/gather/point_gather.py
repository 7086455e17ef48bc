"""Unbiased path tracing at points: the paths of the reference.

A path bounces from its point, cosine-distributed, until it leaves the scene or Russian roulette ends it. Each vertex
samples delta lights and area lights; emissive faces that bounces hit count with the weight of the balance heuristic
(Veach 1997). A path that leaves the scene receives the sky. There is no radius and no limit on bounces, so no bias.
Photons share only the surfaces, the accelerator and the reflection model.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.random_numbers import Stream, seed_of
from gi_core.gather.path_tracer import gather
from gi_core.lights.lamps import sum_of_lamps
from gi_core.lights.next_event import least_set
from gi_core.model import Model
from gi_core.scene.types import Scene

PATHS_PER_POINT = 1 << 32  # path k of point i has number i * PATHS_PER_POINT + k, for any number of paths


class Gatherer:
    """Points of a scene, prepared for path tracing."""

    def __init__(
        self, scene: Scene, positions, normals, seed: int, poses=None, light_sampling=True, model=None, mobiles=True,
        levels=None, per_lamp=False, lights=None,
    ):  # fmt: skip
        """Arguments and errors are those of ReferenceRounds."""
        positions, normals = _checked(positions, normals)
        self.model = model or Model(scene)
        moved = {**self.model.start_poses(), **self.model.checked_poses(poses or {})}
        self._at = self.model.transforms(moved) if mobiles else self.model.static
        lamps = self.model.emitters.lamps
        self.per_lamp = per_lamp and lamps.count > 1
        levels = lamps.full() if levels is None else levels
        self._lights = self.model.lights if self.per_lamp else lights or self.model.lights_at(levels)
        self._seed = seed_of(Stream.REFERENCE, seed)
        self.least_set = least_set(self._lights.delta)
        self._light_sampling = light_sampling
        if not light_sampling and (self._lights.area.table >= 0).any():
            raise ValueError(f"{scene.name}: no path hits a luminaire, so light_sampling must be True")
        length = np.sqrt((normals * normals).sum(axis=1))
        self.lit = np.flatnonzero(length > 0)  # points with a normal
        self._normals = normals / np.where(length > 0, length, 1)[:, None]
        self.positions = positions - self.model.origins[0]
        self._lift = self.model.lifts_at(self._at, self.positions, self._normals)

    def paths(self, rows: np.ndarray, first: int, count: int, m: int = 0, stream: int = 0) -> np.ndarray:
        """Return the estimates of paths first .. first + count - 1 of points `rows`, (rows, count, 3) float64 [W/m2].

        per_lamp: light per lamp follows, in 3 G more columns.
        Paths come in sets of 2^m, see random_numbers.py; stream: a `Stream` of independent paths.
        """
        path = (rows[:, None] * PATHS_PER_POINT + first + np.arange(count)).reshape(-1)
        *start, lift = (np.repeat(a[rows], count, axis=0) for a in (self.positions, self._normals, self._lift))
        seed = seed_of(stream, self._seed)
        values = gather(self.model, self._at, self._lights, seed, path, *start, self._light_sampling, m, lift=lift)
        if self.per_lamp:
            values = np.concatenate([sum_of_lamps(values), values], axis=1)
        values = values.reshape(len(rows), count, -1)
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

"""Pilot trace: a few photons through the static part, apart from those of a solution, tell where light is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.geometry.receivers import NONE
from gi_core.lights.emission import Emitters
from gi_core.photons.paths import PathStore, PathVertices
from gi_core.photons.trace import trace_background
from gi_core.rays.accelerator import Accelerator, Transforms
from gi_core.rays.two_level import World

PHOTONS, PART = 4096, 64  # and photons per part
ENOUGH_VERTICES = 1 << 20  # end the pilot: paths in white rooms are long
SEED = 0x5EED  # never a seed of the solution: the pilot must be independent of it


class Pilot(NamedTuple):
    """Paths of a pilot trace, and their hits."""

    photons: int
    paths: PathVertices
    hits: np.ndarray  # (n, 3) float64 [m]
    side: np.ndarray  # (n,) int32, 2 face + side, 1: the back
    normals: np.ndarray  # (n, 3) float64 unit, of the side that was hit

    @property
    def first(self) -> np.ndarray:
        """Side that each photon hits first, (photons,) int32, NONE: nothing."""
        return self.paths.side[self.paths.offsets[:-1] + 1]


def pilot(accelerator: Accelerator, world: World, static: Transforms, emitters: Emitters) -> Pilot:
    """Trace a pilot; without lights it has photons and no hits."""
    store = PathStore()
    while store.photons < PHOTONS and len(store.subset(store.photons).side) < ENOUGH_VERTICES:
        store.append([trace_background(accelerator, world, static, emitters, SEED, store.photons, PART)[0]], 1)
    paths = store.subset(store.photons)
    if not len(emitters.kind):
        return Pilot(PHOTONS, paths, np.zeros((0, 3)), np.zeros(0, np.int32), np.zeros((0, 3)))
    return pilot_of(paths, world)


def pilot_of(paths: PathVertices, world: World) -> Pilot:
    """Return the pilot of these paths."""
    arrived = paths.side != NONE
    arrived[paths.offsets[:-1]] = False  # the first vertex of a path is on the light
    side = paths.side[arrived]
    normals = world.normals[side >> 1] * np.where(side & 1, -1.0, 1.0)[:, None]
    return Pilot(len(paths.offsets) - 1, paths, paths.position[arrived].astype(np.float64), side, normals)

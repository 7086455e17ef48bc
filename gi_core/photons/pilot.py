"""Pilot trace: a few photons through the static part, apart from those of a solution, tell where light is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import box, central_box
from gi_core.geometry.receivers import NONE
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights.emission import Emitters
from gi_core.photons.paths import PathStore, PathVertices
from gi_core.photons.trace import trace_background
from gi_core.rays.accelerator import Accelerator, Transforms
from gi_core.rays.all_objects import World

PHOTONS = 4096
FEWEST_HITS = 100  # that say where light is


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


class LitPart(NamedTuple):
    """Hits of a pilot on surfaces that are no lamps, and the box of the central ones; a sky may be a mesh."""

    low: np.ndarray  # (3,) [m]
    high: np.ndarray
    hits: np.ndarray  # (n, 3) float64 [m]
    normals: np.ndarray  # (n, 3) float64 unit, of the side that was hit


def lit_part(pilot: Pilot, s: Surfaces) -> LitPart:
    """Return the lit part of the static part. If hits are few, the box is that of all such surfaces, else of all."""
    dark = s.emission.max(axis=1, initial=0.0) == 0
    rows = dark[pilot.side >> 1]
    hits = pilot.hits[rows]
    if len(hits) >= FEWEST_HITS:
        return LitPart(*central_box(hits), hits, pilot.normals[rows])
    points = s.vertices[0][s.faces[0][dark[s.face_range(0)]]].reshape(-1, 3)
    points = points if len(points) else s.vertices[0]
    low, high = box(points) if len(points) else (np.zeros(3), np.ones(3))
    return LitPart(low, high, hits, pilot.normals[rows])


def pilot(accelerator: Accelerator, world: World, static: Transforms, emitters: Emitters) -> Pilot:
    """Trace a pilot; without lights it has photons and no hits."""
    store = PathStore()
    # Paths in white rooms are long.
    while store.photons < PHOTONS and len(store.subset(store.photons).side) < (1 << 20):
        # A solution never has this seed, so that the pilot is independent of it.
        store.append([trace_background(accelerator, world, static, emitters, 0x5EED, store.photons, 64)[0]], 1)
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

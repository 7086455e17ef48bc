"""Paths of the reference, traced by other processes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from app.cli.cluster import Machines
from app.rest.reference_store import ReferenceStore
from gi_core.gather.point_gather import Gatherer
from gi_core.gather.reference_sample import Reached
from gi_core.model import Model
from gi_core.scene import Pose, Scene

PATHS_PER_TASK = 1 << 16  # a quarter of a second
TASKS = 8  # per process and step of the reference


class PathJob(NamedTuple):
    """Data that all paths share."""

    scene: Scene
    rays: str | None
    positions: np.ndarray  # (n, 3) [m]
    normals: np.ndarray  # (n, 3)
    seed: int
    poses: Mapping[str, Pose]
    levels: np.ndarray  # (G, 3), of the lamps


def gather(
    store: ReferenceStore, error: float, machines: Machines | None, scene: Scene, rays: str | None
) -> Iterator[Reached]:
    """Gather as ReferenceStore.gather() does, here or, with machines, by other processes; the same bits.

    scene, rays: those of the store's model, as they were given to it.
    """
    if machines is None:
        return store.gather(error)
    return store.gather(error, SpreadPaths(machines, store, scene, rays), TASKS * PATHS_PER_TASK * machines.processes)


class SpreadPaths:
    """Replaces `Gatherer.paths` of a reference."""

    def __init__(self, machines: Machines, store: ReferenceStore, scene: Scene, rays: str | None) -> None:
        job = PathJob(scene, rays, store.positions, store.normals, store.seed, store.poses, store.levels)
        self._crew = machines.crew(_ready, job)

    def __call__(self, rows: np.ndarray, first: int, count: int, m: int = 0, stream: int = 0) -> np.ndarray:
        """Return estimates (rows, count, channels) as `Gatherer.paths` does, bit for bit."""
        size = max(PATHS_PER_TASK // count, 1)
        tasks = [(rows[k : k + size], first, count, m, stream) for k in range(0, len(rows), size)]
        return np.concatenate(list(self._crew.map(Gatherer.paths, tasks)))


def _ready(job: PathJob, threads: int | None) -> Gatherer:
    model = Model(job.scene, threads, job.rays)
    return Gatherer(job.scene, job.positions, job.normals, job.seed, job.poses, model=model, levels=job.levels)

"""A first look: light of a few paths per receiver, smoothed along surfaces, from few kernels."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.display.dilation import Dilation, Drawn, dilated
from gi_core.gather.denoise import denoise
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.geometry.mesh_neighbours import neighbours
from gi_core.model import Model
from gi_core.scene.types import Pose, Scene

PATHS = 1 << 18, 1 << 20  # in all: one and four seconds of a core
LEAST, MOST = 4, 64  # paths per receiver
ROUGH = 0.3  # relative l1 noise of the first photons, above which a first look is drawn in their place ...
FINE = 0.12  # ... until they have so much; a look has 7 to 23 % error in such scenes


class EarlyPicture(NamedTuple):
    """Light to be drawn while photons are few."""

    drawn: Drawn
    photons: int  # from which theirs is better
    poses: Mapping[str, Pose]  # to which it belongs
    levels: np.ndarray  # (G, 3), of the lamps

    def is_better(self, photons: int, poses: Mapping[str, Pose], levels: np.ndarray) -> bool:
        """Return whether it is better than light of so many photons, at these poses and levels."""
        return photons < self.photons and poses == self.poses and np.array_equal(levels, self.levels)


def early_picture(
    scene: Scene, model: Model, levels: np.ndarray, seed: int, grain: float, first: int
) -> EarlyPicture | None:
    """Return light for the first pictures, None where photons are good enough.

    grain: relative noise of the photons' light times the root of their number; first: photons of the first picture.
    """
    if grain <= ROUGH * math.sqrt(first):
        return None
    drawn = next(first_looks(scene, model, levels, seed))
    return EarlyPicture(drawn, round((grain / FINE) ** 2), model.start_poses(), levels.copy())


def first_looks(scene: Scene, model: Model, levels: np.ndarray, seed: int) -> Iterator[Drawn]:
    """Yield irradiance (R, 3) [W/m2] at the start poses, for pictures, from few paths and then from more.

    levels (G, 3): of the lamps.
    """
    at = model.transforms(model.start_poses())
    points, normals = evaluation_points(model.surfaces, model.receivers_at(model.start_poses()))
    near = neighbours(np.concatenate([model.corners(o) for o in range(model.surfaces.objects)]), len(points))
    dilation, static = Dilation(model, model.world.size), model.surfaces.receiver_range(0).stop
    for total in PATHS:
        paths = min(max(total // max(len(points), 1), LEAST), MOST)
        E, error = reference_irradiance(scene, points, normals, paths, seed, model=model, levels=levels)
        E = _last(denoise(E, error, near, seed, model.threads)).irradiance
        yield dilated(E, _last(dilation.find_static(E[:static])), dilation.find_moved(E, at))


def _last(steps: Generator):
    """Run a generator to its end; return its result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value

"""A first look: light of a few paths per receiver, smoothed along surfaces, from few kernels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gi_core.display.dilation import Dilation, Drawn, dilated
from gi_core.gather.denoise import averaged, denoise
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance, relative_noise
from gi_core.geometry.surfaces import evaluation_points
from gi_core.model import Model
from gi_core.scene.types import Scene


def first_looks(
    scene: Scene, model: Model, levels: np.ndarray, size: float, seed: int
) -> Iterator[tuple[Drawn, float]]:
    """Yield irradiance (R, 3) [W/m2] at the start poses, for pictures, from few paths and then from more.

    With it comes the noise that smoothing has left, relative l1; nan without light.

    levels (G, 3): of the lamps; size [m]: of the scene.
    """
    at = model.transforms(model.start_poses())
    points, normals = evaluation_points(model.surfaces, model.receivers_at(model.start_poses()))
    areas = model.object_receivers.areas
    dilation, static = Dilation(model, size), model.surfaces.receiver_range(0).stop
    for total in (1 << 18, 1 << 20):  # paths in all: one and four seconds of a core
        paths = min(max(total // max(len(points), 1), 4), 64)
        light = reference_irradiance(scene, points, normals, paths, seed, model=model, levels=levels)
        missed = ~light[0].any(axis=1)  # by all paths: they take the mean of neighbours, else they are black flecks
        for values in light:
            values[missed] = averaged(model.adjacency, values, np.ones(len(values), bool), model.threads)[missed]
        E, error = light
        denoised = denoise(E, error, model.adjacency, seed, model.threads, alike=areas)
        noise, E = denoised.share(areas) * relative_noise(luminance(error), E, areas), denoised.irradiance
        yield dilated(E, dilation.find_static(E[:static]), dilation.find_moved(E, at)), noise

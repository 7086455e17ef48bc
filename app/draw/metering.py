"""Light meter: exposure of a view, from the radiance of the receivers in it.

The first picture is noisy, and the median of noisy values is too low. Patch means replace single values, otherwise
every scene would come out too bright.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from app.draw.camera import Turntable
from app.draw.tonemap import meter, view_weights
from app.draw.vertex_colours import mean_radiance
from gi_core.geometry.error import luminance

if TYPE_CHECKING:
    from app.draw.draw_mesh import DrawMesh
    from gi_core.geometry.receivers import Receivers


def metered(
    receivers: Receivers,
    meshes: Sequence[DrawMesh],
    colours: Callable[[int], tuple[np.ndarray, np.ndarray]],
    gloss: Sequence[tuple[np.ndarray, np.ndarray] | None],
    textured: bool,
    size: float,
    camera: Turntable,
) -> float:
    """Return the exposure [EV] that maps the median radiance in view, else of all surfaces, to mid-grey.

    colours(o): linear radiance of front and back (D, 3) of mesh o; gloss: the same above textures, per mesh; textured:
    colours are to be averaged over textures; size [m]: of the scene.
    """
    radiance = np.zeros_like(receivers.positions)
    drawn = np.zeros(len(radiance), bool)
    for o, mesh in enumerate(meshes):
        front, back = colours(o)
        if textured:
            front, back = mean_radiance(mesh, front, back)
        if (above := gloss[o]) is not None:
            front, back = front + above[0], back + above[1]
        both = mesh.back >= 0
        # A surface that emits most of its radiance is a lamp or a screen.
        shines = luminance(mesh.emission) > 0.5 * luminance(front)
        for rows, colour, counts in ((mesh.front, front, ~shines), (mesh.back[both], back[both], True)):
            radiance[rows] = colour
            drawn[rows] = counts
    eye = camera.as_camera()
    areas = np.where(drawn, receivers.areas, 0.0)  # probes are not surfaces
    weights = view_weights(
        receivers.positions, receivers.normals, areas, eye.position, eye.target, eye.vertical_fov_degrees
    )
    weights = weights if weights.sum() > 0 else areas
    # 0.1 of the scene size
    return meter(*_patches(receivers.positions, receivers.normals, radiance, weights, 0.1 * size))


def _patches(positions, normals, radiance, weights, size) -> tuple[np.ndarray, np.ndarray]:
    """Return mean radiance (n, 3) and weight (n,) per grid cell and axis direction of the normal."""
    seen = weights > 0
    w = weights[seen]
    if not len(w):
        return np.zeros((0, 3)), np.zeros(0)
    axis = np.abs(normals[seen]).argmax(axis=1)
    facing = 2 * axis + (np.take_along_axis(normals[seen], axis[:, None], axis=1)[:, 0] > 0)
    cell = np.floor(positions[seen] / max(size, 1e-30)).astype(np.int64)
    patch = np.unique(np.c_[cell, facing], axis=0, return_inverse=True)[1].reshape(-1)
    weight = np.bincount(patch, w)
    mean = np.stack([np.bincount(patch, w * radiance[seen, k]) / weight for k in range(3)], axis=1)
    return mean, weight

"""Origins of meshes far from the origin of their coordinates, such as survey data.

float32 geometry keeps its digits near the origin alone, so meshes are shifted there. Scenes, poses and receivers stay
in the coordinates of the file.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.scene.types import Mesh, PlacedLight, Scene


def origin_of(mesh: Mesh) -> np.ndarray:
    """Return a point (3,) float64 [m] near a mesh that lies far from the origin, else zeros.

    Its coordinates are multiples of a power of two, so subtracting it from the vertices is exact.
    """
    corners = mesh.faces.reshape(-1)
    used = mesh.vertices[corners[:: max(len(corners) // 100_000, 1)]]
    if not len(used):
        return np.zeros(3)
    middle = np.median(used, axis=0)  # a stray vertex at the file's origin does not move it
    size, farthest = 2 * float(np.quantile(np.abs(used - middle).max(axis=1), 0.9)), float(np.abs(middle).max())
    if not farthest > 8 * size:  # up to 8 mesh sizes from the origin nothing is shifted
        return np.zeros(3)
    step = max(2.0 ** np.floor(np.log2(size)) if size > 0 else 0.0, float(np.spacing(farthest)))
    return step * np.rint(middle / step)


def translated(scene: Scene, by: np.ndarray) -> Scene:
    """Return a scene with all its places moved by (3,) [m]; the same one for zeros."""
    if not np.any(by):
        return scene

    def moved(place) -> tuple[float, float, float]:
        x, y, z = np.add(place, by)
        return float(x), float(y), float(z)

    camera = scene.camera
    if camera is not None:
        camera = camera._replace(position=moved(camera.position), target=moved(camera.target))
    mobiles = [m._replace(pose=m.pose._replace(position=moved(m.pose.position))) for m in scene.mobiles]
    return replace(
        scene,
        static=scene.static._replace(vertices=scene.static.vertices + by),
        mobiles=tuple(m._replace(path=m.path and m.path._replace(positions=m.path.positions + by)) for m in mobiles),
        lights=tuple(
            light._replace(position=moved(light.position)) if isinstance(light, PlacedLight) else light
            for light in scene.lights
        ),
        probes=tuple(p._replace(position=moved(p.position)) for p in scene.probes),
        camera=camera,
    )

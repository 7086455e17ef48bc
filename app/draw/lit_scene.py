"""A lit scene: the draw meshes at poses of the mobiles with the light on show, and the exposure that suits them.

The light meter reads the radiance of the receivers in view. The first picture is noisy, and the median of noisy values
is too low. Patch means replace single values, otherwise every scene would come out too bright.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.draw.camera import Turntable
from app.draw.draw_mesh import DrawMesh
from app.draw.tonemap import meter, view_weights
from app.draw.vertex_colours import Gloss, colours, gloss_towards, mean_radiance, weights
from gi_core.display.dilation import Drawn
from gi_core.geometry.error import luminance
from gi_core.gloss.light import GlossLight
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.scene import Pose
from gi_core.scene.types import RADIOMETRIC, Units


@dataclass(frozen=True, eq=False)
class LitScene:
    """Draw meshes at poses, and their light."""

    model: Model
    poses: Mapping[str, Pose]
    levels: np.ndarray  # (G, 3), of the lamps
    meshes: tuple[DrawMesh, ...]  # the static part first; lamps emit at the levels
    drawn: Drawn  # irradiance (R, 3) [W/m2] and interpolation weights
    gloss: GlossLight | None = None  # the light by direction; None: there is no gloss
    shows_radiance: bool = True  # else irradiance / pi, as on white surfaces
    units: Units = RADIOMETRIC
    deviation: np.ndarray | None = None  # (R,) [W/m2], standard error of the luminance, nan where unknown

    @cached_property
    def at(self) -> Transforms:
        """Rotation and position per object."""
        return self.model.transforms(self.poses)

    @cached_property
    def sides(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Linear radiance (D, 3) float32 of front and back per object, without gloss."""
        return [colours(mesh, self.drawn.irradiance, self.shows_radiance) for mesh in self.meshes]

    @cached_property
    def weights(self) -> list[np.ndarray | None]:
        """Interpolation weights (D, 2) of front and back per object; None: all 1."""
        return [weights(mesh, self.drawn.weights) for mesh in self.meshes]

    def gloss_towards(self, eye: np.ndarray, other: Gloss | None = None) -> Gloss:
        """Return the radiance that gloss sends to an eye (3,); other: as for vertex_colours.gloss_towards()."""
        light = self.gloss if self.shows_radiance else None
        return gloss_towards(self.meshes, light, self.drawn.irradiance, self.at, eye, other)


def metered(lit: LitScene, camera: Turntable, size: float) -> float:
    """Return the exposure [EV] that maps the median radiance in view, else of all surfaces, to mid-grey.

    size [m]: of the scene.
    """
    receivers = lit.model.receivers_at(lit.poses)
    gloss = lit.gloss_towards(camera.relative_to(lit.model.origins[0]).eye())
    radiance = np.zeros_like(receivers.positions)
    drawn = np.zeros(len(radiance), bool)
    for mesh, (front, back), above in zip(lit.meshes, lit.sides, gloss, strict=True):
        if lit.shows_radiance:
            front, back = mean_radiance(mesh, front, back)
        if above is not None:
            front, back = front + above[0], back + above[1]
        both = mesh.back >= 0
        # A surface that emits most of its radiance is a lamp or a screen.
        shines = luminance(mesh.emission) > 0.5 * luminance(front)
        opaque = np.ones(len(both), bool) if mesh.pane is None else mesh.pane[:, 3] == 0
        of_back = mesh.back[both], back[both], opaque[both]
        for rows, colour, counts in ((mesh.front, front, opaque & ~shines), of_back):
            radiance[rows] = colour
            drawn[rows] = counts
    eye = camera.as_camera()
    areas = np.where(drawn, receivers.areas, 0.0)  # probes are not surfaces
    places = receivers.positions, receivers.normals
    seen = view_weights(*places, areas, eye.position, eye.target, eye.vertical_fov_degrees)
    # 0.1 of the scene size
    return meter(*_patches(*places, radiance, seen if seen.sum() > 0 else areas, 0.1 * size))


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

"""Faces of luminaires: rectangles that radiate, and that no path of light hits. Pictures show them all the same.

Each side shows its mean luminance, L = Phi / (pi A), with the flux that leaves on that side. Sharp gloss shows
luminaires as highlights instead (`bare_lights.py`), so reflections leave the faces out.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.draw.draw_mesh import DrawMesh
from gi_core.lights.photometric import axes, share_ahead
from gi_core.scene.types import PhotometricLight

if TYPE_CHECKING:
    from app.draw.visible import PictureScene, Strip
    from gi_core.model import Model


class LightFaces(NamedTuple):
    """Bright sides of the rectangles of luminaires, in the space of the model."""

    corners: np.ndarray  # (k, 4, 3) float64 [m], counterclockwise seen from the bright side
    radiance: np.ndarray  # (k, 3) float64 [W/m2/sr]

    @property
    def mesh(self) -> DrawMesh:
        """Two one-sided triangles per face."""
        count, n = len(self.corners), 4 * len(self.corners)
        triangles = 4 * np.arange(count)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
        places, black = self.corners.reshape(-1, 3).astype(np.float32), np.zeros((n, 3), np.float32)
        receiver = np.zeros(n, np.int32)
        bright = np.repeat(self.radiance, 4, axis=0)
        return DrawMesh(places, triangles.reshape(-1, 3).astype(np.int32), receiver, receiver - 1, black, bright)

    def seen(self, strip: Strip, world: PictureScene) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays (m,) of a strip that see a face, and the radiance (m, 3) of it."""
        hit = np.flatnonzero(strip.face >= 0)
        face, u, v, d = strip.seen(hit)
        shares = np.stack([1 - u - v, u, v], axis=1)[:, :, None]
        nearest = np.full(len(strip.face), np.inf)
        nearest[hit] = (((world.corners[face] * shares).sum(axis=1) - strip.eye) * d).sum(axis=1)
        # 1e-5 of the surface's coordinates: a face so little behind it is seen
        nearest[hit] += 1e-5 * np.abs(world.corners[face]).max(axis=(1, 2), initial=0.0)
        which = np.full(len(strip.face), -1)
        for k, (a, b, _, c) in enumerate(self.corners):
            normal, way = np.cross(b - a, c - a), a - strip.eye
            towards = strip.directions @ normal
            distance = np.divide(way @ normal, towards, out=np.full(len(towards), np.inf), where=towards < 0)
            near = np.flatnonzero((distance > 0) & (distance < nearest))
            at = strip.directions[near] * distance[near, None] - way
            x, y = (at @ side / (side @ side) for side in (b - a, c - a))
            inside = near[(x >= 0) & (x <= 1) & (y >= 0) & (y <= 1)]
            nearest[inside], which[inside] = distance[inside], k
        rays = np.flatnonzero(which >= 0)
        return rays, self.radiance[which[rays]]


def light_faces(model: Model, levels: np.ndarray) -> LightFaces:
    """Return the bright faces of a model's luminaires at levels (G, 3) of the lamps."""
    corners, radiance = [np.zeros((0, 4, 3))], [np.zeros((0, 3))]
    lamps = model.emitters.lamps.sources
    for light in model.scene.lights:
        if not isinstance(light, PhotometricLight) or min(light.size) <= 0:
            continue
        axis, c0 = axes(light)
        a, b = 0.5 * light.size[0] * c0, 0.5 * light.size[1] * np.cross(axis, c0)
        around = np.array(light.position) + np.stack([-a - b, a - b, a + b, b - a])
        ahead = share_ahead(light)
        flux = np.array(light.flux) * levels[lamps.get(light.name, 0)]
        for share, places in ((ahead, around), (1 - ahead, around[::-1])):
            if share > 1e-3 and flux.any():  # 1e-3 of the flux makes a side bright
                corners.append(places[None])
                radiance.append((share * flux / (math.pi * light.size[0] * light.size[1]))[None])
    return LightFaces(np.concatenate(corners), np.concatenate(radiance))

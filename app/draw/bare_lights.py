"""Lights without a surface of the scene: highlights of them in sharp gloss, faces of luminaires, and the sky.

Faces of luminaires are rectangles that radiate, and that no path of light hits. Each side shows its mean luminance,
L = Phi / (pi A), with the flux that leaves on that side. Sharp gloss shows luminaires as highlights instead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from app.draw.draw_mesh import DrawMesh
from app.draw.lit_scene import LitScene
from app.draw.visible import PictureScene, Strip
from gi_core.geometry.error import luminance
from gi_core.gloss.lobe_rays import arriving, unoccluded, without_surface
from gi_core.lights.lamps import DeltaLights
from gi_core.lights.photometric import axes, share_ahead
from gi_core.lights.sky import Sky
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.scene.types import PhotometricLight

NO_SKY = Sky(np.zeros(3), np.zeros(3), 0, np.zeros(3), np.zeros(3), np.ones((1, 1, 3)))


class LightFaces(NamedTuple):
    """Bright sides of the rectangles of luminaires, in the space of the model, and the sky."""

    corners: np.ndarray  # (k, 4, 3) float64 [m], counterclockwise seen from the bright side
    radiance: np.ndarray  # (k, 3) float64 [W/m2/sr]
    sky: Sky = NO_SKY

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

    def open_to_sky(self, strip: Strip) -> np.ndarray:
        """Return the rays (m,) of a strip that see the sky."""
        return np.flatnonzero((strip.face < 0) & (strip.directions @ self.sky.up > 0) & self.sky.radiance.any())


def light_faces(model: Model, levels: np.ndarray) -> LightFaces:
    """Return the bright faces of a model's luminaires, and its sky, at levels (G, 3) of the lamps."""
    corners, radiance, sky = [np.zeros((0, 4, 3))], [np.zeros((0, 3))], model.lights_at(levels).sky
    lamps = model.emitters.lamps.sources
    for light in model.scene.lights:
        if not isinstance(light, PhotometricLight) or min(light.size) <= 0:
            continue
        around, ahead = rectangle_of(light), share_ahead(light)
        flux = np.array(light.flux) * levels[lamps.get(light.name, 0)]
        for share, places in ((ahead, around), (1 - ahead, around[::-1])):
            if share > 1e-3 and flux.any():  # 1e-3 of the flux makes a side bright
                corners.append(places[None])
                radiance.append((share * flux / (math.pi * light.size[0] * light.size[1]))[None])
    return LightFaces(np.concatenate(corners), np.concatenate(radiance), sky)


def rectangle_of(light: PhotometricLight) -> np.ndarray:
    """Return the corners (4, 3) [m] of a luminaire, counterclockwise seen from where it shines."""
    axis, c0 = axes(light)
    a, b = 0.5 * light.size[0] * c0, 0.5 * light.size[1] * np.cross(axis, c0)
    return np.array(light.position) + np.stack([-a - b, a - b, a + b, b - a])


HIGHLIGHTS = 16  # highlights per picture, as in surface.frag: those of the strongest lights


class BareLights(NamedTuple):
    """L lights without a surface, as the shaders read them."""

    at: np.ndarray  # (L, 4) float32: position [m], 1; or unit direction towards the light, 0
    value: np.ndarray  # (L, 3) float32: intensity [W/sr] or irradiance of a facing plane [W/m2], at strength 1
    strength: tuple[np.ndarray | None, ...]  # per object: (D, HIGHLIGHTS) float32, 0 in a shadow; None: all 0


def bare_lights(lit: LitScene) -> BareLights | None:
    """Return the lights of a lit scene; None: no mesh has sharp gloss."""
    model, meshes, at = lit.model, lit.meshes, lit.at
    if not any(mesh.reflectors for mesh in meshes):
        return None
    lights = model.lights_at(lit.levels)
    size = max((float(np.ptp(m.positions, axis=0).max()) for m in meshes if len(m.positions)), default=1.0)
    rows = [_blurred(mesh) for mesh in meshes]
    points = [_placed(mesh.positions[k], at, o) for o, (mesh, k) in enumerate(zip(meshes, rows, strict=True))]
    strongest = _strongest(without_surface(lights), np.concatenate(points), size)
    strength: list[np.ndarray | None] = [None] * len(meshes)
    for o, (mesh, k) in enumerate(zip(meshes, rows, strict=True)):
        if len(k) and len(strongest.kind) and mesh.gloss is not None:
            normals = mesh.gloss.normal[k] @ at.rotation[o].T
            lift = model.lifts_at(at, points[o], normals)
            light = arriving(model.accelerator, at, points[o], normals, lift, strongest, size)
            far = np.where(strongest.distant, 1.0, light.distance)
            out = strength[o] = np.zeros((len(mesh.positions), HIGHLIGHTS), np.float32)
            out[k, : len(strongest.kind)] = light.strength * far * far
    of_light = np.concatenate([strongest.place, 1.0 - strongest.distant[:, None]], axis=1).astype(np.float32)
    return BareLights(of_light, strongest.value.astype(np.float32), tuple(strength))


def _blurred(mesh: DrawMesh) -> np.ndarray:
    """Return the draw vertices (k,) of sharp gloss that is no mirror: only it has highlights."""
    if mesh.reflector is None:
        return np.zeros(0, np.int64)
    rough = np.array([len(r.lobe.taps) > 1 for r in mesh.reflectors] + [False])  # the last: no sharp gloss, -1
    return np.unique(mesh.triangles[rough[mesh.reflector]])


def _placed(positions: np.ndarray, at: Transforms, o: int) -> np.ndarray:
    return positions @ at.rotation[o].T + at.position[o]


def _strongest(lights: DeltaLights, points: np.ndarray, size: float) -> DeltaLights:
    """Return the HIGHLIGHTS lights that bring most to the middle of the points (n, 3), shadows left out."""
    if len(lights.kind) <= HIGHLIGHTS or not len(points):
        return lights
    E = unoccluded(points.mean(axis=0)[None], lights, size).strength[0] * luminance(lights.value)
    rows = np.sort(np.argsort(-E, kind="stable")[:HIGHLIGHTS])
    kind, parameters, value, lamp = (a[rows] for a in lights[:4])
    return DeltaLights(kind, parameters, value, lamp, lights.tables)

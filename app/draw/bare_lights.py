"""Lights that sharp gloss shows without a reflected surface: highlights of lights that have none, and the sky."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gi_core.geometry.error import luminance
from gi_core.gloss.highlights import arriving, unoccluded, without_surface
from gi_core.lights.light_sampling import DeltaLights

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from app.draw.draw_mesh import DrawMesh
    from gi_core.model import Model
    from gi_core.rays.accelerator import Transforms
    from gi_core.scene.types import Pose

HIGHLIGHTS = 16  # highlights per picture, as in surface.frag: those of the strongest lights


class BareLights(NamedTuple):
    """L lights without a surface and the sky, as the shaders read them."""

    at: np.ndarray  # (L, 4) float32: position [m], 1; or unit direction towards the light, 0
    value: np.ndarray  # (L, 3) float32: intensity [W/sr] or irradiance of a facing plane [W/m2], at strength 1
    strength: tuple[np.ndarray | None, ...]  # per object: (D, HIGHLIGHTS) float32, 0 in a shadow; None: all 0
    up: np.ndarray  # (3,) float64 unit
    sky: np.ndarray  # (3,) float64 [W/m2/sr], above the horizon


def bare_lights(
    model: Model, meshes: Sequence[DrawMesh], poses: Mapping[str, Pose], levels: np.ndarray
) -> BareLights | None:
    """Return the lights at poses and levels (G, 3) of the lamps; None: no mesh has sharp gloss."""
    if not any(mesh.reflectors for mesh in meshes):
        return None
    lights, at, size = model.lights_at(levels), model.transforms(poses), _size_of(meshes)
    rows = [_blurred(mesh) for mesh in meshes]
    points = [_placed(mesh.positions[k], at, o) for o, (mesh, k) in enumerate(zip(meshes, rows, strict=True))]
    strongest = _strongest(without_surface(lights), np.concatenate(points), size)
    strength: list[np.ndarray | None] = [None] * len(meshes)
    for o, (mesh, k) in enumerate(zip(meshes, rows, strict=True)):
        if len(k) and len(strongest.kind) and mesh.normal is not None:
            light = arriving(model.accelerator, at, points[o], mesh.normal[k] @ at.rotation[o].T, strongest, size)
            far = np.where(strongest.distant, 1.0, light.distance)
            out = strength[o] = np.zeros((len(mesh.positions), HIGHLIGHTS), np.float32)
            out[k, : len(strongest.kind)] = light.strength * far * far
    of_light = np.concatenate([strongest.place, 1.0 - strongest.distant[:, None]], axis=1).astype(np.float32)
    return BareLights(of_light, strongest.value.astype(np.float32), tuple(strength), lights.sky.up, lights.sky.radiance)


def _blurred(mesh: DrawMesh) -> np.ndarray:
    """Return the draw vertices (k,) of sharp gloss that is no mirror: only it has highlights."""
    if mesh.reflector is None:
        return np.zeros(0, np.int64)
    rough = np.array([len(r.lobe.taps) > 1 for r in mesh.reflectors] + [False])  # the last: no sharp gloss, -1
    return np.unique(mesh.triangles[rough[mesh.reflector]])


def _placed(positions: np.ndarray, at: Transforms, o: int) -> np.ndarray:
    return positions @ at.rotation[o].T + at.position[o]


def _size_of(meshes: Sequence[DrawMesh]) -> float:
    return max((float(np.ptp(m.positions, axis=0).max()) for m in meshes if len(m.positions)), default=1.0)


def _strongest(lights: DeltaLights, points: np.ndarray, size: float) -> DeltaLights:
    """Return the HIGHLIGHTS lights that bring most to the middle of the points (n, 3), shadows left out."""
    if len(lights.kind) <= HIGHLIGHTS or not len(points):
        return lights
    E = unoccluded(points.mean(axis=0)[None], lights, size).strength[0] * luminance(lights.value)
    rows = np.sort(np.argsort(-E, kind="stable")[:HIGHLIGHTS])
    kind, parameters, value, lamp = (a[rows] for a in lights[:4])
    return DeltaLights(kind, parameters, value, lamp, lights.tables)

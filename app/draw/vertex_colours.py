"""Colours of draw vertices: linear radiance per side.

Under a texture they are E / pi times the texture's factor, without emission.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.draw.draw_mesh import DrawMesh
from gi_core.bsdf.table import join
from gi_core.display.vertex_light import light_vertices, weigh_vertices
from gi_core.gloss.light import Directions, GlossLight, gloss_radiance, room_for
from gi_core.rays.accelerator import Transforms


def colours(draw: DrawMesh, irradiance: np.ndarray, with_reflectance: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return linear radiance (D, 3) float32 of the front and of the back of each draw vertex.

    `irradiance` (R, 3) [W/m2]. The front has rho E / pi + Le, the back rho E / pi, or 0 on a one-sided face. Under a
    texture both lack the texture's value and Le. Without reflectance both are E / pi, as on white surfaces.
    """
    reflectance = draw.reflectance if with_reflectance else np.ones((1, 3), np.float32)
    front, back = np.zeros((2, len(draw.front), 3), np.float32)
    for receivers, out in ((draw.front, front), (draw.back, back)):
        light_vertices(irradiance, receivers, reflectance, out)
    if not with_reflectance:
        return front, back
    glow = draw.emission[draw.emissive]
    if draw.texture is not None:
        glow = np.where(draw.texture[draw.emissive, None] < 0, glow, 0.0)
    front[draw.emissive] += glow
    return front, back


def gloss_colours(
    draw: DrawMesh, directions: Directions, irradiance: np.ndarray, eye: np.ndarray, which=slice(None)
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the radiance (D, 3) float32 that gloss adds to front and back, above any texture; None without gloss.

    directions: `GlossLight.directions()`; irradiance (R, 3) [W/m2]; eye (3,): in the object's space; which: draw
    vertices, None: all.
    """
    gloss, sides = draw.gloss, []
    if gloss is None:
        return None
    tables = join([]) if gloss.tables is None else gloss.tables
    tangent = (gloss.normal if gloss.tangent is None else gloss.tangent)[which]
    positions, normals, lobes = draw.positions[which], gloss.normal[which], gloss.lobe[which]
    for side, receivers in enumerate((draw.front, draw.back)):
        out, normal = room_for(len(positions)), normals if side == 0 else -normals
        E, rows = np.nan_to_num(irradiance[receivers[which]]), np.ascontiguousarray(gloss.receivers[which, side])
        gloss_radiance(directions, rows, E, positions, normal, lobes, tangent, tables, eye, out)
        sides.append(out.astype(np.float32))
    return sides[0], sides[1]


Gloss = list[tuple[np.ndarray, np.ndarray] | None]  # per object: radiance (D, 3) on front and back; None: it has none


def gloss_towards(
    meshes: Sequence[DrawMesh], light: GlossLight | None, irradiance: np.ndarray, at: Transforms, eye: np.ndarray,
    other: Gloss | None = None,
) -> Gloss:  # fmt: skip
    """Return gloss_colours() of all objects at their poses for an eye (3,) of the model's space.

    other: those for another eye, which sharp gloss keeps: reflections hide it.
    """
    if light is None:
        return [None] * len(meshes)
    eyes = [R.T @ (eye - position) for R, position in zip(at.rotation, at.position, strict=True)]
    directions, out = light.directions(), []
    for mesh, seen_from, before in zip(meshes, eyes, other or [None] * len(meshes), strict=True):
        if before is None or mesh.reflector is None:
            out.append(gloss_colours(mesh, directions, irradiance, seen_from))
            continue
        which = np.unique(mesh.triangles[mesh.reflector < 0])
        front, back = (side.copy() for side in before)
        front[which], back[which] = gloss_colours(mesh, directions, irradiance, seen_from, which)  # type: ignore[misc]
        out.append((front, back))
    return out


def weights(draw: DrawMesh, of_receivers: np.ndarray | None) -> np.ndarray | None:
    """Return interpolation weights of front and back per draw vertex (D, 2) float32; None: all 1.

    of_receivers (R,): the weights of `gi_core.display.dilation.Drawn`.
    """
    if of_receivers is None:
        return None
    out = np.empty((len(draw.front), 2), np.float32)
    weigh_vertices(of_receivers, draw.front, draw.back, out)
    return out


def mean_radiance(draw: DrawMesh, front: np.ndarray, back: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return colours() (D, 3) of front and back times the mean texture, plus emission, as seen from far away."""
    if draw.texture is None:
        return front, back
    glow = np.where((draw.texture < 0)[:, None], 0.0, draw.emission)
    return front * draw.texel + glow, back * draw.texel

"""Read-out: the light at one point of the picture, interpolated as the picture interpolates it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.draw.raycast import barycentrics, pixel_steps, place, seen_radiance, weighted
from app.draw.units import Units, units_of
from app.draw.vertex_colours import colours, part_of, weights
from gi_core.geometry.error import luminance
from gi_core.rays.accelerator import Transforms

if TYPE_CHECKING:
    from app.draw.camera import Turntable
    from app.draw.picking import Hit
    from app.draw.vertex_colours import DrawMesh
    from gi_core.display.dilation import Drawn
    from gi_core.model import Model
    from gi_core.scene import Pose, Scene

STATIC = "static part"
UNLIT = "back of a one-sided surface: no light is computed"


class Reading(NamedTuple):
    """Light at a point of a surface, as luminance of RGB. nan where unknown."""

    object: str  # name of the mobile, or STATIC
    material: str
    irradiance: float  # [W/m2], or [lx] in a photometric scene; nan too on the back of a one-sided face
    radiance: float  # [W/m2/sr], or [cd/m2]: rho E / pi and emission
    is_lit: bool  # the side has a receiver
    units: Units

    def text(self) -> str:
        """Return the reading as one line."""
        place, u = f"{self.object}, {self.material}", self.units
        if not self.is_lit:
            return f"{place}  ·  {UNLIT}"
        E, L = (f"{value:.3g}" if value < 1000 else f"{value:.0f}" for value in (self.irradiance, self.radiance))
        if math.isnan(self.irradiance):
            return f"{u.on_surface} not yet known  ·  {place}"
        return f"{u.on_surface} {E} {u.per_area}  ·  {u.from_surface} {L} {u.per_solid_angle}  ·  {place}"


def read(
    hit: Hit,
    direction: np.ndarray,
    camera: Turntable,
    height: int,
    scene: Scene,
    model: Model,
    poses: dict[str, Pose],
    mesh: DrawMesh,
    drawn: Drawn,
) -> Reading:
    """Return the light at a hit of the camera's ray in `direction` (3,).

    height: of the picture [pixels], for the texture filter; mesh: the draw mesh of the hit object; drawn: irradiance
    (R, 3) [W/m2] and interpolation weights (R,) that the picture shows.
    """
    o = hit.object
    one, at = part_of(mesh, np.array([hit.face])), model.transforms(poses)
    world = place([one], Transforms(at.rotation[o : o + 1], at.position[o : o + 1]))
    camera = camera.relative_to(model.origins[0])
    eye, d = camera.eye().astype(np.float32), direction.astype(np.float32)[None]
    u, v = barycentrics(world.corners, eye[None], d)

    def seen(with_reflectance: bool) -> tuple[float, bool]:
        sides, w = colours(one, drawn.irradiance, with_reflectance), weights(one, drawn.weights)
        front, back = (weighted(c, w, side) for side, c in enumerate(sides))
        steps = pixel_steps(camera, 1, height) if with_reflectance and world.textures else None
        radiance, facing = seen_radiance(world, front, back, np.zeros(1, np.int64), u, v, d, steps, eye)
        return float(luminance(radiance[0])), bool(facing[0] or not world.one_sided[0])

    E, is_lit = seen(with_reflectance=False)
    L, _ = seen(with_reflectance=True)
    name = scene.mobiles[o - 1].name if o else STATIC
    shape = scene.mobiles[o - 1].mesh if o else scene.static
    material = scene.materials[shape.face_material[hit.face]].name
    if not is_lit:
        E = L = math.nan
    return Reading(name, material, math.pi * E, L, is_lit, units_of(scene.units))

"""Read-out: the light at one point of the picture, interpolated as the picture interpolates it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from app.draw.camera import Bounds, Turntable, from_camera
from app.draw.draw_mesh import along_light, quad_around
from app.draw.lit_scene import LitScene
from app.draw.picking import Hit, Picker
from app.draw.raycast import both_sides, pixel_steps, seen_radiance
from app.draw.vertex_colours import colours, gloss_colours, weights
from app.draw.visible import barycentrics, place
from app.settings import Pin
from gi_core.geometry.error import luminance
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.scene import Camera, Pose
from gi_core.scene.pose import rotation, three, to_world, to_world_directions
from gi_core.scene.types import Units, part_named

STATIC = "static part"
UNLIT = "back of a one-sided surface: no light is computed"


class Reading(NamedTuple):
    """Light at a point of a surface, as luminance of RGB. nan where unknown."""

    object: str  # name of the mobile, or STATIC
    material: str
    irradiance: float  # [W/m2], or [lx] in a photometric scene; nan too on the back of a one-sided face
    radiance: float  # [W/m2/sr], or [cd/m2]: diffuse, emitted, and of gloss towards the eye
    is_lit: bool  # the side has a receiver
    units: Units
    is_sharp: bool = False  # gloss shows a reflection, which `radiance` lacks
    error: float = math.nan  # standard error of the irradiance, at the nearest receiver
    before: tuple[float, float] | None = None  # irradiance of light A, and the standard error of the change since it

    def text(self) -> str:
        """Return the reading as one line."""
        place, u = f"{self.object}, {self.material}", self.units
        if not self.is_lit:
            return f"{place}  ·  {UNLIT}"
        E, L = _digits(self.irradiance), _digits(self.radiance)
        if math.isnan(self.irradiance):
            return f"{u.on_surface} not yet known  ·  {place}"
        E += f" ± {_digits(self.error, 2)}" if self.error > 0 else ""
        if self.before is not None:
            A, error = self.before
            noise = "" if math.isnan(error) else f" ± {_digits(error, 2)}"
            change = f"change {_digits(self.irradiance - A, sign='+')}{noise} {u.per_area}"
            return f"{u.on_surface} {E} {u.per_area}  ·  light A {_digits(A)}, {change}  ·  {place}"
        L = f"{L} {u.per_solid_angle}" + " without its reflection" * self.is_sharp
        return f"{u.on_surface} {E} {u.per_area}  ·  {u.from_surface} {L}  ·  {place}"


def _digits(value: float, digits: int = 3, sign: str = "") -> str:
    """Return a number to so many digits, without an exponent where it is large."""
    return f"{value:{sign}.0f}" if abs(value) >= 10**digits else f"{value:{sign}.{digits}g}"


class Pinned(NamedTuple):
    """A pin and its light on show."""

    pin: Pin
    position: np.ndarray  # (3,) float64 [m], in the world; that of the scene if its object is missing
    reading: Reading | None  # None: the surface or the object is no longer there


def new_pin(name: str, hit: Hit, direction: np.ndarray, model: Model, poses: dict[str, Pose]) -> Pin:
    """Return a pin at the hit of a ray in `direction` (3,), on the side that the ray meets."""
    o, s = hit.object, model.surfaces
    a, b, c = s.vertices[o][s.faces[o][hit.face]]
    normal, point, along = np.cross(b - a, c - a), hit.point, np.asarray(direction, np.float64)
    if o:
        pose = poses[model.names[o - 1]]
        R = rotation(pose)
        point, along = R.T @ (point - np.array(pose.position)), R.T @ along
    normal /= np.sqrt((normal * normal).sum())
    side = normal if normal @ along < 0 else -normal
    return Pin(name, three(point), three(side), model.names[o - 1] if o else "")


def read_pin(pin: Pin, picker: Picker, lit: LitScene) -> Pinned:
    """Return the light at a pin, its radiance along its normal."""
    model, poses = lit.model, lit.poses
    position, normal = np.array(pin.position), np.array(pin.normal)
    normal = normal / np.sqrt((normal * normal).sum())
    if pin.object and pin.object not in poses:
        return Pinned(pin, position, None)
    o = 1 + model.names.index(pin.object) if pin.object else 0
    size = model.scene_size
    face = picker.on(o, position, normal, 1e-3 * size)  # a pin may lie 1e-3 of the scene's size off its face
    if o:
        position, normal = (f(poses[pin.object], v[None])[0]
                            for f, v in ((to_world, position), (to_world_directions, normal)))  # fmt: skip
    if face < 0:
        return Pinned(pin, position, None)
    away = 0.05 * size  # [m], of the eye from the pin
    eye = Camera(three(position + away * normal), three(position), 1.0)
    camera = from_camera(eye, model.scene.up, Bounds(three(position), three(position)))
    direction = position - camera.eye()
    hit = Hit(o, face, away, position)
    direction /= np.sqrt((direction * direction).sum())
    # 2^20 pixels per picture height: the texture is read at a point
    return Pinned(pin, position, read(lit, hit, direction, camera, 1 << 20))


def read(lit: LitScene, hit: Hit, direction: np.ndarray, camera: Turntable, height: int) -> Reading:
    """Return the light at a hit of the camera's ray in `direction` (3,).

    height: of the picture [pixels], for the texture filter.
    """
    o, at, scene, drawn, gloss = hit.object, lit.at, lit.model.scene, lit.drawn, lit.gloss
    mesh = lit.meshes[o]
    is_sharp = mesh.reflector is not None and mesh.reflector[hit.face] >= 0
    one = quad_around(mesh, hit.face)
    one = along_light(one, *colours(one, drawn.irradiance, with_reflectance=True), weights(one, drawn.weights))
    world = place([one], Transforms(at.rotation[o : o + 1], at.position[o : o + 1]))
    camera = camera.relative_to(lit.model.origins[0])
    eye, d = camera.eye().astype(np.float32), direction.astype(np.float32)[None]
    face = world.met(np.zeros(1, np.int64), eye[None], d)
    u, v = barycentrics(world.corners[face], eye[None], d)

    def above_texture() -> tuple[np.ndarray, np.ndarray] | None:
        if gloss is None or one.gloss is None or is_sharp:
            return None
        directions = gloss.directions(np.unique(one.gloss.receivers[one.gloss.receivers >= 0]))
        return gloss_colours(one, directions, drawn.irradiance, at.rotation[o].T @ (camera.eye() - at.position[o]))

    def seen(with_reflectance: bool) -> tuple[float, bool]:
        w = [weights(one, drawn.weights)]
        faces = both_sides(world, [colours(one, drawn.irradiance, with_reflectance)], w)
        steps = pixel_steps(camera, height) if with_reflectance and world.textures else None
        radiance, facing = seen_radiance(faces, face, u, v, d, steps, eye)
        if with_reflectance and (above := above_texture()) is not None:
            radiance += seen_radiance(both_sides(world, [above], w), face, u, v, d, None, eye)[0]
        return float(luminance(radiance[0])), bool(facing[0] or not world.one_sided[0])

    E, is_lit = seen(with_reflectance=False)
    L, _ = seen(with_reflectance=True)
    name = scene.mobiles[o - 1].name if o else STATIC
    shape = scene.mobiles[o - 1].mesh if o else scene.static
    material = part_named(name, scene.materials[shape.face_material[hit.face]].name)
    if not is_lit:
        E = L = math.nan
    error = math.nan
    if lit.deviation is not None and (near := nearest_receiver(lit.model, lit.poses, hit, direction)) >= 0:
        error = float(lit.deviation[near])
    return Reading(name, material, math.pi * E, L, is_lit, lit.units, bool(is_sharp), error)


def nearest_receiver(model: Model, poses: Mapping[str, Pose], hit: Hit, direction: np.ndarray) -> int:
    """Return the receiver nearest to the hit of a ray in `direction` (3,), on the side that the ray meets.

    -1 on the back of a one-sided face.
    """
    surfaces = model.surfaces
    vertices = surfaces.faces[hit.object][hit.face]
    corners = model.vertices_at(hit.object, poses)[vertices]
    f = surfaces.first_face[hit.object] + hit.face
    front = np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ direction < 0
    nearest = int(np.argmin(((corners - hit.point) ** 2).sum(axis=1)))
    return int((surfaces.corner_front if front else surfaces.corner_back)[f][nearest])

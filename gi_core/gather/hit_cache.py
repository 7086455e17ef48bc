"""Hit cache of the rays that leave a mobile's receivers.

Rays are fixed to the mobile, so their hits on the mobile itself never change. Hits on the static part are cached while
the mobile rests. Hits on other mobiles are found in each frame, for the rays that pass their boxes. The result equals
that of an empty cache, bit for bit.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import difference, dot, rotate, rotate_back, row
from gi_core.lights.next_event import Shadows
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, Transforms
from gi_core.rays.all_objects import nearest_past_panes, rays_to_object, to_object
from gi_core.rays.panes import transmitted
from gi_core.rays.structures import nearest_hit, new_ray
from gi_core.scene.pose import to_world_at


class BounceRays:
    """Rays fixed to mobile `own`: origins and unit directions (n, 3) float32 in its object space.

    first: number of the first ray among those of all mobiles.
    """

    def __init__(self, model: Model, own: int, origins: np.ndarray, directions: np.ndarray, first: int = 0):
        self._model, self._own, self._origins, self._directions = model, own, origins, directions
        self._first = first
        far = np.full(len(origins), FAR * model.world.size, np.float32)
        self._on_own = model.accelerator.nearest(own, origins, directions, far)
        self._pose, self._traced = b"", 0
        self._past_panes: tuple[np.ndarray, ...] = ()
        self._cached = self._on_own  # distance and face, of the first `_traced` rays on the static part or `own`

    def nearest(self, at: Transforms) -> tuple[np.ndarray, np.ndarray]:
        """Return distance (n,) float32 [m] and global face (n,) int32, -1 for none, over all objects.

        The arrays may belong to the cache: do not write to them. Scenes with panes need past_panes() instead.
        """
        of = self._model.accelerator
        if left := self.left(at):
            self.trace(at, left)
        if len(at.position) == 2:
            return self._cached
        distance, face = (a.copy() for a in self._cached)
        world = self._model.world
        # spheres grow by 1e-5 of the world's size, so that culling loses no hit
        spheres = world.sphere_centre, world.sphere_radius + 1e-5 * world.size
        rays = at, self._own, self._origins, self._directions, distance, face
        _nearer(of.scenes, of.boxes, *spheres, of.first_face, new_ray(), *rays)
        return distance, face

    def past_panes(self, at: Transforms, seed: int):
        """Return distance, face and shares of the rays as nearest_past_panes() does, then their directions (n, 3).

        Directions float32 unit in the object's space. Nothing is cached but the last call.
        """
        model, own, n = self._model, self._own, len(self._origins)
        key = at.rotation.tobytes() + at.position.tobytes()
        if self._pose != key:
            R, p = at.rotation[own, None], at.position[own, None]
            lines = [
                to_world_at(R, q, a).astype(np.float32) for q, a in ((p, self._origins), (0 * p, self._directions))
            ]
            path = self._first + np.arange(n)
            rays = nearest_past_panes(model.accelerator, model.world, at, seed, 0, path, *lines)
            directions = self._directions.copy()
            turned = np.flatnonzero(rays.shares[:, 3])
            directions[turned] = rays_to_object(at, own, rays.origin[turned], rays.direction[turned])[1]
            self._past_panes, self._pose = (rays.distance, rays.face, rays.shares, directions), key
        return self._past_panes

    def left(self, at: Transforms) -> int:
        """Return the number of rays whose hits on the static part are not cached for these poses."""
        if self._model.accelerator.has_panes:
            return 0
        return len(self._origins) - (self._traced if self._pose == pose_bits(at, self._own) else 0)

    def trace(self, at: Transforms, rays: int) -> None:
        """Cache the hits of so many more rays on the static part."""
        if self._pose != pose_bits(at, self._own):
            self._cached = tuple(a.copy() for a in self._on_own)
            self._pose, self._traced = pose_bits(at, self._own), 0
        more = slice(self._traced, self._traced + rays)
        arrays = (a[more] for a in (self._origins, self._directions, *self._cached))
        _nearest_static(self._model.accelerator.scenes, new_ray(), at, self._own, *arrays)
        self._traced += rays


class ShadowRays:
    """Shadow rays from mobile `own`; the rays that static part and mobile itself do not block are cached."""

    def __init__(self, model: Model, own: int):
        self._model, self._own, self._pose = model, own, b""
        self._free: Shadows

    def forget(self) -> None:
        """Drop the cached rays."""
        self._pose = b""

    def occluded(self, at: Transforms, make) -> tuple[Shadows, np.ndarray]:
        """Return rays and (n,) bool: another mobile blocks the ray. make() returns all rays at the poses."""
        of = self._model.accelerator
        if self._pose != pose_bits(at, self._own):
            rays = make()
            free = _keep_free(of.scenes, new_ray(), at, self._own, rays)
            self._free = Shadows(*(a[:free] for a in rays))
            self._pose = pose_bits(at, self._own)
        rays, blocked = self._free, np.zeros(len(self._free.row), bool)
        if len(at.position) > 2:
            if of.has_panes:
                rays = rays._replace(value=rays.value.copy())
            _block(of.scenes, of.boxes, new_ray(), at, self._own, rays, blocked)
        return rays, blocked


def pose_bits(at: Transforms, o: int) -> bytes:
    """Return the bits of the pose of object o, which differ between any two poses."""
    return at.rotation[o].tobytes() + at.position[o].tobytes()


@inlined
def _in_world(at, o, origin, direction):
    """Return a ray of mobile o's object space in the world: origin and direction, float32."""
    R, p = at.rotation[o], at.position[o]
    ox, oy, oz = rotate(R, origin)
    dx, dy, dz = rotate(R, direction)
    return (
        (np.float32(ox + p[0]), np.float32(oy + p[1]), np.float32(oz + p[2])),
        (np.float32(dx), np.float32(dy), np.float32(dz)),
    )


@kernel
def _nearest_static(scenes, ray, at, own, origins, directions, distance, face):
    """Replace distance and face of rays that meet the static part before; rays in mobile `own`'s object space."""
    for k in range(len(origins)):
        o, d = _in_world(at, own, origins[k], directions[k])
        t, f = nearest_hit(scenes, 0, ray, o[0], o[1], o[2], d[0], d[1], d[2], distance[k])
        if f >= 0:  # faces of the static part come first
            distance[k], face[k] = t, f


@kernel
def _nearer(scenes, boxes, centres, radii, first_face, ray, at, own, origins, directions, distance, face):
    """Replace distance and face of rays that meet a mobile, other than `own`, before; ties stay.

    centres (objects, 3), radii (objects,) [m]: of spheres around objects, in their spaces. Most rays pass them by.
    """
    for o in range(1, len(at.position)):
        if o == own:
            continue
        x, y, z = rotate(at.rotation[o], centres[o])
        (u, v, w), square = difference(row(at.position, o), row(at.position, own)), radii[o] * radii[o]
        centre = rotate_back(at.rotation[own], (x + u, y + v, z + w))
        for k in range(len(origins)):
            way, unit = difference(centre, row(origins, k)), row(directions, k)  # in float32, it may be a bit longer
            along, outside = dot(way, unit), dot(way, way) - square
            if outside > 0.0 and (along < 0.0 or outside * dot(unit, unit) > along * along):
                continue
            origin, direction = _in_world(at, own, origins[k], directions[k])
            passes, ox, oy, oz, dx, dy, dz = to_object(at, o, boxes[o], origin, direction, distance[k])
            if passes:
                t, f = nearest_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, distance[k])
                if f >= 0 and t < distance[k]:
                    distance[k], face[k] = t, first_face[o] + f


@kernel
def _keep_free(scenes, ray, at, own, rays):
    """Move rays that neither the static part nor mobile `own` blocks to the front, in order; return their number.

    Panes on their way lower their values.
    """
    n, R, p = 0, at.rotation[own], at.position[own]
    for k in range(len(rays.row)):
        o, d = rays.origin[k], rays.direction[k]
        red, green, blue = transmitted(scenes, 0, ray, o[0], o[1], o[2], d[0], d[1], d[2], rays.limit[k])
        if red + green + blue <= 0.0:
            continue
        x, y, z = rotate_back(R, (o[0] - p[0], o[1] - p[1], o[2] - p[2]))
        u, v, w = rotate_back(R, (np.float64(d[0]), np.float64(d[1]), np.float64(d[2])))
        x, y, z, u, v, w = np.float32(x), np.float32(y), np.float32(z), np.float32(u), np.float32(v), np.float32(w)
        e, f, g = transmitted(scenes, own, ray, x, y, z, u, v, w, rays.limit[k])
        if e + f + g <= 0.0:
            continue
        shares = red * e, green * f, blue * g
        rays.row[n], rays.limit[n] = rays.row[k], rays.limit[k]
        rays.lamp[n], rays.stratum[n] = rays.lamp[k], rays.stratum[k]
        for c in range(3):
            rays.origin[n, c], rays.direction[n, c], rays.value[n, c] = o[c], d[c], shares[c] * rays.value[k, c]
        n += 1
    return n


@kernel
def _block(scenes, boxes, ray, at, own, rays, blocked):
    """Mark rays that a mobile other than `own` blocks; its panes lower their values."""
    for k in range(len(blocked)):
        for o in range(1, len(at.position)):
            if o == own or blocked[k]:
                continue
            origin, direction, limit = rays.origin[k], rays.direction[k], rays.limit[k]
            passes, ox, oy, oz, dx, dy, dz = to_object(at, o, boxes[o], origin, direction, limit)
            if passes:
                red, green, blue = transmitted(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit)
                blocked[k] = red + green + blue <= 0.0
                if red + green + blue < 3.0 and not blocked[k]:
                    value = rays.value[k]
                    value[0], value[1], value[2] = value[0] * red, value[1] * green, value[2] * blue

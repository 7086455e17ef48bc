"""Hit cache of the rays that leave a mobile's receivers.

Rays are fixed to the mobile, so their hits on the mobile itself never change. Hits on the static part are cached while
the mobile rests. Hits on other mobiles are found in each frame, for the rays that pass their boxes. The result equals
that of an empty cache, bit for bit.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import rotate, rotate_back
from gi_core.lights.next_event import Shadows
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, Transforms, passes_box, rays_to_object
from gi_core.rays.structures import any_hit, nearest_hit, new_ray
from gi_core.rays.two_level import CUT_PAD


class BounceRays:
    """Rays fixed to mobile `own`: origins and unit directions (n, 3) float32 in its object space."""

    def __init__(self, model: Model, own: int, origins: np.ndarray, directions: np.ndarray):
        self._model, self._own, self._origins, self._directions = model, own, origins, directions
        far = np.full(len(origins), FAR * model.world.size, np.float32)
        self._on_own = model.accelerator.nearest(own, origins, directions, far)
        self._pose = b""
        self._cached: tuple[np.ndarray, np.ndarray]  # distance and face, on the static part or `own`

    def nearest(self, at: Transforms) -> tuple[np.ndarray, np.ndarray]:
        """Return distance (n,) float32 [m] and global face (n,) int32, -1 for none, over all objects.

        The arrays may belong to the cache: do not write to them.
        """
        accelerator, R, p = self._model.accelerator, at.rotation[self._own], at.position[self._own]
        moved, others = self._pose != _pose_bits(at, self._own), len(at.position) > 2
        if not (moved or others):
            return self._cached
        origins, directions = np.empty((2, *self._origins.shape), np.float32)
        _to_world(R, p, self._origins, origins)
        _to_world(R, np.zeros(3), self._directions, directions)
        if moved:
            distance, face = accelerator.nearest(0, origins, directions, self._on_own[0])
            self._cached = distance, np.where(face < 0, self._on_own[1], face)
            self._pose = _pose_bits(at, self._own)
        if not others:
            return self._cached
        distance, face = (a.copy() for a in self._cached)
        _nearer(accelerator.scenes, new_ray(), self._model.world, at, self._own, origins, directions, distance, face)
        return distance, face


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
        accelerator = self._model.accelerator
        if self._pose != _pose_bits(at, self._own):
            rays = make()
            rays = _select(rays, ~accelerator.occluded(0, rays.origin, rays.direction, rays.limit))
            local = rays_to_object(at, self._own, rays.origin, rays.direction)
            self._free = _select(rays, ~accelerator.occluded(self._own, *local, rays.limit))
            self._pose = _pose_bits(at, self._own)
        blocked = np.zeros(len(self._free.row), bool)
        if len(at.position) > 2:
            _block(accelerator.scenes, new_ray(), self._model.world, at, self._own, self._free, blocked)
        return self._free, blocked


def _pose_bits(at: Transforms, o: int) -> bytes:
    return at.rotation[o].tobytes() + at.position[o].tobytes()


def _select(rays: Shadows, which: np.ndarray) -> Shadows:
    return Shadows(*(a[which] for a in rays))


@inlined
def _to_mobile(world, at, o, origin, direction, limit):
    """Return a ray in mobile o's object space, float32, after whether it passes the mobile's box."""
    R, p = at.rotation[o], at.position[o]
    ox, oy, oz = rotate_back(R, (origin[0] - p[0], origin[1] - p[1], origin[2] - p[2]))
    dx, dy, dz = rotate_back(R, (np.float64(direction[0]), np.float64(direction[1]), np.float64(direction[2])))
    t = np.float64(limit)
    passes = passes_box(
        ox, oy, oz, ox + t * dx, oy + t * dy, oz + t * dz, world.box_low[o], world.box_high[o], CUT_PAD * world.size
    )
    return passes, np.float32(ox), np.float32(oy), np.float32(oz), np.float32(dx), np.float32(dy), np.float32(dz)


@kernel
def _nearer(scenes, ray, world, at, own, origins, directions, distance, face):
    """Replace distance and face of rays that meet a mobile, other than `own`, before; ties stay."""
    for k in range(len(origins)):
        for o in range(1, len(world.first_face) - 1):
            if o == own:
                continue
            passes, ox, oy, oz, dx, dy, dz = _to_mobile(world, at, o, origins[k], directions[k], distance[k])
            if passes:
                t, f = nearest_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, distance[k])
                if f >= 0 and t < distance[k]:
                    distance[k], face[k] = t, world.first_face[o] + f


@kernel
def _block(scenes, ray, world, at, own, rays, blocked):
    """Mark rays that a mobile other than `own` blocks."""
    for k in range(len(blocked)):
        for o in range(1, len(world.first_face) - 1):
            if o == own or blocked[k]:
                continue
            passes, ox, oy, oz, dx, dy, dz = _to_mobile(world, at, o, rays.origin[k], rays.direction[k], rays.limit[k])
            blocked[k] = passes and any_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, rays.limit[k])


@kernel
def _to_world(R, p, points, out):
    """out = R points + p, element by element."""
    for k in range(len(points)):
        x, y, z = rotate(R, points[k])
        out[k, 0], out[k, 1], out[k, 2] = x + p[0], y + p[1], z + p[2]

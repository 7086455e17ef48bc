"""Rays that leave a mobile and what they meet, kept as long as the poses stay that it depends on.

Where a ray from mobile o meets o itself never changes; where it meets the static part changes with the pose of o;
where it meets another mobile p, with the poses of o and p. So a mobile that rests while another is dragged costs
little. What is kept is what would be found anew, to the last bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.accelerator import FAR, Transforms, passes_box, rays_to_object, to_local
from gi_core.jit import kernel
from gi_core.light_sampling import Shadows
from gi_core.model import Model
from gi_core.two_level import CUT_PAD


class Hits(NamedTuple):
    """Some of the rays, and where they meet something."""

    ray: np.ndarray  # (h,) int64
    distance: np.ndarray  # (h,) float32 [m]
    face: np.ndarray  # (h,) int32, global


def pose_keys(at: Transforms) -> list[bytes]:
    """Return the bits of each object's pose."""
    return [R.tobytes() + p.tobytes() for R, p in zip(at.rotation, at.position, strict=True)]


class OtherMobiles:
    """What is known of rays and each mobile but their own."""

    def __init__(self, own: int):
        self._own, self._known = own, {}  # mobile: (pose, what is known)

    def each(self, poses: list[bytes], find) -> list:
        """Return find(p) of each mobile p, or what it returned when p was where it is now."""
        others = [p for p in range(1, len(poses)) if p != self._own]
        for p in others:
            if self._known.get(p, (None,))[0] != poses[p]:
                self._known[p] = poses[p], find(p)
        return [self._known[p][1] for p in others]


class BounceRays:
    """Rays fixed to mobile `own`: origins and unit directions (n, 3) float32 in its object space."""

    def __init__(self, model: Model, own: int, origins: np.ndarray, directions: np.ndarray):
        self._model, self._own, self._origins, self._directions = model, own, origins, directions
        far = np.full(len(origins), FAR * model.world.size, np.float32)
        self._on_own = model.accelerator.nearest(own, origins, directions, far)
        self._pose = None
        self._before: tuple[np.ndarray, np.ndarray]  # distance and face, on the static part or `own`
        self._others: OtherMobiles

    def met(self, at: Transforms, poses: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
        """Return distance (n,) float32 [m] and global face (n,) int32, -1 for none, over all objects.

        poses: pose_keys() of `at`. What is returned may be kept: not to be written to.
        """
        world = None
        if self._pose != poses[self._own]:
            self._pose = None  # until all is known: an exception leaves nothing that is half done
            world = self._in_world(at)
            distance, face = self._model.accelerator.nearest(0, *world, self._on_own[0])
            self._before = distance, np.where(face < 0, self._on_own[1], face)
            self._others, self._pose = OtherMobiles(self._own), poses[self._own]

        def find(p: int) -> Hits:
            nonlocal world
            world = world or self._in_world(at)
            rays, origins, directions, limits = _near(self._model, at, p, *world, self._before[0])
            distance, face = self._model.accelerator.nearest(p, origins, directions, limits)
            hit = (face >= 0) & (distance < limits)  # ties go to what was met before
            return Hits(rays[hit], distance[hit], face[hit])

        others = [h for h in self._others.each(poses, find) if len(h.ray)]
        if not others:
            return self._before
        distance, face = (a.copy() for a in self._before)
        for h in others:
            _keep_nearer(h, distance, face)
        return distance, face

    def _in_world(self, at: Transforms) -> tuple[np.ndarray, np.ndarray]:
        origins, directions = np.empty((2, *self._origins.shape), np.float32)
        R, p = at.rotation[self._own], at.position[self._own]
        _to_world(R, p, self._origins, origins)
        _to_world(R, np.zeros(3), self._directions, directions)
        return origins, directions


class ShadowRays:
    """Rays from mobile `own` to lights: those that the static part and the mobile itself leave free."""

    def __init__(self, model: Model, own: int):
        self._model, self._own, self._pose = model, own, None
        self._free: Shadows
        self._others: OtherMobiles

    def lit(self, at: Transforms, poses: list[bytes], make) -> tuple[Shadows, np.ndarray]:
        """Return rays and (n,) bool, which of them another mobile blocks; make() returns all rays at the poses."""
        accelerator = self._model.accelerator
        if self._pose != poses[self._own]:
            self._pose = None
            rays = make()
            rays = _select(rays, ~accelerator.occluded(0, rays.origin, rays.direction, rays.limit))
            local = rays_to_object(at, self._own, rays.origin, rays.direction)
            self._free = _select(rays, ~accelerator.occluded(self._own, *local, rays.limit))
            self._others, self._pose = OtherMobiles(self._own), poses[self._own]
        free = self._free

        def find(p: int) -> np.ndarray:
            rays, *near = _near(self._model, at, p, free.origin, free.direction, free.limit)
            return rays[accelerator.occluded(p, *near)]

        blocked = np.zeros(len(free.row), bool)
        for rays in self._others.each(poses, find):
            blocked[rays] = True
        return free, blocked


def _select(rays: Shadows, which: np.ndarray) -> Shadows:
    return Shadows(*(a[which] for a in rays))


def _near(model: Model, at: Transforms, p: int, origins, directions, limits):
    """Return the numbers of those rays that pass mobile p's box, and these rays in its object space."""
    n, w = len(origins), model.world
    rays, near, limit = np.empty(n, np.int64), np.empty((2, n, 3), np.float32), np.empty(n, np.float32)
    m = _pass_box(
        origins, directions, limits, at.rotation[p], at.position[p], w.box_low[p], w.box_high[p], CUT_PAD * w.size,
        rays, near[0], near[1], limit,
    )  # fmt: skip
    return rays[:m], near[0, :m], near[1, :m], limit[:m]


@kernel
def _pass_box(origins, directions, limits, R, p, low, high, pad, rays, local_o, local_d, limit):
    n = 0
    for k in range(len(origins)):
        ox, oy, oz = to_local(R, origins[k, 0] - p[0], origins[k, 1] - p[1], origins[k, 2] - p[2])
        dx, dy, dz = to_local(
            R, np.float64(directions[k, 0]), np.float64(directions[k, 1]), np.float64(directions[k, 2])
        )
        t = np.float64(limits[k])
        if not passes_box(ox, oy, oz, ox + t * dx, oy + t * dy, oz + t * dz, low, high, pad):
            continue
        rays[n], limit[n] = k, limits[k]
        local_o[n, 0], local_o[n, 1], local_o[n, 2] = ox, oy, oz
        local_d[n, 0], local_d[n, 1], local_d[n, 2] = dx, dy, dz
        n += 1
    return n


@kernel
def _keep_nearer(hits, distance, face):
    for j in range(len(hits.ray)):
        k = hits.ray[j]
        if hits.distance[j] < distance[k]:
            distance[k], face[k] = hits.distance[j], hits.face[j]


@kernel
def _to_world(R, p, points, out):
    """out = R points + p, element by element."""
    for k in range(len(points)):
        x, y, z = np.float64(points[k, 0]), np.float64(points[k, 1]), np.float64(points[k, 2])
        for c in range(3):
            out[k, c] = R[c, 0] * x + R[c, 1] * y + R[c, 2] * z + p[c]

"""Rays in the world against all objects: the nearest hit, and whether any object blocks a ray.

A ray is traced on the static part first. It is carried to a mobile only if it passes the mobile's box before its
nearest hit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.random_numbers import independent
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.base.vec import dot, rotate_back, row
from gi_core.rays.accelerator import FAR, Accelerator, Transforms, as_rays, passes_box
from gi_core.rays.panes import MOST_PANES, chosen, pane_at, transmitted
from gi_core.rays.structures import nearest_hit, new_ray
from gi_core.rays.two_level import World, lift_off, on_plane, turned_normal
from gi_core.scene.pose import to_world_at

PASSAGE = 97  # number of a path's random numbers at panes, apart from those of `gather/path_tracer.py`


def nearest_in_world(accelerator: Accelerator, at: Transforms, origins, directions, limits):
    """Return distance (n,) float32 and global face (n,) int32 over all objects.

    Used by pictures and by the reference. Rays are tested as given, not as stored lines, so bits may differ from paths.
    """
    n = len(origins)
    origins, directions, limits = as_rays(origins, directions, limits)
    distances, faces = np.empty(n, np.float32), np.empty(n, np.int32)

    def work(_, a, b):
        _nearest_of_all(
            accelerator.scenes, accelerator.boxes, accelerator.first_face, at, new_ray(),
            origins[a:b], directions[a:b], limits[a:b], distances[a:b], faces[a:b],
        )  # fmt: skip

    run_ranges(work, n, accelerator.threads, COSTLY)
    return distances, faces


class PathRays(NamedTuple):
    """Rays from vertices of n paths, and their hits past panes.

    A pane that reflects a ray moves its origin and direction there; its distance counts from there on.
    """

    path: np.ndarray  # (n,) int64
    origin: np.ndarray  # (n, 3) float32 [m]
    direction: np.ndarray  # (n, 3) float32 unit
    distance: np.ndarray  # (n,) float32 [m]
    face: np.ndarray  # (n,) int32, global; -1: none
    shares: np.ndarray  # (n, 4) float64: factors of red, green and blue by panes; 1 where one has reflected the ray


def nearest_past_panes(
    accelerator: Accelerator, world: World, at: Transforms, seed: int, vertex: int, path, origins, directions
) -> PathRays:
    """Return rays from vertex `vertex` of paths (n,); each pane lets a ray pass, or reflects it, by chance.

    Origins and directions (n, 3) float32 are changed in place. The chance depends on seed, path and vertex alone.
    """
    n, of = len(path), accelerator
    rays = PathRays(path, origins, directions, np.empty(n, np.float32), np.empty(n, np.int32), np.zeros((n, 4)))

    def work(_, a, b):
        _past_panes(of.scenes, of.boxes, world, at, new_ray(), seed, vertex, PathRays(*(x[a:b] for x in rays)))

    run_ranges(work, n, accelerator.threads, COSTLY)
    return rays


def occluded_in_world(
    accelerator: Accelerator, at: Transforms, origins, directions, limits, values: np.ndarray | None = None
) -> np.ndarray:
    """Return (n,) bool: any object blocks the ray within its limit.

    values (n, 3) float64: light of each ray, multiplied by what panes on its way let pass.
    """
    blocked = np.empty(len(origins), bool)
    values = np.empty((len(origins), 3)) if values is None else values
    origins, directions, limits = as_rays(origins, directions, limits)

    def work(_, a, b):
        rays = origins[a:b], directions[a:b], limits[a:b]
        _occluded_by_any(accelerator.scenes, accelerator.boxes, at, new_ray(), *rays, values[a:b], blocked[a:b])

    run_ranges(work, len(origins), accelerator.threads, COSTLY)
    return blocked


@kernel
def _nearest_of_all(scenes, boxes, first_face, at, ray, origins, directions, limits, distances, faces):
    for k in range(len(origins)):
        origin, direction = row(origins, k), row(directions, k)
        distances[k], faces[k] = _nearest(scenes, boxes, first_face, at, ray, origin, direction, limits[k])


@kernel
def _past_panes(scenes, boxes, world, at, ray, seed, vertex, rays):
    far, kinds = np.float32(FAR * world.size), world.panes.kinds
    for k in range(len(rays.path)):
        origin, direction, before = row(rays.origin, k), row(rays.direction, k), np.float32(0.0)
        rays.shares[k, :3] = 1.0
        for step in range(MOST_PANES):
            distance, f = _nearest(scenes, boxes, world.first_face, at, ray, origin, direction, far)
            rays.distance[k], rays.face[k] = before + distance, f
            if f < 0 or pane_at(world.panes, f) < 0:
                break
            n, (u, v, w) = turned_normal(world, at, f), direction
            towards, t = dot(direction, n), np.float64(distance)
            number = independent(seed, rays.path[k], vertex * MOST_PANES + step, PASSAGE)
            passes, factor = chosen(kinds, pane_at(world.panes, f), min(abs(towards), 1.0), number)
            x, y, z = on_plane(world, at, f, (origin[0] + t * u, origin[1] + t * v, origin[2] + t * w))
            lift = lift_off(world, f, (x, y, z)) * (1.0 if (towards > 0.0) == passes else -1.0)
            origin = np.float32(x + lift * n[0]), np.float32(y + lift * n[1]), np.float32(z + lift * n[2])
            before += distance
            if not passes:
                turn = 2.0 * towards
                direction = np.float32(u - turn * n[0]), np.float32(v - turn * n[1]), np.float32(w - turn * n[2])
                before, rays.shares[k, 3] = np.float32(0.0), 1.0
                for c in range(3):
                    rays.origin[k, c], rays.direction[k, c] = origin[c], direction[c]
            for c in range(3):
                rays.shares[k, c] *= factor[c]
            if step == MOST_PANES - 1 or factor[0] + factor[1] + factor[2] <= 0.0:
                rays.face[k], rays.shares[k, :3] = -1, 0.0
                break


@inlined
def _nearest(scenes, boxes, first_face, at, ray, origin, direction, limit):
    """Return distance and global face of a ray's nearest hit over all objects."""
    (x, y, z), (u, v, w) = origin, direction
    distance, face = nearest_hit(scenes, 0, ray, x, y, z, u, v, w, limit)
    for o in range(1, len(at.position)):
        passes, x, y, z, u, v, w = to_object(at, o, boxes[o], origin, direction, distance)
        if passes:
            t, f = nearest_hit(scenes, o, ray, x, y, z, u, v, w, distance)
            if f >= 0:
                distance, face = t, first_face[o] + f
    return distance, face


@kernel
def _occluded_by_any(scenes, boxes, at, ray, origins, directions, limits, values, blocked):
    for k in range(len(origins)):
        origin, direction = row(origins, k), row(directions, k)
        (x, y, z), (u, v, w) = origin, direction
        red, green, blue = transmitted(scenes, 0, ray, x, y, z, u, v, w, limits[k])
        for o in range(1, len(at.position)):
            if red + green + blue <= 0.0:
                break
            passes, x, y, z, u, v, w = to_object(at, o, boxes[o], origin, direction, limits[k])
            if passes:
                p, q, r = transmitted(scenes, o, ray, x, y, z, u, v, w, limits[k])
                red, green, blue = red * p, green * q, blue * r
        blocked[k] = red + green + blue <= 0.0
        values[k, 0], values[k, 1], values[k, 2] = values[k, 0] * red, values[k, 1] * green, values[k, 2] * blue


@inlined
def to_object(at, o, box, origin, direction, limit):
    """Return whether a ray passes the box (2, 3) of object o, and the ray in its space, float32."""
    R, p = at.rotation[o], at.position[o]
    x, y, z = rotate_back(R, (origin[0] - p[0], origin[1] - p[1], origin[2] - p[2]))
    u, v, w = rotate_back(R, (np.float64(direction[0]), np.float64(direction[1]), np.float64(direction[2])))
    t = min(np.float64(limit), 1e30)  # 1e30 m in place of an infinite limit
    passes = passes_box(x, y, z, x + t * u, y + t * v, z + t * w, box[0], box[1], 0.0)
    return passes, np.float32(x), np.float32(y), np.float32(z), np.float32(u), np.float32(v), np.float32(w)


def rays_to_object(at: Transforms, o: int, origins: np.ndarray, directions: np.ndarray):
    """Return origins and directions (n, 3) float32 in object o's space, from the world."""
    back, none = at.rotation[o].T[None], np.zeros((1, 3))
    turned = (to_world_at(back, none, np.asarray(a, np.float64)) for a in (origins - at.position[o], directions))
    return tuple(a.astype(np.float32) for a in turned)

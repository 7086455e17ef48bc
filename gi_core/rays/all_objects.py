"""Rays in the world against all objects: the nearest hit, and whether any object blocks a ray.

A ray is traced on the static part first. It is carried to a mobile only if it passes the mobile's box before its
nearest hit.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.threads import run_ranges
from gi_core.base.vec import rotate_back, row
from gi_core.rays.accelerator import RAY_GRAIN, Accelerator, Transforms, as_rays, passes_box
from gi_core.rays.structures import any_hit, nearest_hit, new_ray
from gi_core.scene.pose import to_world_at


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

    run_ranges(work, n, accelerator.threads, RAY_GRAIN)
    return distances, faces


def occluded_in_world(accelerator: Accelerator, at: Transforms, origins, directions, limits) -> np.ndarray:
    """Return (n,) bool: any object blocks the ray within its limit."""
    blocked = np.empty(len(origins), bool)
    origins, directions, limits = as_rays(origins, directions, limits)

    def work(_, a, b):
        rays = origins[a:b], directions[a:b], limits[a:b]
        _occluded_by_any(accelerator.scenes, accelerator.boxes, at, new_ray(), *rays, blocked[a:b])

    run_ranges(work, len(origins), accelerator.threads, RAY_GRAIN)
    return blocked


@kernel
def _nearest_of_all(scenes, boxes, first_face, at, ray, origins, directions, limits, distances, faces):
    for k in range(len(origins)):
        origin, direction = row(origins, k), row(directions, k)
        (x, y, z), (u, v, w) = origin, direction
        distance, face = nearest_hit(scenes, 0, ray, x, y, z, u, v, w, limits[k])
        for o in range(1, len(at.position)):
            passes, x, y, z, u, v, w = to_object(at, o, boxes[o], origin, direction, distance)
            if passes:
                t, f = nearest_hit(scenes, o, ray, x, y, z, u, v, w, distance)
                if f >= 0:
                    distance, face = t, first_face[o] + f
        distances[k], faces[k] = distance, face


@kernel
def _occluded_by_any(scenes, boxes, at, ray, origins, directions, limits, blocked):
    for k in range(len(origins)):
        origin, direction = row(origins, k), row(directions, k)
        (x, y, z), (u, v, w) = origin, direction
        blocked[k] = any_hit(scenes, 0, ray, x, y, z, u, v, w, limits[k])
        for o in range(1, len(at.position)):
            if blocked[k]:
                break
            passes, x, y, z, u, v, w = to_object(at, o, boxes[o], origin, direction, limits[k])
            blocked[k] = passes and any_hit(scenes, o, ray, x, y, z, u, v, w, limits[k])


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

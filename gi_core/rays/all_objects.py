"""Rays in the world against all objects: the nearest hit, and whether any object blocks a ray.

A ray is traced on the static part first. It is carried to a mobile only if it passes the mobile's box before its
nearest hit.

Photons use a two-level nearest hit: the static part along a ray, then the mobiles along the resulting line.
Background, new suffixes and from-scratch solutions share it. The *line* runs from the start to the static end, both
stored as float32. Mobiles are tested along the line, not along the sampled ray, so the bits of a line do not depend on
mobiles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.random_numbers import independent
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.base.vec import dot, largest, rotate, rotate_back, row
from gi_core.base.vectors import box
from gi_core.bsdf.surface import Bsdfs, build_bsdfs
from gi_core.geometry.receivers import NONE
from gi_core.geometry.surfaces import Surfaces
from gi_core.rays.accelerator import (
    CUT_PAD,
    FAR,
    LIFT,
    Accelerator,
    Transforms,
    as_rays,
    bounding_boxes,
    bounding_spheres,
    line,
    passes_box,
    point_on_line,
)
from gi_core.rays.panes import MOST_PANES, NoPanes, Panes, chosen, left_side, pane_at, panes_of, transmitted
from gi_core.rays.structures import nearest_hit, new_ray
from gi_core.scene.pose import to_world_at


class World(NamedTuple):
    """Arrays of the scene that every kernel reads; F faces, object 0 is the static part."""

    normals: np.ndarray  # (F, 3) float64, object space
    height: np.ndarray  # (F,) float64 [m], of the face's plane over the origin, along its normal
    reach: np.ndarray  # (F,) float64 [m], largest coordinate of the face's corners, object space
    bsdfs: Bsdfs  # its type chooses the kernels' reflection models
    panes: Panes | NoPanes  # their type chooses too
    two_sided: np.ndarray  # (F,) bool
    face_object: np.ndarray  # (F,) int16
    first_face: np.ndarray  # (objects + 1,) int64
    size: float  # [m], diameter of a sphere around static part and lights
    sphere_centre: np.ndarray  # (objects, 3) float64, bounding spheres in object space
    sphere_radius: np.ndarray  # (objects,) float64
    box_low: np.ndarray  # (objects, 3) float64, bounding boxes in object space
    box_high: np.ndarray  # (objects, 3) float64


@kernel
def turned_normal(world, at, f):
    """Return the unit normal (x, y, z) of face f in the world."""
    return rotate(at.rotation[world.face_object[f]], world.normals[f])


@inlined
def lift_off(world, f, origin):
    """Return how far [m] a ray starts off face f, which it leaves from the world's point `origin`."""
    return LIFT * max(world.reach[f], largest(origin))


@inlined
def on_plane(world, at, f, point):
    """Return a point of the world moved onto the plane of face f: distances along rays from afar are rounded."""
    o, n = world.face_object[f], turned_normal(world, at, f)
    away = dot(n, point) - dot(n, at.position[o]) - world.height[f]
    return point[0] - away * n[0], point[1] - away * n[1], point[2] - away * n[2]


@inlined
def landing(world, at, f, origin, direction, distance):
    """Return the point (x, y, z) float32 where a line meets face f, in float32 at a distance."""
    t, (x, y, z), (u, v, w) = np.float64(distance), origin, direction
    x, y, z = on_plane(world, at, f, (x + t * u, y + t * v, z + t * w))
    return np.float32(x), np.float32(y), np.float32(z)


@inlined
def static_end(scenes, ray, world, at, ox, oy, oz, dx, dy, dz, side):
    """Return the static end (x, y, z) float32 of a ray that leaves a side, and the side that it hits (NONE: no hit).

    Origin and direction are float32. The ray is lifted off the face that it leaves.
    """
    lx, ly, lz = ox, oy, oz
    if side >= 0:
        f = side >> 1
        lift = lift_off(world, f, (ox, oy, oz))
        x, y, z = turned_normal(world, at, f)
        side = left_side(world.panes, side, dx * x + dy * y + dz * z)
        lift = lift if side & 1 == 0 else -lift
        lx, ly, lz = np.float32(ox + lift * x), np.float32(oy + lift * y), np.float32(oz + lift * z)
    far = np.float32(FAR * world.size)
    distance, face = nearest_hit(scenes, 0, ray, lx, ly, lz, dx, dy, dz, far)
    if face < 0:
        x, y, z = point_on_line(ox, oy, oz, dx, dy, dz, far)
        end_side = NONE
    else:
        x, y, z = landing(world, at, face, (lx, ly, lz), (dx, dy, dz), distance)
        n = world.normals  # faces of the static part come first
        behind = dx * n[face, 0] + dy * n[face, 1] + dz * n[face, 2] > 0.0
        end_side = 2 * face + (1 if behind else 0)
    return x, y, z, np.int32(end_side)


@inlined
def mobile_cut(scenes, ray, world, at, ox, oy, oz, ex, ey, ez, side):
    """Return the first cut of a line by a mobile: distance float32 [m] (inf: none) and side.

    Ties go to the static end, then to the mobile that comes first in the scene. A line that starts on a mobile is
    lifted off its face for that mobile.
    """
    cut, cut_side = np.float32(np.inf), np.int32(NONE)
    for o in range(1, len(world.first_face) - 1):
        R, px, py, pz = at.rotation[o], at.position[o, 0], at.position[o, 1], at.position[o, 2]
        lx, ly, lz = rotate_back(R, (ox - px, oy - py, oz - pz))
        mx, my, mz = rotate_back(R, (ex - px, ey - py, ez - pz))
        if not passes_box(lx, ly, lz, mx, my, mz, world.box_low[o], world.box_high[o], CUT_PAD * world.size):
            continue
        fx, fy, fz = np.float32(lx), np.float32(ly), np.float32(lz)
        dx, dy, dz, length = line(fx, fy, fz, np.float32(mx), np.float32(my), np.float32(mz))
        if side >= 0 and world.face_object[side >> 1] == o:
            n, f = world.normals, side >> 1
            lift = lift_off(world, f, (ox, oy, oz))
            left = left_side(world.panes, side, dx * n[f, 0] + dy * n[f, 1] + dz * n[f, 2])
            lift = lift if left & 1 == 0 else -lift
            fx, fy, fz = (
                np.float32(lx + lift * n[f, 0]),
                np.float32(ly + lift * n[f, 1]),
                np.float32(lz + lift * n[f, 2]),
            )
        distance, face = nearest_hit(scenes, o, ray, fx, fy, fz, dx, dy, dz, length)
        if face >= 0 and distance < length and distance < cut:
            f = world.first_face[o] + face
            towards = dx * world.normals[f, 0] + dy * world.normals[f, 1] + dz * world.normals[f, 2]
            cut, cut_side = distance, np.int32(2 * f + (1 if towards > 0.0 else 0))
    return cut, cut_side


@kernel
def nearest_mobile(scenes, ray, world, at, origin, end, side, cut, cut_side):
    """Write the first cuts of n lines by mobiles: distance (n,) float32 [m] (inf: none) and side (n,) int32.

    scenes: of an Accelerator; origin, end (n, 3) float32; side (n,) int32 that each line leaves.
    """
    for k in range(len(origin)):
        ox, oy, oz = origin[k, 0], origin[k, 1], origin[k, 2]
        ex, ey, ez = end[k, 0], end[k, 1], end[k, 2]
        cut[k], cut_side[k] = mobile_cut(scenes, ray, world, at, ox, oy, oz, ex, ey, ez, side[k])


def build_world(surfaces: Surfaces, accelerator: Accelerator, lights: np.ndarray) -> World:
    """Return the World of a scene.

    Its size covers the static part and the positions of `lights` (n, 3) [m], but no mobiles: the static solution is
    then the same with and without them.
    """
    corners = np.concatenate([v[f] for v, f in zip(surfaces.vertices, surfaces.faces, strict=True)])
    return World(
        surfaces.normals,
        (surfaces.normals * corners[:, 0]).sum(axis=1),
        np.abs(corners).max(axis=(1, 2), initial=0.0),
        build_bsdfs(surfaces.reflectance, surfaces.lobe, surfaces.tables, surfaces.tangent),
        panes_of(surfaces),
        surfaces.two_sided,
        accelerator.face_object,
        surfaces.first_face,
        max(2 * enclosing_sphere(surfaces.vertices[0], lights)[1], 1e-9),
        *bounding_spheres(surfaces),
        *bounding_boxes(surfaces),
    )


def enclosing_sphere(*points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius [m] of the sphere round the bounding box of all points (n, 3)."""
    every = np.concatenate([np.asarray(p, np.float64).reshape(-1, 3) for p in points])
    if not len(every):
        return np.zeros(3), 0.0
    low, high = box(every)
    diagonal = high - low
    return (low + high) / 2, 0.5 * math.sqrt(float((diagonal * diagonal).sum()))


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

    values (n, 3) float64: light of each ray, multiplied by the transmittance of panes on its way.
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

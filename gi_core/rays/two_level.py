"""The two-level nearest hit: the static part along a ray, then the mobiles along the resulting line.

Background, new suffixes and from-scratch solutions share this definition. The *line* runs from the start to the static
end, both stored as float32. Mobiles are tested along the line, not along the sampled ray, so the bits of a line do not
depend on mobiles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import dot, largest, rotate, rotate_back
from gi_core.base.vectors import box
from gi_core.bsdf.surface import Bsdfs, build_bsdfs
from gi_core.geometry.receivers import NONE
from gi_core.geometry.surfaces import Surfaces
from gi_core.rays.accelerator import (
    CUT_PAD,
    FAR,
    LIFT,
    Accelerator,
    bounding_boxes,
    bounding_spheres,
    line,
    passes_box,
    point_on_line,
)
from gi_core.rays.panes import NoPanes, Panes, left_side, panes_of
from gi_core.rays.structures import nearest_hit


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

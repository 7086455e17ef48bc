"""The two-level nearest hit: the static scene along a ray, then the mobiles along the line it gives.

One definition serves the background, branches and from-scratch solutions alike. The *line* runs from
the start to the static end, both stored as float32; mobiles are tested along the line, not along the
sampled ray. So a line means the same whether or not a mobile was there when it was traced.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.accelerator import (
    FAR,
    ORIGIN_LIFT,
    Accelerator,
    Transforms,
    bounding_boxes,
    bounding_spheres,
    line,
    passes_box,
    point_on_line,
    to_local,
)
from gi_core.jit import kernel
from gi_core.paths import NONE
from gi_core.surfaces import Surfaces

CUT_PAD = 1e-5  # of the world's size: bounding boxes grow by it, so that culling never loses a hit


class World(NamedTuple):
    """What every kernel needs to know of the scene, in arrays."""

    normals: np.ndarray  # (F, 3) float64, object space
    reflectance: np.ndarray  # (F, 3) float64
    two_sided: np.ndarray  # (F,) bool
    face_object: np.ndarray  # (F,) int16
    size: float  # diameter of a sphere round the static part and lights [m]: what epsilons are scaled by
    sphere_centre: np.ndarray  # (objects, 3) float64, bounding spheres in object space
    sphere_radius: np.ndarray  # (objects,) float64
    box_low: np.ndarray  # (objects, 3) float64, bounding boxes in object space
    box_high: np.ndarray  # (objects, 3) float64


@kernel
def _lift(origin, side, normals, rotation, face_object, lift, out):
    """Lift ray origins off the face they leave."""
    for k in range(len(origin)):
        for c in range(3):
            out[k, c] = origin[k, c]
        if side[k] >= 0:
            f = side[k] >> 1
            s = lift if side[k] & 1 == 0 else -lift
            o = face_object[f]
            x, y, z = normals[f, 0], normals[f, 1], normals[f, 2]
            for c in range(3):
                out[k, c] = origin[k, c] + s * (rotation[o, c, 0] * x + rotation[o, c, 1] * y + rotation[o, c, 2] * z)


@kernel
def _static_ends(lifted, origin, direction, distance, face, normals, far, end, end_side):
    """Turn static hits into ends of lines; a miss ends far away in free space."""
    for k in range(len(face)):
        f, x, y, z = face[k], direction[k, 0], direction[k, 1], direction[k, 2]
        if f >= 0:
            e = point_on_line(lifted[k, 0], lifted[k, 1], lifted[k, 2], x, y, z, distance[k])
            behind = x * normals[f, 0] + y * normals[f, 1] + z * normals[f, 2] > 0.0
            end_side[k] = 2 * f + (1 if behind else 0)
        else:
            e = point_on_line(origin[k, 0], origin[k, 1], origin[k, 2], x, y, z, far)
            end_side[k] = NONE
        end[k, 0], end[k, 1], end[k, 2] = e


@kernel
def _lines_near(origin, end, side, face_object, o, R, p, low, high, pad, lift, normals, rows, local_o, local_d, limit):
    """Collect the lines that pass object o's bounding box, carried to its space; return how many.

    A line that starts on o itself is lifted off its face.
    """
    n = 0
    for k in range(len(origin)):
        x, y, z = origin[k, 0] - p[0], origin[k, 1] - p[1], origin[k, 2] - p[2]
        ox, oy, oz = to_local(R, x, y, z)
        x, y, z = end[k, 0] - p[0], end[k, 1] - p[1], end[k, 2] - p[2]
        ex, ey, ez = to_local(R, x, y, z)
        if not passes_box(ox, oy, oz, ex, ey, ez, low, high, pad):
            continue
        fox, foy, foz = np.float32(ox), np.float32(oy), np.float32(oz)
        dx, dy, dz, length = line(fox, foy, foz, np.float32(ex), np.float32(ey), np.float32(ez))
        if side[k] >= 0 and face_object[side[k] >> 1] == o:
            s = lift if side[k] & 1 == 0 else -lift
            f = side[k] >> 1
            fox = np.float32(ox + s * normals[f, 0])
            foy, foz = np.float32(oy + s * normals[f, 1]), np.float32(oz + s * normals[f, 2])
        rows[n] = k
        local_o[n, 0], local_o[n, 1], local_o[n, 2] = fox, foy, foz
        local_d[n, 0], local_d[n, 1], local_d[n, 2] = dx, dy, dz
        limit[n] = length
        n += 1
    return n


def nearest_static(accelerator: Accelerator, world: World, at: Transforms, origin, direction, side):
    """Return the static ends of rays: end (n, 3) float32 and side (n,) int32, NONE far away in free space.

    origin (n, 3) float32, direction (n, 3) float32 unit, side (n,) int32 that each ray leaves.
    """
    n = len(origin)
    lifted = np.empty((n, 3), np.float32)
    _lift(origin, side, world.normals, at.rotation, world.face_object, ORIGIN_LIFT * world.size, lifted)
    far = np.float32(FAR * world.size)
    distance, face = accelerator.nearest(0, lifted, direction, np.full(n, far, np.float32))
    end, end_side = np.empty((n, 3), np.float32), np.empty(n, np.int32)
    _static_ends(lifted, origin, direction, distance, face, world.normals, far, end, end_side)
    return end, end_side


def nearest_mobile(accelerator: Accelerator, world: World, at: Transforms, origin, end, side):
    """Return where mobiles first cut lines: distance (n,) float32 (inf: nowhere) and side (n,) int32.

    Ties go to the static end, then to the mobile that comes first in the scene.
    """
    n = len(origin)
    cut = np.full(n, np.inf, np.float32)
    cut_side = np.full(n, NONE, np.int32)
    if len(at.position) == 1 or n == 0:
        return cut, cut_side
    rows = np.empty(n, np.int64)
    local_o, local_d = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32)
    limit = np.empty(n, np.float32)
    for o in range(1, len(at.position)):
        R, p = at.rotation[o], at.position[o]
        m = _lines_near(
            origin, end, side, world.face_object, o, R, p, world.box_low[o], world.box_high[o], CUT_PAD * world.size,
            ORIGIN_LIFT * world.size, world.normals, rows, local_o, local_d, limit,
        )  # fmt: skip
        if m:
            distance, face = accelerator.nearest(o, local_o[:m], local_d[:m], limit[:m])
            _keep_nearer(rows[:m], distance, face, limit, local_d, world.normals, cut, cut_side)
    return cut, cut_side


@kernel
def _keep_nearer(rows, distance, face, limit, local_d, normals, cut, cut_side):
    for j in range(len(rows)):
        k = rows[j]
        if face[j] >= 0 and distance[j] < limit[j] and distance[j] < cut[k]:
            f = face[j]
            towards = local_d[j, 0] * normals[f, 0] + local_d[j, 1] * normals[f, 1] + local_d[j, 2] * normals[f, 2]
            cut[k] = distance[j]
            cut_side[k] = 2 * f + (1 if towards > 0.0 else 0)


def build_world(surfaces: Surfaces, accelerator: Accelerator, lights: np.ndarray) -> World:
    """Flatten what the kernels need.

    Its size is that of the static part and of the positions of `lights` (n, 3): mobiles play no
    part, so that the static solution is the same with and without them.
    """
    return World(
        surfaces.normals,
        surfaces.reflectance,
        surfaces.two_sided,
        accelerator.face_object,
        max(2 * enclosing_sphere(surfaces.vertices[0], lights)[1], 1e-9),
        *bounding_spheres(surfaces),
        *bounding_boxes(surfaces),
    )


def enclosing_sphere(*points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius of the sphere round the box of all points (n, 3)."""
    every = np.concatenate([np.asarray(p, np.float64).reshape(-1, 3) for p in points])
    if not len(every):
        return np.zeros(3), 0.0
    low, high = every.min(axis=0), every.max(axis=0)
    diagonal = high - low
    return (low + high) / 2, 0.5 * math.sqrt(float((diagonal * diagonal).sum()))

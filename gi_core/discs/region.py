"""Visibility region of a receiver: the part of its disc that light can reach (report 1.2.1, artifact control; 2.9.1).

The region is a star-shaped polygon around the receiver: the free distance to the next surface of the same object, in
RAYS directions. Edges of the polygon follow straight walls exactly, so no light leaks through them. An intersection
counts only inside the region, and the polygon's area is the divisor. A disc that reaches into a wall therefore neither
loses light nor receives light of the next room. `contact` adds other objects, per frame.

Each direction has two distances, because a concave surface rises through its own tangent disc. Light that lands on the
receiver's own patch nearby may cross the disc behind the surface ("far": own patch ignored). Other light may not
("near": own patch blocks too).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.pause import pause, pieces
from gi_core.base.random_numbers import basis
from gi_core.base.results import KEPT, digest
from gi_core.base.vec import dot
from gi_core.model import Model

RAYS = 32  # the polygon of a free disc has 99.4 % of its area; intersections outside it do not count
PROBES = 8  # directions of the first test; a receiver with none of them blocked keeps the whole disc
EXTENSION = 1e-2  # of the radius: segments end behind their hit, so that discs in the plane of the hit are crossed
REGION_LIFT = 2e-3  # of the radius: ray origins above the receiver's own flat surface

TRIED = np.arange(0, RAYS, RAYS // PROBES)  # directions ...
OTHERS = np.setdiff1d(np.arange(RAYS), TRIED)
COS = np.cos(2 * np.pi * np.arange(RAYS) / RAYS)
SIN = np.sin(2 * np.pi * np.arange(RAYS) / RAYS)

WHOLE = -1  # row of a free disc


class Regions(NamedTuple):
    """Visibility regions of one object's R receivers.

    One byte per distance is 64 bytes per receiver, one cache line. A furnished kitchen has 200,000 receivers.
    """

    row: np.ndarray  # (R,) int32 into `reach`, or WHOLE
    reach: np.ndarray  # (C, RAYS, 2) uint8, near and far in units of radius / 255, rounded down
    area: np.ndarray  # (R,) float64 [m2], 0 where no light can arrive


def whole_discs(model: Model, o: int, radius: float) -> Regions:
    """Return whole discs as the regions of object o's receivers; radius [m]."""
    rows = model.surfaces.receiver_range(o)
    n = rows.stop - rows.start
    return Regions(np.full(n, WHOLE, np.int32), np.empty((0, RAYS, 2), np.uint8), np.full(n, math.pi * radius * radius))


def regions(model: Model, o: int, radius: float) -> Regions:
    """Measure the regions of object o's receivers; radius [m]."""
    key, results = digest(model.shape_keys[o], radius), model.results
    if (measured := results.get("regions", key)) is None:
        measured = _measured(model, o, radius)
        results.keep("regions", key, measured, KEPT * model.surfaces.objects)
    return Regions(measured.row.copy(), measured.reach, measured.area.copy())


def _measured(model: Model, o: int, radius: float) -> Regions:
    s = model.surfaces
    rows = np.arange(*s.receiver_range(o).indices(len(model.object_receivers.areas)))
    return regions_at(model, o, *look_from(model, o, radius), model.receiver_sides[rows] >> 1, radius)


def regions_at(
    model: Model, o: int, points: np.ndarray, normals: np.ndarray, patch: np.ndarray, radius: float
) -> Regions:
    """Measure the regions of discs at points (n, 3) [m] with normals (n, 3), on patches (n,) of object o, -1: none."""
    row = np.full(len(points), WHOLE, np.int32)
    reach, count = [], 0
    for part in pieces(len(points)):
        tried = _distances(model, o, points[part], normals[part], patch[part], radius, TRIED)
        hit = np.flatnonzero((tried[..., 0] < np.float32(radius)).any(axis=1))
        pause()
        if len(hit):
            blocked = part.start + hit
            row[blocked] = count + np.arange(len(blocked))
            count += len(blocked)
            around = points[blocked], normals[blocked], patch[blocked], radius
            free = np.empty((len(hit), RAYS, 2), np.float32)
            free[:, TRIED], free[:, OTHERS] = tried[hit], _distances(model, o, *around, OTHERS)
            _look_over_low_steps(model, o, *around, free)
            reach.append(levels(free, radius))
    reach = np.concatenate(reach or [np.empty((0, RAYS, 2), np.uint8)])
    area = np.full(len(points), math.pi * radius * radius)
    area[row >= 0] = polygon_areas(reach, radius)
    return Regions(row, reach, area)


def levels(distances: np.ndarray, radius: float) -> np.ndarray:
    """Return distances (...) float32 [m] as stored, uint8 in units of radius / 255, rounded down."""
    out = np.empty(distances.shape, np.uint8)
    flat = np.ascontiguousarray(distances, np.float32).reshape(-1)
    _levels(flat, np.float32(255 / radius), out.reshape(-1))
    return out


@kernel
def _levels(distance, per_metre, out):
    for k in range(len(distance)):
        level = np.floor(distance[k] * per_metre + np.float32(1e-3))
        out[k] = np.uint8(min(max(level, np.float32(0.0)), np.float32(255.0)))


def polygon_areas(reach: np.ndarray, radius: float) -> np.ndarray:
    """Return the areas (n,) float64 [m2] of regions (n, RAYS, 2) uint8, 0 for too small ones.

    Integer sums: the bits do not depend on the number of regions per call.
    """
    products = np.empty(len(reach), np.int64)
    _products(reach, products)
    area = (0.5 * math.sin(2 * math.pi / RAYS) * (radius / 255) ** 2) * products
    # Smaller regions count as unreachable, they would hold noise alone.
    area[area < 1e-3 * math.pi * radius * radius] = 0.0
    return area


@kernel
def _products(reach, out):
    """Sum the products of adjacent far distances per region: twice its area divided by the sine of the angle."""
    for i in range(len(reach)):
        total = np.int64(0)
        for k in range(RAYS):
            total += np.int64(reach[i, k, 1]) * np.int64(reach[i, (k + 1) & (RAYS - 1), 1])
        out[i] = total


def look_from(model: Model, o: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return ray origins (off the surface and off its edges) and normals of receivers, (n, 3) float64 each."""
    receivers, rows = model.object_receivers, model.surfaces.receiver_range(o)
    towards = model.towards_faces[rows].copy()
    normals = receivers.normals[rows]
    towards -= (towards * normals).sum(axis=1)[:, None] * normals
    # Inside a surface the centroids surround the receiver, so the mean offset is small and changes nothing.
    length = np.sqrt((towards * towards).sum(axis=1))[:, None]
    # Ray origins move away from edges, which lie in the neighbour's plane, but not through a wall beside a corner that
    # `files/completion/crossings.py` put there.
    step = 1e-2 * np.minimum(length, radius) / np.where(length > 0, length, 1)
    return receivers.positions[rows] + REGION_LIFT * radius * normals + step * towards, normals


def _look_over_low_steps(model: Model, o: int, points, normals, patch, radius: float, free: np.ndarray) -> None:
    """Correct near and far distances (n, RAYS, 2) float32 [m] for steps too low to block light.

    In the grout between tiles one millimetre high, a region would be a thousandth of the disc, and its noise half of
    a tiled kitchen's. But segments end a little behind their hit, so those that land on the tiles also cross the plane
    of the grout, except at grazing angles. Narrow regions are therefore measured again from half that height. At worst
    this loses light within 30 degrees of the plane, a quarter of all.
    """
    higher = (0.5 * EXTENSION - REGION_LIFT) * radius
    areas = _areas(free)
    # a region smaller than 0.25 of the disc is measured again from a little higher
    narrow = np.flatnonzero(areas < 0.25 * math.pi * radius * radius)
    if len(narrow):
        raised = points[narrow] + higher * normals[narrow]
        again = _distances(model, o, raised, normals[narrow], patch[narrow], radius, np.arange(RAYS))
        wider = _areas(again) > areas[narrow]
        free[narrow[wider]] = again[wider]


def _areas(free: np.ndarray) -> np.ndarray:
    """Return the areas (n,) [m2] of polygons with corners at far distances (n, RAYS, 2) [m]."""
    out = np.empty(len(free))
    _sums(free, out)
    return 0.5 * math.sin(2 * math.pi / RAYS) * out


@kernel
def _sums(free, out):
    for i in range(len(free)):
        total = 0.0
        for k in range(RAYS):
            total += float(free[i, k, 1]) * float(free[i, (k + 1) & (RAYS - 1), 1])
        out[i] = total


def _distances(model: Model, o: int, points, normals, patch, radius: float, which: np.ndarray) -> np.ndarray:
    """Return near and far distances (n, m, 2) float32 [m] along directions `which` (m,), indices below RAYS."""
    n, count = len(points), len(which)
    origins, directions = np.empty((n * count, 3), np.float32), np.empty((n * count, 3), np.float32)
    _radial(points, normals, COS[which], SIN[which], origins, directions)
    distance, face = model.accelerator.opaque.nearest(o, origins, directions, np.full(n * count, radius, np.float32))
    out = np.empty((n, count, 2), np.float32)
    _near_and_far(distance, face, model.surfaces.patch, patch, np.float32(radius), out)
    return out


@kernel
def _near_and_far(distance, face, patch_of, patch, radius, out):
    count = out.shape[1]
    for j in range(len(face)):
        i, k = j // count, j % count
        own = face[j] >= 0 and patch_of[face[j]] == patch[i]
        # a hit nearer than 0.25 radii on the own patch means that the disc lies behind it from the start
        out[i, k, 0] = np.float32(0.0) if own and distance[j] < np.float32(0.25) * radius else distance[j]
        out[i, k, 1] = radius if own else distance[j]


@kernel
def _radial(points, normals, cosines, sines, origins, directions):
    count = len(cosines)
    for i in range(len(points)):
        n = normals[i]
        ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
        for k in range(count):
            c, s = cosines[k], sines[k]
            j = i * count + k
            origins[j, 0], origins[j, 1], origins[j, 2] = points[i, 0], points[i, 1], points[i, 2]
            directions[j, 0] = c * ax + s * bx
            directions[j, 1] = c * ay + s * by
            directions[j, 2] = c * az + s * bz


@kernel
def _direction_before(x, y):
    """Return the index of the direction just clockwise of (x, y).

    The arc tangent is a polynomial (Hastings 1955) with an error of 1e-5 rad, which suffices here.
    """
    u, v = abs(x), abs(y)
    a = min(u, v) / max(max(u, v), 1e-300)
    b = a * a
    angle = a * (
        0.99997726 + b * (-0.33262347 + b * (0.19354346 + b * (-0.11643287 + b * (0.05265332 - b * 0.0117212))))
    )
    if v > u:
        angle = 0.5 * math.pi - angle
    if x < 0.0:
        angle = math.pi - angle
    if y < 0.0:
        angle = 2.0 * math.pi - angle
    return int(angle * (RAYS / (2.0 * math.pi))) & (RAYS - 1)


@kernel
def inside(offset, normal, radius, reach, i, layer):
    """Return whether an offset from a receiver lies in the polygon of row i; layer 0: near, 1: far."""
    ax, ay, az, bx, by, bz = basis(float(normal[0]), float(normal[1]), float(normal[2]))
    unit = 255.0 / radius
    x, y = dot(offset, (ax, ay, az)) * unit, dot(offset, (bx, by, bz)) * unit
    k = _direction_before(x, y)
    m = (k + 1) & (RAYS - 1)
    # The two corners that enclose the direction of the offset, and the side of their edge.
    d0, d1 = float(reach[i, k, layer]), float(reach[i, m, layer])
    x0, y0, x1, y1 = d0 * COS[k], d0 * SIN[k], d1 * COS[m], d1 * SIN[m]
    return (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0.0

"""Floors: level places with room above and around, and the best of them to stand on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.nearest_points import count_within
from gi_core.base.vectors import length
from gi_core.files.completion.camera_view import axes, in_frame
from gi_core.files.completion.pilot import Box, Rays, corners_of, horizontal, ring, sphere_directions, spread
from gi_core.scene.types import Scene

RING = 12  # directions round a column


class Column(NamedTuple):
    """The upright cylinder that a mobile needs."""

    height: float  # [m]
    radius: float  # [m]


class Spot(NamedTuple):
    """A place on the floor."""

    point: np.ndarray  # (3,) [m]
    headroom: float  # [m], inf in the open
    indoors: bool
    shown: bool  # whole, unhidden and of a good size in the camera's picture
    has_room: bool  # False: no floor with room enough, this is a guess


def floor_spot(scene: Scene, rays: Rays, box: Box, column: Column, standing=()) -> Spot:
    """Return the best place for a column: with a camera the nearest in its view, else a central one with a wide view.

    standing: (middle (3,), radius) of balls to keep clear of.
    """
    enclosed = 0.55  # share of them that hit something near: by an open front one is still indoors
    up = np.array(scene.up)
    points = _candidates(rays, box, up)
    if not len(points):
        centre = (box.low + box.high) / 2
        low = centre - up * float(up @ (centre - np.where(up > 0, box.low, box.high)))
        return Spot(low, np.inf, False, False, False)
    headroom, free = _room_for(points, rays, box, column, up)
    for middle, radius in standing:
        off = points + up * column.height / 2 - middle
        free -= length(off) < radius + np.hypot(column.radius, column.height / 2)
    fits = (headroom > column.height * 1.02) & (free > 0.999)

    closed, fronts = _surroundings(points + up * min(column.height, box.size * 0.1), rays, box)
    bright = _light_on(points, box, up)
    # fronts are 0.6 of the hits in a room; from inside a solid one sees backs
    indoors = (closed > enclosed) & np.isfinite(headroom) & (fronts > 0.6)
    # 0.01 of the places must be indoors: a nook in an armchair is no room
    indoors &= (indoors & fits).sum() > 0.01 * fits.sum()
    score = 20.0 * fits + free + 1.5 * bright
    shown = np.zeros(len(points), bool)
    if scene.camera is not None:
        shown, near = _near_in_view(points, rays, box, column, up, scene.camera)
        score += 8.0 * indoors + 6.0 * shown + near + 1.5 * _common(points, up, box, fits)
    else:
        space = indoors if indoors.any() else ~np.isfinite(headroom)
        score += _where_one_looks(points, rays, box, column, up, space) + 1.5 * _common(points, up, box, fits & space)
    best = int(np.argmax(score))
    return Spot(points[best], float(headroom[best]), bool(indoors[best]), bool(shown[best]), bool(fits[best]))


def _room_for(points, rays: Rays, box: Box, column: Column, up):
    """Return headroom (n,) [m], and the share (n,) of rays in and about a column that touch nothing."""
    height, radius = column
    lift = max(height * 0.02, 1e-4 * box.size)
    headroom, _ = rays.hits(points + up * lift, np.broadcast_to(up, points.shape))
    around = ring(up, RING)
    free = np.zeros(len(points))
    for share in (0.1, 0.5, 0.9):
        start = points + up * max(share * height, lift)
        for d in around:
            t, _ = rays.hits(start, np.broadcast_to(d, points.shape))
            free += t > radius * 1.15  # 1.15 of the mobile's own radius
    for d in around:
        for reach in (0.5, 1.0):
            start = points + d * radius * reach + up * height
            t, _ = rays.hits(start, np.broadcast_to(-up, points.shape))
            free += np.abs(t - height) < 2 * lift
    return headroom + lift, free / (RING * 5)


def _surroundings(points, rays: Rays, box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Return the share (n,) of directions that hit something before long, and the share of that seen from its front."""
    sphere = 48  # directions that decide whether a place is inside a room
    hit, front = np.zeros(len(points)), np.zeros(len(points))
    for d in sphere_directions(sphere):
        t, face = rays.hits(points, np.broadcast_to(d, points.shape))
        near = t < 1.5 * box.size
        hit += near
        front += near & (rays.surfaces.normals[face] @ d < 0)
    return hit / sphere, front / np.maximum(hit, 1)


def _near_in_view(points, rays: Rays, box: Box, column: Column, up, camera) -> tuple[np.ndarray, np.ndarray]:
    """Return which places (n,) show a column whole and unhidden, and a score (n,): near, and in the middle."""
    eye = np.array(camera.position)
    distance = length(points + up * column.height / 2 - eye)
    heights = [in_frame(camera, up, points + up * share * column.height) for share in (0.0, 0.5, 1.0)]
    aside = np.abs(np.stack(heights)).max(axis=(0, 2))
    size = column.radius + column.height / 2
    picture = distance * np.tan(np.radians(camera.vertical_fov_degrees) / 2)  # half its height, there
    # a mobile stays within 0.75 of the picture's half width and height, and has 0.06 to 0.5 of its height
    shown = (aside < 0.75) & (size < 0.5 * picture) & (size > 0.06 * picture)
    right = axes(camera.position, camera.target, up)[1]
    heights = [up * max(share * column.height, 1e-3 * box.size) for share in (0.1, 0.5, 0.95)]
    looks = [points + h + side * column.radius * right for h in heights for side in (-1, -0.5, 0, 0.5, 1)]
    seen = np.mean([rays.sees(eye, to) for to in looks], axis=0)
    shown &= seen == 1
    # As far again as the nearest place costs as much as standing at the edge of the frame.
    nearest = distance[shown].min() if shown.any() else box.size
    return shown, 3 * seen - distance / nearest - aside.clip(0, 3)


def _where_one_looks(points, rays: Rays, box: Box, column: Column, up, space) -> np.ndarray:
    """Return a score (n,): in the room, or under the sky, as `space` (n,) says; central, with much in sight."""
    off = points - points[space if space.any() else slice(None)].mean(axis=0)
    off -= (off @ up)[:, None] * up
    distance = length(off) / box.size
    return 3.0 * space + _outlook(points + up * 0.6 * column.height, rays, box) - 1.5 * distance


def _common(points, up, box: Box, rows) -> np.ndarray:
    """Return how much of the floor in `rows` (n,) lies at the height of each place, 1 for the most: no table tops."""
    level = np.round((points @ up) / max(0.03 * box.size, 1e-9)).astype(np.int64)
    index = np.unique(level, return_inverse=True)[1].reshape(-1)
    counts = np.bincount(index, rows)
    return counts[index] / max(counts.max(), 1)


def _outlook(points, rays: Rays, box: Box) -> np.ndarray:
    """Return the share (n,) of the lit scene that is seen from each place: a nook behind a cupboard sees little."""
    seen, _, weight = spread(box, 60)
    return sum(w * rays.sees(points, np.broadcast_to(at, points.shape)) for at, w in zip(seen, weight, strict=True))


def _light_on(points, box: Box, up) -> np.ndarray:
    """Return how much light falls on each place (n,), 1 on the lighter half of them."""
    if not len(box.hits):
        return np.ones(len(points))
    flat = np.eye(3) + 3 * np.outer(up, up)  # heights count fourfold: light on the floor, not on the walls
    counts = count_within(box.hits @ flat, points @ flat, 0.08 * box.size)
    return np.minimum(counts / max(float(np.median(counts[counts > 0])) if counts.any() else 1.0, 1.0), 1.0)


def _candidates(rays: Rays, box: Box, up):
    """Return level points (n, 3) that face up, found by rays down through the useful box."""
    east, north = horizontal(up)
    corners = corners_of(box.low, box.high)
    u, v, h = corners @ east, corners @ north, corners @ up
    grid = (np.arange(28) + 0.5) / 28  # candidate columns along each horizontal side of the useful box
    landings = []
    for share in (0.12, 0.35, 0.6, 0.9, 1.05):  # heights in the box, sought downwards
        x, y = np.meshgrid(u.min() + grid * np.ptp(u), v.min() + grid * np.ptp(v))
        z = h.min() + share * max(np.ptp(h), 0.01 * box.size)
        start = x.reshape(-1, 1) * east + y.reshape(-1, 1) * north + z * up
        t, face = rays.hits(start, np.broadcast_to(-up, start.shape))
        hit = np.flatnonzero(face >= 0)
        normal = rays.surfaces.normals[face[hit]]
        facing = normal @ up
        # A floor is level to 14 degrees.
        level = (facing > 0.97) | ((facing < -0.97) & rays.surfaces.two_sided[face[hit]])
        dark = rays.surfaces.emission[face[hit]].max(axis=1) == 0
        rows = hit[level & dark]
        landings.append(start[rows] - t[rows, None] * up)
    points = np.concatenate(landings)
    # The same floor is found from several heights: keep one of each.
    cell = max(box.size, 1e-9) * 1e-3
    first = np.unique(np.round(points / cell).astype(np.int64), axis=0, return_index=True)[1]
    first.sort()
    return points[first]

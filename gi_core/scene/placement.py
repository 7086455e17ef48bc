"""Where a mobile stands when nobody says: on the floor, with room around it, near the middle of things."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gi_core.scene.pilot import Box, Rays, spread
from gi_core.scene.types import Pose, Scene

LARGEST, SHRUNK = 1 / 3, 1 / 6  # of the scene's size: a mobile larger than the one is scaled to the other
SMALLEST, GROWN = 1 / 50, 1 / 8  # the same for one that would be lost: metres in a scene of millimetres
GRID = 28  # candidate columns along each horizontal side of the useful box
LEVELS = (0.12, 0.35, 0.6, 0.9)  # heights in the box from which candidates are sought downwards
LEVEL_COSINE = 0.97  # a floor is level to 14 degrees
CLEARANCE = 1.15  # of the mobile's own radius
RING = np.linspace(0, 2 * np.pi, 12, endpoint=False)
SPHERE = 48  # directions that decide whether a place is inside a room
ROOM = 0.7  # share of them that hit something near: an open front leaves that much


class Spot(NamedTuple):
    """A place on the floor."""

    point: np.ndarray  # (3,) [m]
    headroom: float  # [m], inf in the open
    found: bool  # False: no floor with room enough, this is a guess


def place(scene: Scene, index: int, file_up, rays: Rays, box: Box) -> Scene:
    """Return the scene with one mobile resting on the floor.

    file_up: the up axis of the mobile's file: the mesh is turned upright, its bottom's centre becomes its
    origin, and it is scaled, with a note, if it does not fit. None: the mesh stays as it is.
    """
    mobile = scene.mobiles[index]
    up = np.array(scene.up)
    mesh, notes = mobile.mesh, []
    if file_up is not None:
        R = turn(np.asarray(file_up, np.float64), up)
        mesh = mesh._replace(vertices=mesh.vertices @ R.T)
        if mesh.corner_normals is not None:
            mesh = mesh._replace(corner_normals=mesh.corner_normals @ R.T)
        mesh = mesh._replace(vertices=mesh.vertices - bottom_centre(mesh.vertices, up))
        longest = float(np.ptp(mesh.vertices, axis=0).max())
        share = longest / box.size
        factor = SHRUNK / share if share > LARGEST else GROWN / share if share < SMALLEST else 1.0
        if factor != 1.0:
            mesh = mesh._replace(vertices=mesh.vertices * factor)
            notes.append(
                f'mobile "{mobile.name}" scaled by {factor:.3g}: it is {longest:.3g} long in a scene of {box.size:.3g}'
            )
    bottom = bottom_centre(mesh.vertices, up)
    off = mesh.vertices - bottom
    height = float((off @ up).max())
    flat = off - (off @ up)[:, None] * up
    spot = floor_spot(scene, rays, box, height, float(np.sqrt((flat * flat).sum(axis=1)).max()))
    if not spot.found:
        notes.append(f'no free floor found for mobile "{mobile.name}": it stands where there is most room; drag it')
    pose = Pose(tuple(float(x) for x in spot.point - bottom))
    placed = mobile._replace(mesh=mesh, pose=pose)
    mobiles = (*scene.mobiles[:index], placed, *scene.mobiles[index + 1 :])
    return replace(scene, mobiles=mobiles, notes=(*scene.notes, *notes))


def floor_spot(scene: Scene, rays: Rays, box: Box, height: float, radius: float) -> Spot:
    """Return the best place for something of this height and radius around it."""
    up = np.array(scene.up)
    east, north = horizontal(up)
    points = _candidates(rays, box, up, east, north)
    if not len(points):
        centre = (box.low + box.high) / 2
        low = centre - up * float(up @ (centre - np.where(up > 0, box.low, box.high)))
        return Spot(low, np.inf, False)
    lift = max(height * 0.02, 1e-4 * box.size)
    n = len(points)

    # Headroom, and what a column of the mobile's size would touch.
    above, _ = rays.hits(points + up * lift, np.broadcast_to(up, points.shape))
    ring = [np.cos(a) * east + np.sin(a) * north for a in RING]
    free = np.zeros(n)
    for share in (0.1, 0.5, 0.9):
        start = points + up * max(share * height, lift)
        for d in ring:
            t, _ = rays.hits(start, np.broadcast_to(d, points.shape))
            free += t > radius * CLEARANCE
    for d in ring:
        for reach in (0.5, 1.0):
            start = points + d * radius * reach + up * height
            t, _ = rays.hits(start, np.broadcast_to(-up, points.shape))
            free += np.abs(t - height) < 2 * lift
    free /= len(RING) * 5
    fits = (above > height * 1.02) & (free > 0.999)

    # Inside a room: rays to most sides hit something before long.
    around = _sphere(SPHERE)
    start = points + up * min(height, box.size * 0.1)
    inside = np.zeros(n)
    for d in around:
        t, _ = rays.hits(start, np.broadcast_to(d, points.shape))
        inside += t < 1.5 * box.size
    inside /= SPHERE

    # Of the floors, the one with most candidates; near the middle, in the light; where a room is open, by the
    # opening, since one looks in from there.
    level = np.round((points @ up) / max(0.03 * box.size, 1e-9)).astype(np.int64)
    _, index, counts = np.unique(level, return_inverse=True, return_counts=True)
    popular = counts[index.reshape(-1)] / counts.max()
    off = points - (box.low + box.high) / 2
    off -= (off @ up)[:, None] * up
    distance = np.sqrt((off * off).sum(axis=1)) / box.size
    room = 1.0 * (inside > ROOM) if (fits & (inside > ROOM)).any() else 0.0
    lit = _light_on(points, box, up)
    prominent = _outlook(points + up * 0.6 * height, rays, box)
    score = 4.0 * fits + 2.0 * room + prominent + 1.5 * lit + 1.5 * popular + free + 3.0 * (1 - inside) - 1.5 * distance
    best = int(np.argmax(score))
    return Spot(points[best], float(above[best]), bool(fits[best]))


def _outlook(points, rays: Rays, box: Box) -> np.ndarray:
    """Return the share (n,) of the lit scene that is seen from each place: a nook behind a cupboard sees little."""
    seen, weight = spread(box, 60)
    total = np.zeros(len(points))
    for target, w in zip(seen, weight, strict=True):
        d = target - points
        length = np.sqrt((d * d).sum(axis=1))
        t, _ = rays.hits(points, d / np.maximum(length, 1e-12)[:, None])
        total += w * (t > length - 2e-3 * box.size)
    return total


def _light_on(points, box: Box, up) -> np.ndarray:
    """Return how much light falls on each place (n,), 1 on the lighter half of them."""
    from scipy.spatial import cKDTree

    if not len(box.hits):
        return np.ones(len(points))
    flat = np.eye(3) + 3 * np.outer(up, up)  # heights count fourfold: light on the floor, not on the walls
    counts = cKDTree(box.hits @ flat).query_ball_point(points @ flat, 0.08 * box.size, return_length=True)
    return np.minimum(counts / max(float(np.median(counts[counts > 0])) if counts.any() else 1.0, 1.0), 1.0)


def _candidates(rays: Rays, box: Box, up, east, north):
    """Return level points (n, 3) that face up, found by rays down through the useful box."""
    corners = np.array([[(box.low, box.high)[(k >> a) & 1][a] for a in range(3)] for k in range(8)])
    u, v, h = corners @ east, corners @ north, corners @ up
    grid = (np.arange(GRID) + 0.5) / GRID
    found = []
    for share in LEVELS:
        x, y = np.meshgrid(u.min() + grid * np.ptp(u), v.min() + grid * np.ptp(v))
        z = h.min() + share * np.ptp(h)
        start = x.reshape(-1, 1) * east + y.reshape(-1, 1) * north + z * up
        t, face = rays.hits(start, np.broadcast_to(-up, start.shape))
        hit = np.flatnonzero(face >= 0)
        normal = rays.surfaces.normals[face[hit]]
        facing = normal @ up
        level = (facing > LEVEL_COSINE) | ((facing < -LEVEL_COSINE) & rays.surfaces.two_sided[face[hit]])
        dark = rays.surfaces.emission[face[hit]].max(axis=1) == 0
        rows = hit[level & dark]
        found.append(start[rows] - t[rows, None] * up)
    points = np.concatenate(found)
    # The same floor is found from several heights: keep one of each.
    cell = max(box.size, 1e-9) * 1e-3
    first = np.unique(np.round(points / cell).astype(np.int64), axis=0, return_index=True)[1]
    first.sort()
    return points[first]


def bottom_centre(vertices: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the centre of the bottom of a box, upright along `up`, around the vertices."""
    east, north = horizontal(up)
    middle = [(vertices @ d).min() / 2 + (vertices @ d).max() / 2 for d in (east, north)]
    return middle[0] * east + middle[1] * north + (vertices @ up).min() * up


def horizontal(up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors that are horizontal and at right angles."""
    axis = np.eye(3)[int(np.argmin(np.abs(up)))]
    east = np.cross(up, axis)
    east /= np.sqrt((east * east).sum())
    return east, np.cross(up, east)


def turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of least angle that carries unit vector a to b."""
    c = float(a @ b)
    if c < -1 + 1e-9:
        e = horizontal(a)[0]
        return 2 * np.outer(e, e) - np.eye(3)
    k = np.cross(a, b)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + K + K @ K / (1 + c)


def _sphere(n: int) -> np.ndarray:
    """Return n directions spread evenly (a Fibonacci spiral)."""
    k = np.arange(n)
    z = 1 - (2 * k + 1) / n
    r, a = np.sqrt(1 - z * z), k * np.pi * (3 - np.sqrt(5))
    return np.stack([r * np.cos(a), r * np.sin(a), z], axis=1)

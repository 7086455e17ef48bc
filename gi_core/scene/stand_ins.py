"""A light and a camera for scenes that bring none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.pose import to_world
from gi_core.scene.paint import join_paints
from gi_core.scene.pilot import Box, Rays, spread
from gi_core.scene.placement import floor_spot, horizontal
from gi_core.scene.types import Camera, Material, Mesh, Scene

RADIANCE = 10.0  # [W/m2/sr]; exposure is metered, so only its colour matters
LAMP_DROP = 0.03  # of the headroom: the lamp hangs that far below the ceiling
LAMP_SIDE = 0.3  # of the headroom
OPEN_HEIGHT, OPEN_SIDE = 1.0, 0.5  # of the scene's size, above the highest lit point where there is no ceiling
OUTSIDE_FOV, INSIDE_FOV = 40.0, 65.0  # degrees
OUTSIDE_BONUS = 0.2
SAMPLE = 240  # points of the scene whose visibility is counted for each camera tried
SHOWN = 24  # and of the mobile
SEE_THROUGH = 4  # back faces of one-sided surfaces that a sight line may pass


def default_light(scene: Scene, rays: Rays, box: Box) -> Scene:
    """Return the scene with a square lamp over the first mobile (or the floor's middle), facing down."""
    up = np.array(scene.up)
    stand = _subject(scene, rays, box)
    start = stand + up * 1e-3 * box.size
    if scene.mobiles:
        v = scene.mobiles[0].mesh.vertices
        start = stand + up * float((v @ up).max() * 1.02)
    t, _ = rays.hits(start[None], up[None])
    headroom = float(t[0] + (start - stand) @ up)
    east, north = horizontal(up)
    if np.isfinite(headroom):
        centre = stand + up * headroom * (1 - LAMP_DROP)
        side = LAMP_SIDE * headroom
        where = "below the ceiling"
    else:
        top = max(float(box.low @ up), float(box.high @ up))
        centre = stand + up * (top - float(stand @ up) + OPEN_HEIGHT * box.size)
        side = OPEN_SIDE * box.size
        where = "above the scene"
    corners = np.array([centre + side / 2 * (a * east + b * north) for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))])
    if np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ up > 0:
        corners = corners[::-1]
    material = Material("default light", (0.0, 0.0, 0.0), (RADIANCE,) * 3)
    static = _with_quad(scene, corners, -up)
    note = f"no light in the file: a lamp of {side:.3g} x {side:.3g} m hangs {where}"
    return replace(scene, static=static, materials=(*scene.materials, material), notes=(*scene.notes, note))


def _with_quad(scene: Scene, corners: np.ndarray, normal: np.ndarray) -> Mesh:
    m = scene.static
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + len(m.vertices)
    normals, colours = m.corner_normals, m.face_reflectance
    quad = Mesh(corners, faces, np.zeros(2, np.int32), None, np.zeros((2, 3)))
    return Mesh(
        np.concatenate([m.vertices, corners]),
        np.concatenate([m.faces, faces]).astype(np.int32),
        np.concatenate([m.face_material, [len(scene.materials)] * 2]).astype(np.int32),
        None if normals is None else np.concatenate([normals, np.broadcast_to(normal, (2, 3, 3))]),
        None if colours is None else np.concatenate([colours, np.zeros((2, 3))]),
        join_paints([m, quad], scene.materials),
    )


def default_camera(scene: Scene, rays: Rays, box: Box) -> Camera:
    """Return the camera, of many tried outside and inside, that sees most of where light goes, and the mobile."""
    up = np.array(scene.up)
    east, north = horizontal(up)
    stand = _subject(scene, rays, box)
    subject = stand + up * 0.04 * box.size
    shown = subject[None]
    if scene.mobiles:
        mesh, pose = scene.mobiles[0].mesh, scene.mobiles[0].pose
        shown = to_world(pose, mesh.vertices[:: max(len(mesh.vertices) // SHOWN, 1)])
        subject = (shown.min(axis=0) + shown.max(axis=0)) / 2
    seen = spread(box, SAMPLE)
    middle = (box.low + box.high) / 2

    tries = []
    radius = float(np.sqrt(((box.high - box.low) ** 2).sum())) / 2
    far = radius / np.sin(np.radians(OUTSIDE_FOV / 2)) * 0.95
    for elevation in (8.0, 22.0, 40.0):
        for azimuth in np.arange(0, 360, 15.0) + 30.0:
            tries.append((middle + far * _direction(azimuth, elevation, up, east, north), middle, OUTSIDE_FOV))
    for elevation in (5.0, 15.0, 28.0):
        for azimuth in np.arange(0, 360, 15.0):
            d = _direction(azimuth, elevation, up, east, north)
            t, _ = rays.hits(subject[None], d[None])
            for share in (0.6, 0.92):
                reach = min(share * float(t[0]), 1.2 * box.size)
                tries.append((subject + reach * d, subject, INSIDE_FOV))
    # From outside one sees the whole at once: it wins unless walls hide much of it.
    scores = [
        _score(p, target, fov, seen, shown, rays, box) + (OUTSIDE_BONUS if fov == OUTSIDE_FOV else 0.0)
        for p, target, fov in tries
    ]
    position, target, fov = tries[int(np.argmax(scores))]
    return Camera(tuple(map(float, position)), tuple(map(float, target)), fov)


def _score(position, target, fov, seen, shown, rays: Rays, box: Box) -> float:
    """Return the share of the lit scene in view and unhidden, plus that of the mobile and a little for its size."""
    forward = target - position
    distance = float(np.sqrt((forward * forward).sum()))
    if distance < 0.15 * box.size:
        return -1.0
    points, weight = seen
    to = np.concatenate([points, shown]) - position
    length = np.sqrt((to * to).sum(axis=1))
    d = to / np.maximum(length, 1e-12)[:, None]
    in_view = d @ (forward / distance) > np.cos(np.radians(fov / 2 * 1.1))
    visible = in_view & _unhidden(rays, position, d, length - 2e-3 * box.size)
    n = len(points)
    reach = float(np.sqrt((np.ptp(shown, axis=0) ** 2).sum())) / float(np.median(length[n:]))
    return float(weight @ visible[:n]) + (0.6 + min(reach, 0.4)) * float(visible[n:].mean())


def _unhidden(rays: Rays, position, d, length) -> np.ndarray:
    """Return whether each sight line gets that far; back faces of one-sided surfaces are not drawn."""
    at = np.zeros(len(d))
    blocked = np.zeros(len(d), bool)
    going = np.arange(len(d))
    for _ in range(SEE_THROUGH):
        t, face = rays.hits(position + d[going] * at[going, None], d[going])
        at[going] += t
        short = at[going] < length[going]
        backs = np.zeros(len(going), bool)
        hit = face >= 0
        turned = (rays.surfaces.normals[face[hit]] * d[going[hit]]).sum(axis=1) > 0
        backs[hit] = turned & ~rays.surfaces.two_sided[face[hit]]
        blocked[going[short & ~backs]] = True
        going = going[short & backs]
        if not len(going):
            break
        at[going] += 1e-5 * rays.extent
    blocked[going] = True
    return ~blocked


def _direction(azimuth, elevation, up, east, north) -> np.ndarray:
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.cos(e) * (np.cos(a) * east + np.sin(a) * north) + np.sin(e) * up


def _subject(scene: Scene, rays: Rays, box: Box) -> np.ndarray:
    """Return where the first mobile stands, or could stand."""
    if scene.mobiles:
        return np.array(scene.mobiles[0].pose.position)
    return floor_spot(scene, rays, box, box.size / 8, box.size / 16).point

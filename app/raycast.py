"""The picture without OpenGL: camera rays against the scene, Gouraud interpolation of the same vertex colours.

Seen sides, culling, tone map and background follow the viewer's renderer, so that a picture from here and a
screenshot from there differ only in their edges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from app.camera import Turntable
from app.tonemap import to_display
from app.vertex_colours import DrawMesh
from gi_core.accelerator import Accelerator, Transforms, nearest_in_world

BACKGROUND = (0.145, 0.15, 0.16)  # display values, those of the renderer (a test compares them)
UNLIT = (0.24, 0.245, 0.255)  # the back of a one-sided face, where it is drawn at all
# Where the rays of a pixel go: a rotated grid, so that edges near the axes get all four levels.
SAMPLES = np.array([[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]])
RAYS = 1 << 17  # a batch: enough for embree, small enough for the cache
LAYERS = 64  # backs that a ray may pass through
STEP_PAST = 4e-6  # of the scene's size and the distance gone: clears a face whose back is not drawn (float32: 6e-8)


class World(NamedTuple):
    """All objects at their poses, faces in global order."""

    corners: np.ndarray  # (F, 3, 3) float32 [m]
    normals: np.ndarray  # (F, 3) float32, any length, towards the front
    draw: np.ndarray  # (F, 3) int64 into the colours of all objects
    one_sided: np.ndarray  # (F,) bool
    size: float  # [m] longest side of the box around everything


def place(meshes: Sequence[DrawMesh], at: Transforms) -> World:
    """Carry the draw meshes (static part first) to where they are."""
    corners, draw, one_sided, first = [], [], [], 0
    for o, mesh in enumerate(meshes):
        points = mesh.positions.astype(np.float64) @ at.rotation[o].T + at.position[o]
        corners.append(points[mesh.triangles])
        draw.append(mesh.triangles.astype(np.int64) + first)
        one_sided.append(mesh.back[mesh.triangles[:, 0]] < 0)
        first += len(mesh.positions)
    p = np.concatenate(corners)
    normals = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    box = p.reshape(-1, 3)
    size = float(np.ptp(box, axis=0).max()) if len(box) else 1.0
    return World(
        p.astype(np.float32), normals.astype(np.float32), np.concatenate(draw), np.concatenate(one_sided), size
    )


def picture(
    accelerator: Accelerator,
    at: Transforms,
    meshes: Sequence[DrawMesh],
    colours: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: Turntable,
    size: tuple[int, int],
    exposure: float,
    tone_map: str = "aces",
    cull: bool = True,
    progress: Callable[[float], None] = lambda fraction: None,
) -> np.ndarray:
    """Return the picture (height, width, 3) uint8.

    `colours` has linear radiance of front and back (D, 3) an object; `size` is (width, height) pixels.
    """
    width, height = size
    world = place(meshes, at)
    front, back = (np.concatenate([c[side] for c in colours]) for side in (0, 1))
    out = np.empty((height, width, 3), np.uint8)
    rows = max(1, RAYS // (width * len(SAMPLES)))
    for top in range(0, height, rows):
        progress(top / height)
        bottom = min(top + rows, height)
        origins, directions = _rays(camera, width, height, top, bottom)
        face, u, v = _first_seen(accelerator, at, world, origins, directions, cull)
        display = _shade(world, front, back, face, u, v, directions, exposure, tone_map)
        # Averaged after the tone map, as the samples of a GL framebuffer are: a burnt-out lamp keeps clean edges.
        mean = display.reshape(bottom - top, width, len(SAMPLES), 3).mean(axis=2, dtype=np.float32)
        out[top:bottom] = np.round(mean)
    return out


def _rays(camera: Turntable, width: int, height: int, top: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions (n, 3) float32 of rows top..bottom: row, column, sample."""
    right, upward, forward = camera.basis()
    t = np.tan(camera.fov / 2)
    x = (np.arange(width)[:, None] + SAMPLES[:, 0]) / width  # (width, samples)
    y = (np.arange(top, bottom)[:, None] + SAMPLES[:, 1]) / height
    across = ((2 * x - 1) * t * width / height)[None, :, :, None]
    along = ((1 - 2 * y) * t)[:, None, :, None]
    d = (forward + across * right + along * upward).reshape(-1, 3)
    d /= np.sqrt((d * d).sum(axis=1))[:, None]
    origins = np.broadcast_to(camera.eye().astype(np.float32), d.shape)
    return np.ascontiguousarray(origins), d.astype(np.float32)


def _first_seen(accelerator, at, world: World, origins, directions, cull: bool):
    """Return the face (n,) int32 that each ray shows, -1 for none, and barycentrics u, v of its corners 1, 2."""
    n = len(origins)
    face, u, v = np.full(n, -1, np.int32), np.zeros(n, np.float32), np.zeros(n, np.float32)
    going, o, d = np.arange(n), origins, directions
    for _ in range(LAYERS):
        far = np.full(len(going), np.inf, np.float32)
        t, hit = nearest_in_world(accelerator, at, o, d, far)
        found = hit >= 0
        going, o, d, t, hit = going[found], o[found], d[found], t[found], hit[found]
        hidden = np.zeros(len(hit), bool)
        if cull:
            hidden = world.one_sided[hit] & ((world.normals[hit] * d).sum(axis=1) >= 0)
        seen = ~hidden
        rows = going[seen]
        face[rows] = hit[seen]
        u[rows], v[rows] = _barycentrics(world.corners[hit[seen]], o[seen], d[seen])
        if not hidden.any():
            break
        # Go on behind the faces whose backs are not drawn.
        past = t[hidden] * (1 + STEP_PAST) + np.float32(STEP_PAST * world.size)
        going, d = going[hidden], d[hidden]
        o = o[hidden] + past[:, None] * d
    return face, u, v


def _barycentrics(corners: np.ndarray, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights of corners 1 and 2 where a ray meets a triangle, kept inside it."""
    e1, e2, s = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], o - corners[:, 0]
    h, q = np.cross(d, e2), np.cross(s, e1)
    det = (e1 * h).sum(axis=1)
    inverse = np.where(det != 0, 1 / np.where(det != 0, det, 1), 0)
    u = np.clip((s * h).sum(axis=1) * inverse, 0, 1)
    return u, np.clip((d * q).sum(axis=1) * inverse, 0, 1 - u)


def _shade(world: World, front, back, face, u, v, directions, exposure: float, tone_map: str) -> np.ndarray:
    """Return display values (n, 3) uint8."""
    out = np.empty((len(face), 3), np.uint8)
    out[:] = np.round(np.array(BACKGROUND) * 255)
    hit = np.flatnonzero(face >= 0)
    if not len(hit):
        return out
    f, u, v = face[hit], u[hit][:, None], v[hit][:, None]
    facing = (world.normals[f] * directions[hit]).sum(axis=1) < 0  # gl_FrontFacing
    a, b, c = (np.where(facing[:, None], front[k], back[k]) for k in world.draw[f].T)
    radiance = (1 - u - v) * a + u * b + v * c
    out[hit] = to_display(radiance, exposure, tone_map)
    out[hit[~facing & world.one_sided[f]]] = np.round(np.array(UNLIT) * 255)
    return out

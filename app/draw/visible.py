"""Faces that the rays of a picture see: behind culled faces and panes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from app.draw.camera import Turntable
from app.draw.draw_mesh import DrawMesh
from app.draw.lit_scene import LitScene
from gi_core.base.threads import run_ranges
from gi_core.base.vectors import cross, dot
from gi_core.display.vertex_light import meet_pieces
from gi_core.rays.accelerator import Transforms
from gi_core.rays.all_objects import nearest_in_world
from gi_core.rays.holes import BEYOND
from gi_core.scene.types import Texture

# Offsets of a pixel's rays: a rotated grid, so that edges near the axes get all four levels.
PIXEL_OFFSETS = np.array([[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]])
RAYS_PER_BATCH = 1 << 17  # enough for Embree, small enough for the cache


class PictureScene(NamedTuple):
    """All objects at their poses, faces in global order."""

    corners: np.ndarray  # (F, 3, 3) float32 [m]
    normals: np.ndarray  # (F, 3) float32, any length, towards the front
    draw: np.ndarray  # (F, 3) int64 into the colours of all objects
    one_sided: np.ndarray  # (F,) bool
    size: float  # [m] longest side of the box around everything
    base: np.ndarray  # (F,) int64, face of the structure of rays that each is a piece of
    first: np.ndarray  # (B + 1,) int64, pieces before those of each of these faces ...
    pieces: np.ndarray  # (p,) int64, ... faces that rays may meet there
    textures: tuple[Texture, ...]
    texture: np.ndarray  # (F,) int64 into textures, -1: none; or (0,): none at all
    uv: np.ndarray  # (F, 3, 2) float32, or (0, 3, 2)
    emission: np.ndarray  # (F, 3) float64 that a texture does not colour, or (0, 3)
    pane: np.ndarray  # (F, 4) float64, see DrawMesh, or (0, 4): none at all

    def met(self, face: np.ndarray, o: np.ndarray, d: np.ndarray) -> np.ndarray:
        """Return the faces (n,) that rays meet; face (n,): of the structure of rays."""
        out = np.empty(len(face), np.int64)
        meet_pieces(face, self.first, self.pieces, self.corners, o, d, out)
        return out


class PictureView(NamedTuple):
    """The camera of a picture and its pixels."""

    camera: Turntable  # relative to the model's origin
    width: int
    height: int
    cull: bool = True  # backs of one-sided faces are not seen


class Seen(NamedTuple):
    """Faces that some rays of a strip meet."""

    ray: np.ndarray  # (k,) int64, without repetition
    face: np.ndarray  # (k,) int64
    u: np.ndarray  # (k,) float32, as of Strip
    v: np.ndarray  # (k,) float32


class Strip(NamedTuple):
    """The rays of some rows of a picture, and the faces that they see."""

    rows: slice  # of the picture
    eye: np.ndarray  # (3,) float32
    directions: np.ndarray  # (n, 3) float32, by row, column, sample
    face: np.ndarray  # (n,) int32, -1: none
    u: np.ndarray  # (n,) float32, barycentric weight of corner 1
    v: np.ndarray  # (n,) float32, of corner 2
    panes: list[Seen]  # before them, near to far

    @property
    def rays(self) -> slice:
        """Numbers of the rays in the picture."""
        first = self.rows.start * (len(self.face) // (self.rows.stop - self.rows.start))
        return slice(first, first + len(self.face))

    def seen(self, hit: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return faces (n,), weights u and v (n,), and directions (n, 3) of the rays `hit`."""
        return self.face[hit], self.u[hit], self.v[hit], self.directions[hit]

    def resolved(self, values: np.ndarray) -> np.ndarray:
        """Return the means (rows, width, channels) float32 over the samples of each pixel of values (n, channels)."""
        shape = self.rows.stop - self.rows.start, -1, len(PIXEL_OFFSETS), values.shape[-1]
        return values.reshape(shape).mean(axis=2, dtype=np.float32)


Placed = Callable[[np.ndarray], tuple[PictureScene, np.ndarray]]


def place(meshes: Sequence[DrawMesh], at: Transforms) -> PictureScene:
    """Return the draw meshes (static part first) in world space."""
    corners, draw, one_sided, base, pieces, first, faces, bases = [], [], [], [], [], 0, 0, 0
    for o, mesh in enumerate(meshes):
        points = mesh.positions.astype(np.float64) @ at.rotation[o].T + at.position[o]
        corners.append(points[mesh.triangles])
        draw.append(mesh.triangles.astype(np.int64) + first)
        one_sided.append(mesh.back[mesh.triangles[:, 0]] < 0)
        number, source = np.arange(len(mesh.triangles)), mesh.source
        source = number if source is None else source.astype(np.int64)
        base.append(bases + source)
        pieces.append(np.stack([bases + source, faces + number]))
        if (other := mesh.quads.beside) is not None:
            pieces.append(np.stack([bases + source, faces + other])[:, other >= 0])
        first, faces = first + len(mesh.positions), faces + len(mesh.triangles)
        bases += int(source.max(initial=-1)) + 1
    p = np.concatenate(corners)
    normals = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    box = p.reshape(-1, 3)
    size = float(np.ptp(box, axis=0).max()) if len(box) else 1.0
    return PictureScene(
        p.astype(np.float32),
        normals.astype(np.float32),
        np.concatenate(draw),
        np.concatenate(one_sided),
        size,
        np.concatenate(base),
        *_by_base(np.concatenate(pieces, axis=1), bases),
        *(*_textures(meshes), _panes(meshes)),
    )


def _panes(meshes: Sequence[DrawMesh]) -> np.ndarray:
    """Return the panes (F, 4) of all faces; (0, 4) without any."""
    if all(mesh.pane is None for mesh in meshes):
        return np.zeros((0, 4))
    parts = (np.zeros((len(m.triangles), 4)) if m.pane is None else m.pane[m.triangles[:, 0]] for m in meshes)
    return np.concatenate(list(parts)).astype(np.float64)


def _by_base(pieces: np.ndarray, bases: int) -> tuple[np.ndarray, np.ndarray]:
    """Return pieces before those of each face, and pieces; pieces (2, p): faces of the structure of rays, pieces."""
    order = np.argsort(pieces[0], kind="stable")
    return np.searchsorted(pieces[0][order], np.arange(bases + 1)), pieces[1][order]


def _textures(meshes: Sequence[DrawMesh]):
    """Return the textures of all objects, and the texture, corner coordinates and emission of each face."""
    textures = tuple(t for mesh in meshes for t in mesh.textures)
    if not textures:
        return (), np.zeros(0, np.int64), np.zeros((0, 3, 2), np.float32), np.zeros((0, 3))
    texture, uv, emission, first = [], [], [], 0
    for mesh in meshes:
        corner = mesh.triangles[:, 0]
        plain = mesh.texture is None
        number = np.full(len(corner), -1) if plain else mesh.texture[corner].astype(np.int64)
        texture.append(np.where(number < 0, -1, number + first))
        uv.append(np.zeros((len(corner), 3, 2), np.float32) if plain else mesh.uv[mesh.triangles])
        emission.append(mesh.emission[corner])
        first += len(mesh.textures)
    return textures, np.concatenate(texture), np.concatenate(uv), np.concatenate(emission)


def _cast(lit: LitScene, world: PictureScene, view: PictureView, top: int, bottom: int) -> Strip:
    """Cast the rays of rows top..bottom of a picture."""
    origins, directions = pixel_rays(view, top, bottom)
    panes: list[Seen] = []
    seen = visible_faces(lit, lambda hit: (world, hit), origins, directions, view.cull, panes)
    return Strip(slice(top, bottom), origins[0], directions, *(*seen, panes))


def draw_strips(
    draw: Callable[[Strip], None],
    lit: LitScene,
    world: PictureScene,
    view: PictureView,
    progress: Callable[[float], None] = lambda fraction: None,
    cast: list[Strip] | None = None,
) -> None:
    """Call draw(strip) for all strips of a picture, as many at a time as the accelerator has threads.

    cast: the strips in order, None: rays are to be cast.
    """
    rows, threads = max(1, RAYS_PER_BATCH // (view.width * len(PIXEL_OFFSETS))), lit.model.accelerator.threads
    count = -(-view.height // rows)
    for first in range(0, count, threads):
        progress(first * rows / view.height)

        def work(_, a, b, first=first):
            for k in range(first + a, first + b):
                bottom = min((k + 1) * rows, view.height)
                draw(_cast(lit, world, view, k * rows, bottom) if cast is None else cast[k])

        run_ranges(work, min(threads, count - first), threads, 1)


def pixel_rays(view: PictureView, top: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions (n, 3) float32 of rows top..bottom: row, column, sample."""
    camera, width, height, _ = view
    right, upward, forward = camera.basis()
    t = np.tan(camera.fov / 2)
    x = (np.arange(width)[:, None] + PIXEL_OFFSETS[:, 0]) / width  # (width, samples)
    y = (np.arange(top, bottom)[:, None] + PIXEL_OFFSETS[:, 1]) / height
    across = ((2 * x - 1) * t * width / height)[None, :, :, None]
    along = ((1 - 2 * y) * t)[:, None, :, None]
    d = (forward + across * right + along * upward).reshape(-1, 3)
    d /= np.sqrt((d * d).sum(axis=1))[:, None]
    origins = np.broadcast_to(camera.eye().astype(np.float32), d.shape)
    return np.ascontiguousarray(origins), d.astype(np.float32)


def visible_faces(
    lit: LitScene, placed: Placed, origins, directions, cull: bool, panes: list[Seen] | None = None
):  # fmt: skip
    """Return the visible face (n,) int32 per ray, -1 for none, and barycentric weights u, v of corners 1, 2.

    placed: returns for faces (n,) a scene that has them, and their rows there. panes: gets those before these faces.
    """
    n = len(origins)
    face, u, v = np.full(n, -1, np.int32), np.zeros(n, np.float32), np.zeros(n, np.float32)
    going, o, d = np.arange(n), origins, directions
    for _ in range(64):  # 64 culled faces along a ray at most
        far = np.full(len(going), np.inf, np.float32)
        t, hit = nearest_in_world(lit.model.accelerator, lit.at, o, d, far)
        is_hit = hit >= 0
        going, o, d, t, hit = going[is_hit], o[is_hit], d[is_hit], t[is_hit], hit[is_hit]
        world, at_hit = placed(hit)
        met = world.met(at_hit, o, d)
        hit, at_hit = hit + met - at_hit, met  # rows differ from faces only in scenes of some faces, without quads
        hidden = np.zeros(len(hit), bool)
        if len(world.pane):
            glass = np.flatnonzero(world.pane[at_hit, 3] > 0)
            hidden[glass] = True
            if panes is not None and len(glass):
                f = at_hit[glass]
                panes.append(Seen(going[glass], f, *barycentrics(world.corners[f], o[glass], d[glass])))
        if cull:
            hidden |= world.one_sided[at_hit] & ((world.normals[at_hit] * d).sum(axis=1) >= 0)
        seen = ~hidden
        rows = going[seen]
        face[rows] = hit[seen]
        u[rows], v[rows] = barycentrics(world.corners[at_hit[seen]], o[seen], d[seen])
        if not hidden.any():
            break
        # Continue behind culled faces and panes.
        reach = np.abs(world.corners[at_hit[hidden]]).max(axis=(1, 2), initial=0.0)
        past = t[hidden] * (1 + BEYOND) + np.float32(BEYOND) * reach
        going, d = going[hidden], d[hidden]
        o = o[hidden] + past[:, None] * d
    return face, u, v


def barycentrics(corners: np.ndarray, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return barycentric weights (n,) of corners 1 and 2 at hits of rays, clamped to the triangle; see planar()."""
    u, v = planar(corners, o, d)
    u = np.clip(u, 0, 1)
    return u, np.clip(v, 0, 1 - u)


def planar(corners: np.ndarray, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return barycentric weights (n,) of corners 1 and 2 where rays meet the planes of triangles (n, 3, 3).

    o, d (n, 3) or (3,): origins and directions, all of one dtype.
    """
    e1, e2, s = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], o - corners[:, 0]
    h, q = cross(d, e2).astype(d.dtype, copy=False), cross(s, e1).astype(d.dtype, copy=False)
    det = dot(e1, h)
    inverse = np.where(det != 0, 1 / np.where(det != 0, det, 1), 0)
    return dot(s, h) * inverse, dot(d, q) * inverse

"""The picture without OpenGL: ray casting, Gouraud interpolation of the same vertex colours.

Textures are filtered over the whole pixel per ray, as in GL. Sides, culling, tone map and background follow the
renderer, so the two pictures differ only along edges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from app.draw.camera import Turntable
from app.draw.draw_mesh import DrawMesh, part_of
from app.draw.false_colour import Scale, false_colours
from app.draw.tonemap import to_display
from app.draw.vertex_colours import colours, weights
from app.draw.white_balance import NEUTRAL, Gains
from gi_core.base.vectors import cross, dot
from gi_core.display.dilation import Drawn
from gi_core.geometry.cutouts import covered
from gi_core.geometry.error import luminance
from gi_core.geometry.texture_filter import lookup
from gi_core.geometry.texture_footprint import footprints
from gi_core.rays.accelerator import Accelerator, Transforms, nearest_in_world
from gi_core.scene.types import Texture

BACKGROUND = (0.145, 0.15, 0.16)  # display values, those of the renderer (a test compares them)
UNLIT = (0.24, 0.245, 0.255)  # the back of a one-sided face without culling
# Offsets of a pixel's rays: a rotated grid, so that edges near the axes get all four levels.
PIXEL_OFFSETS = np.array([[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]])
RAYS_PER_BATCH = 1 << 17  # enough for Embree, small enough for the cache
GRID_ROWS = 16  # of rays that measure visible light, times the samples of a pixel
MAX_CULLED = 64  # culled faces along a ray
CULLED_OFFSET = 4e-6  # of the scene size and the distance: step beyond a culled face (float32: 6e-8)


class PictureScene(NamedTuple):
    """All objects at their poses, faces in global order."""

    corners: np.ndarray  # (F, 3, 3) float32 [m]
    normals: np.ndarray  # (F, 3) float32, any length, towards the front
    draw: np.ndarray  # (F, 3) int64 into the colours of all objects
    one_sided: np.ndarray  # (F,) bool
    size: float  # [m] longest side of the box around everything
    textures: tuple[Texture, ...]
    texture: np.ndarray  # (F,) int64 into textures, -1: none; or (0,): none at all
    uv: np.ndarray  # (F, 3, 2) float32, or (0, 3, 2)
    emission: np.ndarray  # (F, 3) float64 that a texture does not colour, or (0, 3)


class Strip(NamedTuple):
    """The rays of some rows of a picture, and the faces that they see."""

    rows: slice  # of the picture
    eye: np.ndarray  # (3,) float32
    directions: np.ndarray  # (n, 3) float32, by row, column, sample
    face: np.ndarray  # (n,) int32, -1: none
    u: np.ndarray  # (n,) float32, barycentric weight of corner 1
    v: np.ndarray  # (n,) float32, of corner 2

    def seen(self, hit: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return faces, weights and directions of some rays."""
        return self.face[hit], self.u[hit], self.v[hit], self.directions[hit]

    def resolved(self, values: np.ndarray) -> np.ndarray:
        """Return the means (rows, width, channels) float32 over the samples of each pixel of values (n, channels)."""
        shape = self.rows.stop - self.rows.start, -1, len(PIXEL_OFFSETS), values.shape[-1]
        return values.reshape(shape).mean(axis=2, dtype=np.float32)


Placed = Callable[[np.ndarray], tuple[PictureScene, np.ndarray]]
Sharp = Callable[[PictureScene, np.ndarray, np.ndarray, Strip, np.ndarray], tuple[np.ndarray, np.ndarray]]


def place(meshes: Sequence[DrawMesh], at: Transforms) -> PictureScene:
    """Return the draw meshes (static part first) in world space."""
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
    return PictureScene(
        p.astype(np.float32),
        normals.astype(np.float32),
        np.concatenate(draw),
        np.concatenate(one_sided),
        size,
        *_textures(meshes),
    )


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
    textured: bool = True,
    weights: Sequence[np.ndarray | None] | None = None,
    scale: Scale | None = None,
    gains: Gains = NEUTRAL,
    gloss: Sequence[tuple[np.ndarray, np.ndarray] | None] | None = None,
    sharp: Sharp | None = None,
) -> np.ndarray:
    """Return the picture (height, width, 3) uint8.

    `colours` has linear radiance of front and back (D, 3) per object; `size` is (width, height) pixels.
    `textured`: multiply by textures; `weights` has the interpolation weights of front and back (D, 2) per object,
    None for all 1; `scale`: false colours in place of the tone map, of `colours` E / pi; `gains`: white balance;
    `gloss`: radiance (D, 3) above the texture of front and back per object, None where there is none; `sharp`: returns
    which of some hits of a strip reflect sharply, and the radiance of their gloss in place of `gloss`.
    """
    width, height = size
    world = place(meshes, at)
    weights = [None] * len(meshes) if weights is None else weights
    front, back = both_sides(colours, weights)
    above = above_textures(meshes, gloss, weights)
    out = np.empty((height, width, 3), np.uint8)
    pixel = pixel_steps(camera, width, height)
    steps = pixel if textured and world.textures else None
    for strip in strips(accelerator, at, world, camera, size, cull, progress):
        # Mean after the tone map, as in a GL framebuffer: a saturated lamp keeps clean edges.
        display = _shade(world, front, back, strip, exposure, tone_map, steps, scale, gains, above, pixel, sharp)
        out[strip.rows] = np.round(strip.resolved(display))
    return out


def strips(
    accelerator: Accelerator,
    at: Transforms,
    world: PictureScene,
    camera: Turntable,
    size: tuple[int, int],
    cull: bool = True,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Iterator[Strip]:
    """Cast the rays of a picture of `size` (width, height) pixels, strip by strip."""
    width, height = size
    rows = max(1, RAYS_PER_BATCH // (width * len(PIXEL_OFFSETS)))
    for top in range(0, height, rows):
        progress(top / height)
        bottom = min(top + rows, height)
        origins, directions = _rays(camera, width, height, top, bottom)
        seen = visible_faces(accelerator, at, lambda hit: (world, hit), origins, directions, cull)
        yield Strip(slice(top, bottom), origins[0], directions, *seen)


def both_sides(
    colours: Sequence[tuple[np.ndarray, np.ndarray]], weights: Sequence[np.ndarray | None]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the weighted colours (D, 4) of front and back of all objects."""
    front, back = (
        np.concatenate([weighted(c[side], w, side) for c, w in zip(colours, weights, strict=True)]) for side in (0, 1)
    )
    return front, back


def above_textures(
    meshes: Sequence[DrawMesh],
    gloss: Sequence[tuple[np.ndarray, np.ndarray] | None] | None,
    weights: Sequence[np.ndarray | None],
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the weighted radiance of gloss (D, 4) on front and back of all objects; None without gloss."""
    if gloss is None or all(g is None for g in gloss):
        return None
    none = ((np.zeros((len(mesh.positions), 3), np.float32),) * 2 for mesh in meshes)
    return both_sides([black if g is None else g for black, g in zip(none, gloss, strict=True)], weights)


def visible_irradiance(
    accelerator: Accelerator,
    at: Transforms,
    meshes: Sequence[DrawMesh],
    drawn: Drawn,
    camera: Turntable,
    aspect: float,
    cull: bool = True,
) -> np.ndarray:
    """Return the irradiance (n,) of the surface at a grid of rays over the picture, as luminance of RGB [W/m2].

    drawn: irradiance (R, 3) [W/m2] and weights of the picture; aspect: its width over its height.
    """
    size = float(np.subtract(camera.bounds.high, camera.bounds.low).max())

    def placed(hit: np.ndarray) -> tuple[PictureScene, np.ndarray]:
        some, rows = _parts(meshes, hit)
        return place(some, at)._replace(size=size), rows

    origins, directions = _rays(camera, max(round(aspect * GRID_ROWS), 1), GRID_ROWS, 0, GRID_ROWS)
    face, u, v = visible_faces(accelerator, at, placed, origins, directions, cull)
    hit = np.flatnonzero(face >= 0)
    some, rows = _parts(meshes, face[hit])
    world = place(some, at)
    pairs = [colours(mesh, drawn.irradiance, False) for mesh in some]
    front, back = both_sides(pairs, [weights(mesh, drawn.weights) for mesh in some])
    radiance, facing = seen_radiance(world, front, back, rows, u[hit], v[hit], directions[hit], None, origins[0])
    return math.pi * luminance(radiance[facing | ~world.one_sided[rows]])


def _parts(meshes: Sequence[DrawMesh], faces: np.ndarray) -> tuple[list[DrawMesh], np.ndarray]:
    """Return the meshes of some faces (n,) of all objects, and the row of each face among these meshes' faces."""
    first = np.cumsum([0, *(len(mesh.triangles) for mesh in meshes)])
    of = np.searchsorted(first, faces, "right") - 1
    rows = np.empty(len(faces), np.int64)
    rows[np.argsort(of, kind="stable")] = np.arange(len(faces))
    return [part_of(mesh, faces[of == o] - first[o]) for o, mesh in enumerate(meshes)], rows


def weighted(colours: np.ndarray, weights: np.ndarray | None, side: int) -> np.ndarray:
    """Return colours times their weights, and the weights. (D, 4) float32."""
    w = np.ones(len(colours), np.float32) if weights is None else weights[:, side]
    return np.c_[colours * w[:, None], w].astype(np.float32)


def _rays(camera: Turntable, width: int, height: int, top: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions (n, 3) float32 of rows top..bottom: row, column, sample."""
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


def visible_faces(accelerator, at, placed: Placed, origins, directions, cull: bool):
    """Return the visible face (n,) int32 per ray, -1 for none, and barycentric weights u, v of corners 1, 2.

    placed: returns for faces (n,) a scene that has them, and their rows there.
    """
    n = len(origins)
    face, u, v = np.full(n, -1, np.int32), np.zeros(n, np.float32), np.zeros(n, np.float32)
    going, o, d = np.arange(n), origins, directions
    for _ in range(MAX_CULLED):
        far = np.full(len(going), np.inf, np.float32)
        t, hit = nearest_in_world(accelerator, at, o, d, far)
        found = hit >= 0
        going, o, d, t, hit = going[found], o[found], d[found], t[found], hit[found]
        hidden = np.zeros(len(hit), bool)
        world, at_hit = placed(hit)
        if cull:
            hidden = world.one_sided[at_hit] & ((world.normals[at_hit] * d).sum(axis=1) >= 0)
        hidden |= _cut_away(world, at_hit, o, d)
        seen = ~hidden
        rows = going[seen]
        face[rows] = hit[seen]
        u[rows], v[rows] = barycentrics(world.corners[at_hit[seen]], o[seen], d[seen])
        if not hidden.any():
            break
        # Continue behind culled faces and through holes.
        past = t[hidden] * (1 + CULLED_OFFSET) + np.float32(CULLED_OFFSET * world.size)
        going, d = going[hidden], d[hidden]
        o = o[hidden] + past[:, None] * d
    return face, u, v


def _cut_away(world: PictureScene, hit: np.ndarray, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return whether hits (n,) lie in holes of textures."""
    away = np.zeros(len(hit), bool)
    for t, texture in enumerate(world.textures):
        rows = np.flatnonzero(world.texture[hit] == t) if texture.cover is not None else ()
        if len(rows):
            f = hit[rows]
            u, v = (w.astype(np.float64)[:, None] for w in barycentrics(world.corners[f], o[rows], d[rows]))
            uv = world.uv[f].astype(np.float64)
            away[rows] = ~covered(texture, (1 - u - v) * uv[:, 0] + u * uv[:, 1] + v * uv[:, 2])
    return away


def barycentrics(corners: np.ndarray, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return barycentric weights of corners 1 and 2 at a ray's hit, clamped to the triangle."""
    e1, e2, s = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], o - corners[:, 0]
    h, q = np.cross(d, e2), np.cross(s, e1)
    det = (e1 * h).sum(axis=1)
    inverse = np.where(det != 0, 1 / np.where(det != 0, det, 1), 0)
    u = np.clip((s * h).sum(axis=1) * inverse, 0, 1)
    return u, np.clip((d * q).sum(axis=1) * inverse, 0, 1 - u)


def _shade(
    world: PictureScene, front, back, strip: Strip, exposure, tone_map, steps, scale, gains, above, pixel, sharp
) -> np.ndarray:
    """Return display values (n, 3) uint8; pixel: of pixel_steps(), for isolines."""
    out = np.empty((len(strip.face), 3), np.uint8)
    out[:] = np.round(np.array(BACKGROUND) * 255)
    hit = np.flatnonzero(strip.face >= 0)
    if not len(hit):
        return out
    radiance, facing = seen_radiance(world, front, back, *strip.seen(hit), steps, strip.eye)
    if above is not None:
        radiance += gloss_seen(world, front, back, strip, hit, above, sharp)
    if scale is None:
        out[hit] = to_display(radiance, exposure, tone_map, gains)
    else:
        change = gradient(world, front, back, *strip.seen(hit), facing, pixel, strip.eye) if scale.lines else None
        to_middle = 0.5 - PIXEL_OFFSETS[hit % len(PIXEL_OFFSETS)]  # a line is the same in all samples, as in GL
        out[hit] = false_colours(radiance, scale, change, to_middle)
    out[hit[~facing & world.one_sided[strip.face[hit]]]] = np.round(np.array(UNLIT) * 255)
    return out


def gloss_seen(world: PictureScene, front, back, strip: Strip, hit: np.ndarray, above, sharp: Sharp | None):
    """Return the radiance (n, 3) of gloss at hits (n,) of a strip, of light at vertices or reflected."""
    radiance = seen_radiance(world, above[0], above[1], *strip.seen(hit), None, strip.eye)[0]
    if sharp is not None:
        rows, reflected = sharp(world, front, back, strip, hit)
        radiance[rows] = reflected
    return radiance


def seen_radiance(
    world: PictureScene, front, back, face, u, v, directions, steps, eye
) -> tuple[np.ndarray, np.ndarray]:
    """Return radiance (n, 3) of hits on faces (n,) at barycentric weights u, v (n,), and whether fronts are seen (n,).

    front, back (D, 4): colours of `weighted`; directions (n, 3) of the rays from eye (3,); steps: of `pixel_steps`, or
    None to leave textures out. Reflected rays have an eye (n, 3) and steps (n, 3, 3) each.
    """
    u, v = u[:, None], v[:, None]
    facing = (world.normals[face] * directions).sum(axis=1) < 0  # gl_FrontFacing
    a, b, c = _at_corners(world, front, back, face, facing)
    radiance = (1 - u - v) * a + u * b + v * c
    radiance = radiance[:, :3] / radiance[:, 3:]
    if steps is not None:
        eye, steps = np.broadcast_to(eye, (len(face), 3)), np.broadcast_to(steps, (len(face), 3, 3))
        _colour(world, radiance, face, u, v, facing, eye, directions, steps)
    return radiance, facing


def _at_corners(world: PictureScene, front, back, face, facing) -> list[np.ndarray]:
    """Return the colours (n, 4) of `weighted` at the three corners of faces (n,), of the sides that are seen."""
    return [np.where(facing[:, None], front[k], back[k]) for k in world.draw[face].T]


def gradient(world: PictureScene, front, back, face, u, v, directions, facing, pixel, eye) -> np.ndarray:
    """Return the change of luminance per pixel right and down (n, 2) at hits; arguments as for seen_radiance().

    pixel: of pixel_steps(). Rays of the neighbouring pixels meet the plane of the same face.
    """
    a, b, c = _at_corners(world, front, back, face, facing)
    seen = (1 - u - v)[:, None] * a + u[:, None] * b + v[:, None] * c
    per_weight, out = 1 / seen[:, 3], np.empty((len(face), 2))
    of_light = luminance(seen[:, :3]) * per_weight
    (light_u, weight_u), (light_v, weight_v) = ((luminance(d[:, :3]), d[:, 3]) for d in (b - a, c - a))
    corners, straight = world.corners[face], directions.astype(np.float64)
    straight = straight / (straight @ pixel[2])[:, None]
    u0, v0 = planar(corners, eye, straight)
    for k in range(2):
        u1, v1 = planar(corners, eye, straight + pixel[k])
        du, dv = u1 - u0, v1 - v0
        change = light_u * du + light_v * dv - of_light * (weight_u * du + weight_v * dv)
        out[:, k] = change * per_weight
    return out


def planar(corners: np.ndarray, eye: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return barycentric weights of corners 1 and 2 (n,) where rays d (n, 3) from eye (3,) meet the planes of faces."""
    p = corners.astype(np.float64)
    e1, e2, s = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0], np.asarray(eye, np.float64) - p[:, 0]
    h, q = cross(d, e2), cross(s, e1)
    det = dot(e1, h)
    inverse = np.where(det != 0, 1 / np.where(det != 0, det, 1), 0)
    return dot(s, h) * inverse, dot(d, q) * inverse


def pixel_steps(camera: Turntable, width: int, height: int) -> np.ndarray:
    """Return (3, 3) float64: offsets at unit depth for one pixel right and one pixel down, and the view direction."""
    right, upward, forward = camera.basis()
    step = 2 * np.tan(camera.fov / 2) / height  # pixels are square
    return np.stack([right * step, -upward * step, forward])


def _colour(world: PictureScene, radiance, face, u, v, facing, eye, directions, steps) -> None:
    """Multiply radiance (n, 3) by the visible faces' textures, in place."""
    number = world.texture[face]
    for t in np.unique(number[number >= 0]):
        rows = np.flatnonzero(number == t)
        f = face[rows]
        seen = footprints(world.corners, world.uv, f, u[rows], v[rows], eye[rows], directions[rows], steps[rows])
        glow = np.where(facing[rows, None], world.emission[f], 0.0)
        radiance[rows] = radiance[rows] * lookup(world.textures[t], *seen) + glow

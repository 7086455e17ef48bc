"""Radiance along rays of a picture without OpenGL: Gouraud interpolation of the same vertex colours.

Textures are filtered over the whole pixel per ray, as in GL. Sides and culling follow the renderer, so the two pictures
differ only along edges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.draw.camera import Turntable
from app.draw.draw_mesh import DrawMesh, part_of
from app.draw.false_colour import per_radiance
from app.draw.lit_scene import LitScene
from app.draw.vertex_colours import Gloss, mean_radiance
from app.draw.visible import PictureScene, PictureView, Strip, pixel_rays, place, planar, visible_faces
from app.settings import ILLUMINANCE, LUMINANCE
from gi_core.base.vectors import dot
from gi_core.geometry.error import luminance
from gi_core.geometry.texture_filter import footprints, lookup
from gi_core.rays.panes import shares_of


class Coloured(NamedTuple):
    """A placed scene and the colours of its draw vertices, times their weights, and the weights."""

    world: PictureScene
    front: np.ndarray  # (D, 4) float32
    back: np.ndarray  # (D, 4) float32


Sharp = Callable[[Coloured, Strip, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def both_sides(
    world: PictureScene, sides: Sequence[tuple[np.ndarray, np.ndarray]], weights: Sequence[np.ndarray | None]
) -> Coloured:
    """Return the colours of all objects; sides: (D, 3) of front and back per object; weights: `LitScene.weights`."""
    front, back = (
        np.concatenate([weighted(c[side], w, side) for c, w in zip(sides, weights, strict=True)]) for side in (0, 1)
    )
    return Coloured(world, front, back)


def above_textures(world: PictureScene, lit: LitScene, gloss: Gloss) -> Coloured | None:
    """Return the radiance of gloss of all objects of a lit scene; None without gloss."""
    if all(g is None for g in gloss):
        return None
    none = ((np.zeros((len(mesh.positions), 3), np.float32),) * 2 for mesh in lit.meshes)
    return both_sides(world, [black if g is None else g for black, g in zip(none, gloss, strict=True)], lit.weights)


def visible_light(lit: LitScene, camera: Turntable, aspect: float, cull: bool = True) -> np.ndarray:
    """Return the light (n,) of the surface at a grid of rays over the picture, as luminance of RGB.

    It is luminance [W/m2/sr], with mean textures and with gloss of light at vertices, where the lit scene shows
    radiance, else illuminance [W/m2]. camera: relative to the model's origin; aspect: the picture's width over its
    height.
    """
    grid_rows = 16  # of rays that measure visible light, times the samples of a pixel

    def placed(hit: np.ndarray) -> tuple[PictureScene, np.ndarray]:
        parts, rows = _parts(lit.meshes, hit)
        return place(parts, lit.at), rows

    view = PictureView(camera, max(round(aspect * grid_rows), 1), grid_rows, cull)
    origins, directions = pixel_rays(view, 0, grid_rows)
    face, u, v = visible_faces(lit, placed, origins, directions, cull)
    hit = np.flatnonzero(face >= 0)
    parts, rows = _parts(lit.meshes, face[hit])
    seen, pairs = replace(lit, meshes=tuple(parts)), []
    for mesh, pair, more in zip(parts, seen.sides, seen.gloss_towards(camera.eye()), strict=True):
        front, back = mean_radiance(mesh, *pair) if lit.shows_radiance else pair
        pairs.append((front, back) if more is None else (front + more[0], back + more[1]))
    faces = both_sides(place(parts, lit.at), pairs, seen.weights)
    radiance, facing = seen_radiance(faces, rows, u[hit], v[hit], directions[hit], None, origins[0])
    per = per_radiance(LUMINANCE if lit.shows_radiance else ILLUMINANCE)
    return per * luminance(radiance[facing | ~faces.world.one_sided[rows]])


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


def by_panes(faces: Coloured, strip: Strip) -> tuple[np.ndarray, np.ndarray]:
    """Return the transmittance (n, 3) of the panes before the hits of a strip, and the radiance (n, 3) they reflect.

    A pane reflects the mean of the light that meets it: its colours are those of a white surface.
    """
    world, through, veil = faces.world, np.ones((len(strip.face), 3)), np.zeros((len(strip.face), 3))
    for ray, face, u, v in strip.panes:
        d, normal = strip.directions[ray].astype(np.float64), world.normals[face].astype(np.float64)
        cosine = np.abs(dot(normal, d)) / np.maximum(np.sqrt(dot(normal, normal)), 1e-30)
        mirrored, passed = shares_of(world.pane[face], np.minimum(cosine, 1.0))
        light = seen_radiance(faces, face, u, v, strip.directions[ray], None, strip.eye)[0]
        veil[ray] += through[ray] * mirrored * np.maximum(light, 0.0)
        through[ray] *= passed
    return through, veil


def gloss_seen(faces: Coloured, strip: Strip, hit: np.ndarray, above: Coloured, sharp: Sharp | None, under: np.ndarray):
    """Return the radiance (n, 3) of gloss at hits (n,) of a strip, of light at vertices or reflected.

    under (n, 3): radiance of the hits without it.
    """
    radiance = seen_radiance(above, *strip.seen(hit), None, strip.eye)[0]
    if sharp is not None:
        rows, reflected = sharp(faces, strip, hit, under)
        radiance[rows] = reflected
    return radiance


def seen_radiance(faces: Coloured, face, u, v, directions, steps, eye) -> tuple[np.ndarray, np.ndarray]:
    """Return radiance (n, 3) of hits on faces (n,) at barycentric weights u, v (n,), and whether fronts are seen (n,).

    directions (n, 3) of the rays from eye (3,); steps: of `pixel_steps`, or None to leave textures out. Reflected
    rays have an eye (n, 3) and steps (n, 3, 3) each.
    """
    world, u, v = faces.world, u[:, None], v[:, None]
    facing = (world.normals[face] * directions).sum(axis=1) < 0  # gl_FrontFacing
    a, b, c = _at_corners(faces, face, facing)
    radiance = (1 - u - v) * a + u * b + v * c
    radiance = radiance[:, :3] / radiance[:, 3:]
    if steps is not None:
        eye, steps = np.broadcast_to(eye, (len(face), 3)), np.broadcast_to(steps, (len(face), 3, 3))
        _colour(world, radiance, face, u, v, facing, eye, directions, steps)
    return radiance, facing


def _at_corners(faces: Coloured, face, facing) -> list[np.ndarray]:
    """Return the colours (n, 4) of `weighted` at the three corners of faces (n,), of the sides that are seen."""
    return [np.where(facing[:, None], faces.front[k], faces.back[k]) for k in faces.world.draw[face].T]


def gradient(faces: Coloured, face, u, v, directions, facing, pixel, eye) -> np.ndarray:
    """Return the change of luminance per pixel right and down (n, 2) at hits; arguments as for seen_radiance().

    pixel: of pixel_steps(). Rays of the neighbouring pixels meet the plane of the same face.
    """
    a, b, c = _at_corners(faces, face, facing)
    seen = (1 - u - v)[:, None] * a + u[:, None] * b + v[:, None] * c
    per_weight, out = 1 / seen[:, 3], np.empty((len(face), 2))
    of_light = luminance(seen[:, :3]) * per_weight
    (light_u, weight_u), (light_v, weight_v) = ((luminance(d[:, :3]), d[:, 3]) for d in (b - a, c - a))
    corners, straight = faces.world.corners[face].astype(np.float64), directions.astype(np.float64)
    eye = np.asarray(eye, np.float64)
    straight = straight / (straight @ pixel[2])[:, None]
    u0, v0 = planar(corners, eye, straight)
    for k in range(2):
        u1, v1 = planar(corners, eye, straight + pixel[k])
        du, dv = u1 - u0, v1 - v0
        change = light_u * du + light_v * dv - of_light * (weight_u * du + weight_v * dv)
        out[:, k] = change * per_weight
    return out


def pixel_steps(camera: Turntable, height: int) -> np.ndarray:
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

"""The picture without OpenGL: ray casting, Gouraud interpolation of the same vertex colours.

Textures are filtered over the whole pixel per ray, as in GL. Sides, culling, tone map and background follow the
renderer, so the two pictures differ only along edges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from app.draw.camera import Turntable
from app.draw.diagonals import along_light
from app.draw.draw_mesh import DrawMesh, part_of
from app.draw.false_colour import Scale, false_colours, per_radiance
from app.draw.tonemap import BACKGROUND, NEUTRAL, UNLIT, Gains, to_display
from app.draw.vertex_colours import colours, gloss_towards, mean_radiance, weights
from app.draw.visible import PIXEL_OFFSETS, PictureScene, Strip, draw_strips, pixel_rays, place, planar, visible_faces
from app.settings import DEFAULT_TONE_MAP, ILLUMINANCE, LUMINANCE
from gi_core.display.dilation import Drawn
from gi_core.geometry.error import luminance
from gi_core.geometry.texture_filter import footprints, lookup
from gi_core.rays.accelerator import Accelerator, Transforms

if TYPE_CHECKING:
    from app.draw.bare_lights import LightFaces
    from gi_core.gloss.light import GlossLight

GRID_ROWS = 16  # of rays that measure visible light, times the samples of a pixel


Sharp = Callable[[PictureScene, np.ndarray, np.ndarray, Strip, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def picture(
    accelerator: Accelerator,
    at: Transforms,
    meshes: Sequence[DrawMesh],
    colours: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: Turntable,
    size: tuple[int, int],
    exposure: float,
    tone_map: str = DEFAULT_TONE_MAP,
    cull: bool = True,
    progress: Callable[[float], None] = lambda fraction: None,
    textured: bool = True,
    weights: Sequence[np.ndarray | None] | None = None,
    scale: Scale | None = None,
    gains: Gains = NEUTRAL,
    gloss: Sequence[tuple[np.ndarray, np.ndarray] | None] | None = None,
    sharp: Sharp | None = None,
    faces: LightFaces | None = None,
) -> np.ndarray:
    """Return the picture (height, width, 3) uint8.

    `colours` has linear radiance of front and back (D, 3) per object; `size` is (width, height) pixels.
    `textured`: multiply by textures; `weights` has the interpolation weights of front and back (D, 2) per object,
    None for all 1; `scale`: false colours in place of the tone map; `gains`: white balance;
    `gloss`: radiance (D, 3) above the texture of front and back per object, None where there is none; `sharp`: returns
    which of some hits of a strip reflect sharply, and the radiance of their gloss in place of `gloss`; `faces`: of
    luminaires.
    """
    width, height = size
    weights = [None] * len(meshes) if weights is None else weights
    world = place([along_light(mesh, *c, w) for mesh, c, w in zip(meshes, colours, weights, strict=True)], at)
    front, back = both_sides(colours, weights)
    above = above_textures(meshes, gloss, weights)
    out = np.empty((height, width, 3), np.uint8)
    pixel = pixel_steps(camera, height)
    steps = pixel if textured and world.textures else None

    def draw(strip: Strip) -> None:
        # Mean after the tone map, as in a GL framebuffer: a saturated lamp keeps clean edges.
        display = _shade(world, front, back, strip, exposure, tone_map, steps, scale, gains, above, pixel, sharp)
        if faces is not None:
            rays, radiance = faces.seen(strip, world)
            bright = (
                to_display(radiance, exposure, tone_map, gains) if scale is None else false_colours(radiance, scale)
            )
            display[rays] = bright
        out[strip.rows] = np.round(strip.resolved(display))

    draw_strips(draw, accelerator, at, world, camera, size, cull, progress)
    return out


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


def visible_light(
    accelerator: Accelerator,
    at: Transforms,
    meshes: Sequence[DrawMesh],
    drawn: Drawn,
    camera: Turntable,
    aspect: float,
    cull: bool = True,
    quantity: str = ILLUMINANCE,
    gloss: GlossLight | None = None,
) -> np.ndarray:
    """Return the light (n,) of the surface at a grid of rays over the picture, as luminance of RGB.

    drawn: irradiance (R, 3) [W/m2] and weights of the picture; aspect: its width over its height; quantity: ILLUMINANCE
    [W/m2], or LUMINANCE [W/m2/sr] with mean textures and with `gloss` of light at vertices.
    """
    size = float(np.subtract(camera.bounds.high, camera.bounds.low).max())

    def placed(hit: np.ndarray) -> tuple[PictureScene, np.ndarray]:
        parts, rows = _parts(meshes, hit)
        return place(parts, at)._replace(size=size), rows

    origins, directions = pixel_rays(camera, max(round(aspect * GRID_ROWS), 1), GRID_ROWS, 0, GRID_ROWS)
    face, u, v = visible_faces(accelerator, at, placed, origins, directions, cull)
    hit = np.flatnonzero(face >= 0)
    parts, rows = _parts(meshes, face[hit])
    world = place(parts, at)
    pairs = [colours(mesh, drawn.irradiance, quantity == LUMINANCE) for mesh in parts]
    if quantity == LUMINANCE:
        above = gloss_towards(parts, gloss, drawn.irradiance, at, camera.eye())
        pairs = [
            with_gloss(mean_radiance(mesh, *pair), more) for mesh, pair, more in zip(parts, pairs, above, strict=True)
        ]
    front, back = both_sides(pairs, [weights(mesh, drawn.weights) for mesh in parts])
    radiance, facing = seen_radiance(world, front, back, rows, u[hit], v[hit], directions[hit], None, origins[0])
    return per_radiance(quantity) * luminance(radiance[facing | ~world.one_sided[rows]])


def with_gloss(
    sides: tuple[np.ndarray, np.ndarray], gloss: tuple[np.ndarray, np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return radiance (D, 3) of front and back with that of gloss; None: without."""
    return sides if gloss is None else (sides[0] + gloss[0], sides[1] + gloss[1])


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
        radiance += gloss_seen(world, front, back, strip, hit, above, sharp, radiance)
    if scale is None:
        out[hit] = to_display(radiance, exposure, tone_map, gains)
    else:
        change = gradient(world, front, back, *strip.seen(hit), facing, pixel, strip.eye) if scale.lines else None
        to_middle = 0.5 - PIXEL_OFFSETS[hit % len(PIXEL_OFFSETS)]  # a line is the same in all samples, as in GL
        out[hit] = false_colours(radiance, scale, change, to_middle)
    out[hit[~facing & world.one_sided[strip.face[hit]]]] = np.round(np.array(UNLIT) * 255)
    return out


def gloss_seen(world: PictureScene, front, back, strip: Strip, hit: np.ndarray, above, sharp: Sharp | None, under):
    """Return the radiance (n, 3) of gloss at hits (n,) of a strip, of light at vertices or reflected.

    under (n, 3): radiance of the hits without it.
    """
    radiance = seen_radiance(world, above[0], above[1], *strip.seen(hit), None, strip.eye)[0]
    if sharp is not None:
        rows, reflected = sharp(world, front, back, strip, hit, under)
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
    corners, straight = world.corners[face].astype(np.float64), directions.astype(np.float64)
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

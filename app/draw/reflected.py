"""Sharp gloss in pictures without OpenGL: reflection rays, drawn from the lobe and traced through the scene.

Highlights of lights without a surface are added with shadow rays. Rays that leave the scene bring the light of the sky.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from app.draw.draw_mesh import DrawMesh
from app.draw.raycast import above_textures, seen_radiance
from app.draw.visible import PIXEL_OFFSETS, PictureScene, Strip, visible_faces
from gi_core.base.vectors import dot
from gi_core.bsdf.table import Tables, join
from gi_core.gloss.highlights import OFFSET, arriving, highlights, without_surface
from gi_core.gloss.lobe_rays import draw_lobe
from gi_core.gloss.sharp import PLANAR, Reflector
from gi_core.lights.light_sampling import Lights
from gi_core.rays.accelerator import Accelerator, Transforms

BOUNCES = 3  # between sharp surfaces; the last one shows cells
RAYS = 32  # per ray of the picture, at the first bounce; a mirror has one
_STEPS = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])  # of the R3 sequence (Roberts 2018)

Views = tuple[np.ndarray, Tables, np.ndarray, np.ndarray, np.ndarray]  # lobes, tables, to the eye, normals, tangents
Above = tuple[np.ndarray, np.ndarray] | None  # of raycast.above_textures()


class Mirrors:
    """Reflections in the sharp faces of a placed scene, for one eye. Gloss in them is that seen from the mirrored eye,
    or from the centre of a probe."""

    def __init__(
        self,
        accelerator: Accelerator,
        at: Transforms,
        meshes: Sequence[DrawMesh],
        gloss: Callable[[np.ndarray], Sequence[tuple[np.ndarray, np.ndarray] | None]],
        weights: Sequence[np.ndarray | None],
        eye: np.ndarray,
        pixel: float | None,
        cull: bool,
        background: np.ndarray,
        lights: Lights,
    ) -> None:
        """gloss(eye) as Shot.gloss(); weights as for raycast.picture(); eye (3,); pixel: tangent of a pixel's angle,
        None without textures; background (3,): radiance around a scene without a sky; lights: as one lamp."""
        self._accelerator, self._at, self._eye = accelerator, at, eye
        self._pixel, self._cull, self._background = pixel, cull, background
        self._delta, self._sky = without_surface(lights), lights.sky
        self._tables = next((m.tables for m in meshes if m.tables is not None), join([]))
        self._reflectors: list[Reflector] = []
        self._above: list[Above] = []
        of_face, normals, tangents = [], [], []
        for o, mesh in enumerate(meshes):
            R, first, none = at.rotation[o], len(self._reflectors), np.zeros((len(mesh.positions), 3))
            own = mesh.reflector is not None
            of_face.append(np.where(mesh.reflector < 0, -1, mesh.reflector + first) if own else _none_of(mesh))
            normals.append(mesh.normal @ R.T if own else none)
            tangents.append(none if not own or mesh.tangent is None else mesh.tangent @ R.T)
            for r in mesh.reflectors:
                self._reflectors.append(r)
                self._above.append(above_textures(meshes, gloss(_virtual_eye(r, R, at.position[o], eye)), weights))
        self._of_face = np.concatenate(of_face)
        self._normals, self._tangents = np.concatenate(normals), np.concatenate(tangents)
        self._lobes = np.array([r.lobe.lobe for r in self._reflectors]).reshape(-1, 5)

    def reflected(
        self, world: PictureScene, front: np.ndarray, back: np.ndarray, strip: Strip, hit: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return which of the hits (n,) of a strip see sharp faces (k,), and the radiance (k, 3) of their gloss."""
        rows = np.flatnonzero(self._of_face[strip.face[hit]] >= 0)
        rays = hit[rows]
        eyes = np.broadcast_to(strip.eye.astype(np.float64), (len(rays), 3))
        first = strip.rows.start * (len(strip.face) // (strip.rows.stop - strip.rows.start))
        given = strip.face[rays], strip.u[rays], strip.v[rays], strip.directions[rays].astype(np.float64)
        return rows, self._gloss(world, front, back, *given, eyes, rays + first, 0)

    def _gloss(self, world: PictureScene, front, back, face, u, v, d, eyes, keys, bounce: int) -> np.ndarray:
        """Return the radiance (n, 3) of sharp gloss at hits of rays from eyes (n, 3) along d (n, 3)."""
        out, of = np.zeros((len(face), 3)), self._of_face[face]
        for k in np.unique(of):
            rows = np.flatnonzero(of == k)
            count = RAYS if len(self._reflectors[k].lobe.taps) > 1 and bounce == 0 else 1
            many = np.repeat(rows, count)
            # A sequence per pixel, from a start of its own; each of its samples draws another part.
            pixel, sample = np.divmod(keys[many], len(PIXEL_OFFSETS))
            place = sample * count + np.tile(np.arange(count), len(rows))
            numbers = (_hashed(pixel, bounce) + place[:, None] * _STEPS) % 1
            seen = self._along(world, front, back, face[many], u[many], v[many], d[many], eyes[many], keys[many],
                               bounce, int(k), numbers)  # fmt: skip
            out[rows] = seen.reshape(len(rows), count, 3).mean(axis=1)
            if len(self._delta.kind) and len(self._reflectors[k].lobe.taps) > 1:  # mirrors have none
                out[rows] += self._highlights(world, face[rows], u[rows], v[rows], d[rows], int(k))
        return out

    def _views(self, world, face, u, v, d, k) -> tuple[np.ndarray, np.ndarray, Views]:
        """Return points (n, 3) of hits on faces of reflector k, normals of the faces, and views as for draw_lobe()."""
        share = np.stack([1.0 - u - v, u, v], axis=1)[:, :, None]
        point = (world.corners[face] * share).sum(axis=1)
        normal = (self._normals[world.draw[face]] * share).sum(axis=1)
        normal /= np.maximum(np.sqrt(dot(normal, normal)), 1e-30)[:, None]
        flat = world.normals[face].astype(np.float64)
        flat /= np.maximum(np.sqrt(dot(flat, flat)), 1e-30)[:, None]
        side = np.where(dot(flat, d) < 0, 1.0, -1.0)[:, None]
        flat, normal = flat * side, normal * side
        along = self._tangents[world.draw[face, 0]]
        along = along - normal * dot(normal, along)[:, None]
        along /= np.maximum(np.sqrt(dot(along, along)), 1e-30)[:, None]
        return point, flat, (np.broadcast_to(self._lobes[k], (len(face), 5)), self._tables, -d, normal, along)

    def _highlights(self, world, face, u, v, d, k) -> np.ndarray:
        """Return the radiance (n, 3) of lights without a surface in gloss, at hits on faces of reflector k."""
        point, flat, views = self._views(world, face, u, v, d, k)
        light = arriving(self._accelerator, self._at, point, flat, self._delta, world.size)
        light.strength[(light.direction * flat[:, None]).sum(axis=2) <= 0] = 0.0
        return highlights(*views, light, self._delta.value)

    def _along(self, world, front, back, face, u, v, d, eyes, keys, bounce, k, numbers) -> np.ndarray:
        """Draw a ray per hit on faces of reflector k and return the radiance (n, 3) that it brings."""
        point, flat, views = self._views(world, face, u, v, d, k)
        new, factors, _ = draw_lobe(*views, numbers)
        below = np.minimum(dot(new, flat), 0.0)
        new = new - 2 * below[:, None] * flat  # a normal between faces may send it below its own
        travelled = np.sqrt(dot(point - eyes, point - eyes))[:, None]
        start = point + OFFSET * world.size * flat
        return factors * self._radiance(world, front, back, start, new, point - travelled * new, keys, bounce + 1, k)

    def _radiance(self, world, front, back, origins, d, eyes, keys, bounce: int, k: int) -> np.ndarray:
        """Return the radiance (n, 3) along rays; eyes (n, 3): from which the whole path would be straight."""
        narrow = np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(d, np.float32)
        face, u, v = visible_faces(self._accelerator, self._at, lambda hit: (world, hit), *narrow, self._cull)
        out = np.tile(self._background, (len(face), 1))
        if self._sky.radiance.any():
            out = np.where((d @ self._sky.up > 0)[:, None], self._sky.radiance, 0.0)
        hit = np.flatnonzero(face >= 0)
        if not len(hit):
            return out
        face, u, v, d, eyes = face[hit], u[hit], v[hit], d[hit], eyes[hit]
        steps = None if self._pixel is None else _steps(d, self._pixel)
        radiance, facing = seen_radiance(world, front, back, face, u, v, d, steps, eyes)
        above = self._above[k]
        if above is not None:
            gloss = seen_radiance(world, *above, face, u, v, d, None, eyes)[0]
            sharp = np.flatnonzero(self._of_face[face] >= 0) if bounce < BOUNCES else np.zeros(0, np.int64)
            if len(sharp):
                given = face[sharp], u[sharp], v[sharp], d[sharp], eyes[sharp], keys[hit][sharp]
                gloss[sharp] = self._gloss(world, front, back, *given, bounce)
            radiance = radiance + gloss
        out[hit] = np.where((facing | ~world.one_sided[face])[:, None], radiance, 0.0)
        return out


def _none_of(mesh: DrawMesh) -> np.ndarray:
    return np.full(len(mesh.triangles), -1)


def _virtual_eye(r: Reflector, R: np.ndarray, position: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Return the mirrored eye (3,), or the centre of the probe."""
    if r.way != PLANAR:
        return R @ r.centre + position
    normal = R @ r.plane[:3]
    return eye - 2 * (normal @ eye - r.plane[3] - normal @ position) * normal


def _steps(d: np.ndarray, pixel: float) -> np.ndarray:
    """Return steps (n, 3, 3) of pixels around rays d (n, 3), as footprints() reads them."""
    axis = np.eye(3)[np.abs(d).argmin(axis=1)]
    across = np.cross(d, axis)
    across *= pixel / np.sqrt(dot(across, across))[:, None]
    return np.stack([across, np.cross(d, across), d], axis=1)


def _hashed(keys: np.ndarray, bounce: int) -> np.ndarray:
    """Return numbers (n, 3) in [0, 1) by ray and bounce."""
    x: np.ndarray = (keys.astype(np.uint64)[:, None] * np.uint64(3) + np.arange(3, dtype=np.uint64)) * np.uint64(4)
    x = (x + np.uint64(bounce + 1)) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        x = (x ^ (x >> np.uint64(shift))) * np.uint64(factor)
    return ((x ^ (x >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) * 2.0**-53

"""Sharp gloss in pictures without OpenGL: reflection rays, drawn from the lobe and traced through the scene.

Lamps smaller than a rough lobe are also sampled (`gi_core/gloss/lobe_rays.py`). Highlights of lights without a surface
are added with shadow rays. Rays that leave the scene bring the light of the sky.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from app.draw.false_colour import Display
from app.draw.lit_scene import LitScene
from app.draw.raycast import Coloured, Sharp, above_textures, seen_radiance
from app.draw.tonemap import BACKGROUND, srgb_decode
from app.draw.vertex_colours import Gloss
from app.draw.visible import PIXEL_OFFSETS, PictureScene, PictureView, Strip, visible_faces
from gi_core.base.vectors import dot
from gi_core.bsdf.table import join
from gi_core.geometry.error import luminance
from gi_core.gloss.lobe_rays import (
    LobeViews,
    arriving,
    draw_lobe,
    gloss_alone,
    highlights,
    lamp_rays,
    share_of_lamps,
    without_surface,
)
from gi_core.gloss.reflectors import Reflector
from gi_core.rays.accelerator import LIFT

RAYS_PER_PIXEL_RAY = 32  # per ray of the picture at most, at its first rough lobe; further lobes and mirrors have one
LAMP_RAYS = 16  # as many to lamps there; further rough lobes have one
PIXEL_NOISE = 0.5  # of a pixel, of 255: more rays than one are for pixels that would have more
MOST_RAYS = 1 << 23  # that rough lobes of a picture have beyond the first, a share for each strip
# Of the R2 sequence, and the golden ratio (Roberts 2018): two numbers choose a direction, the third a part of the lobe.
_STEPS = np.array([0.7548776662466927, 0.5698402909980532, 0.6180339887498949])


class Hits(NamedTuple):
    """Hits of n rays of the picture, or of reflected ones."""

    face: np.ndarray  # (n,) int
    u: np.ndarray  # (n,) barycentric weight of corner 1
    v: np.ndarray  # (n,) of corner 2
    direction: np.ndarray  # (n, 3) float64 unit, of the ray
    eye: np.ndarray  # (n, 3) float64 [m], from which the whole path would be straight
    key: np.ndarray  # (n,) int64, number of the path: row, column and sample, then the ray of the rough lobe
    bounce: int  # reflections before
    spread: bool  # a rough lobe among them, whose rays are many
    rays: int  # of the first rough lobe

    def at(self, rows: np.ndarray) -> Hits:
        """Return some of the hits."""
        face, u, v, direction, eye, key = (a[rows] for a in self[:6])
        return Hits(face, u, v, direction, eye, key, self.bounce, self.spread, self.rays)


class Views(NamedTuple):
    """Hits on one reflector as its lobe sees them."""

    lobe: LobeViews  # normals: shading normals
    flat: np.ndarray  # (n, 3) unit, normals of the faces
    points: np.ndarray  # (n, 3) [m]
    starts: np.ndarray  # (n, 3) [m], of rays: past the rounding of the face

    def repeated(self, count: int) -> Views:
        """Return each view `count` times."""
        return Views(self.lobe.repeated(count), *(np.repeat(a, count, axis=0) for a in self[1:]))


class Mirrors:
    """Reflections in the sharp faces of a placed scene, for one eye. Gloss in them is that seen from the mirrored eye,
    or from the centre of a probe."""

    def __init__(self, lit: LitScene, view: PictureView, display: Display, gloss: Gloss) -> None:
        """gloss: of all objects, for the eye of the view."""
        camera, lights, meshes, at = view.camera, lit.model.lights_at(lit.levels), lit.meshes, lit.at
        self._lit, self._view, self._seen_from_eye = lit, view, gloss
        # Tangent of a pixel's angle.
        self._pixel = 2 * math.tan(camera.fov / 2) / view.height if any(m.textures for m in meshes) else None
        # Radiance around a scene without a sky.
        self._background = srgb_decode(np.array(BACKGROUND)) / (2.0**display.exposure * np.array(display.gains))
        self._exposure = display.exposure
        self._delta, self._lights = without_surface(lights), lights
        # Luminaires have highlights instead.
        self._has_lamps = LAMP_RAYS > 0 and bool((lights.area.table < 0).any())
        self._reflectors: list[Reflector] = []
        self._owner: list[int] = []  # object of each
        self._above: dict[int, Coloured | None] = {}
        of_face, normals, tangents = [], [], []
        for o, mesh in enumerate(meshes):
            R, first, none = at.rotation[o], len(self._reflectors), np.zeros((len(mesh.positions), 3))
            own = mesh.reflector is not None
            of_face.append(
                np.where(mesh.reflector < 0, -1, mesh.reflector + first) if own else np.full(len(mesh.triangles), -1)
            )
            normals.append(mesh.gloss.normal @ R.T if own else none)
            tangents.append(none if not own or mesh.gloss.tangent is None else mesh.gloss.tangent @ R.T)
            for r in mesh.reflectors:
                self._reflectors.append(r)
                self._owner.append(o)
        self._of_face = np.concatenate(of_face)
        self._normals, self._tangents = np.concatenate(normals), np.concatenate(tangents)
        tables = next((m.gloss.tables for m in meshes if m.gloss and m.gloss.tables), join([]))
        self._lobes = gloss_alone(np.array([r.lobe.lobe for r in self._reflectors]).reshape(-1, 5), tables)
        self._has_rough = any(len(r.lobe.taps) > 1 for r in self._reflectors)

    def reflected(
        self, lit: Coloured, strip: Strip, hit: np.ndarray, under: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return which of the hits (n,) of a strip see sharp faces (k,), and the radiance (k, 3) of their gloss.

        under (n, 3): radiance of the hits without it. Each rough lobe has one ray of each kind first. Pixels of more
        noise than PIXEL_NOISE have as many as bring it there.
        """
        rows = np.flatnonzero(self._of_face[strip.face[hit]] >= 0)
        rays, height = hit[rows], strip.rows.stop - strip.rows.start
        directions = strip.directions[rays].astype(np.float64)
        eyes = np.broadcast_to(strip.eye.astype(np.float64), (len(rays), 3))
        hits = Hits(
            strip.face[rays], strip.u[rays], strip.v[rays], directions, eyes, rays + strip.rays.start, 0, False, 1
        )
        out = self._gloss(lit, hits)
        if RAYS_PER_PIXEL_RAY > 1 and self._has_rough:
            at = rays // len(PIXEL_OFFSETS)
            counts = _rays_wanted(self._shown(under[rows], out), at, height, len(strip.face) // len(PIXEL_OFFSETS))
            counts = _within(counts, int(MOST_RAYS * height / self._view.height))
            for count in np.unique(counts[counts > 1]):
                alike = np.flatnonzero(counts == count)
                out[alike] = self._gloss(lit, hits.at(alike)._replace(rays=int(count)))
        return rows, out

    def _shown(self, under: np.ndarray, gloss: np.ndarray) -> np.ndarray:
        """Return the values (n,), 0 to 255, as which a tone map shows gloss above other light."""
        light = 2.0**self._exposure * luminance(under + gloss)
        return 255 * light / (1 + light)

    def _gloss(self, lit: Coloured, hits: Hits) -> np.ndarray:
        """Return the radiance (n, 3) of sharp gloss at hits."""
        out, of = np.zeros((len(hits.face), 3)), self._of_face[hits.face]
        for k in np.unique(of):
            rows = np.flatnonzero(of == k)
            own, rough = hits.at(rows), len(self._reflectors[k].lobe.taps) > 1
            views = self._views(lit.world, own, int(k))
            count = hits.rays if rough and not hits.spread else 1
            to_lamps = max(count * LAMP_RAYS // RAYS_PER_PIXEL_RAY, 1) if rough and self._has_lamps else 0
            out[rows] = self._of_lobe(lit, own, views, int(k), count, to_lamps)
            if to_lamps:
                out[rows] += self._of_lamps(lit.world, own, views, count, to_lamps)
            if rough and len(self._delta.kind):  # mirrors have none
                out[rows] += self._highlights(lit.world, views)
        return out

    def _views(self, world: PictureScene, hits: Hits, k: int) -> Views:
        """Return the views of hits on faces of reflector k."""
        share = np.stack([1.0 - hits.u - hits.v, hits.u, hits.v], axis=1)[:, :, None]
        point = (world.corners[hits.face] * share).sum(axis=1)
        normal = (self._normals[world.draw[hits.face]] * share).sum(axis=1)
        normal /= np.maximum(np.sqrt(dot(normal, normal)), 1e-30)[:, None]
        flat = world.normals[hits.face].astype(np.float64)
        flat /= np.maximum(np.sqrt(dot(flat, flat)), 1e-30)[:, None]
        side = np.where(dot(flat, hits.direction) < 0, 1.0, -1.0)[:, None]
        flat, normal = flat * side, normal * side
        along = self._tangents[world.draw[hits.face, 0]]
        along = along - normal * dot(normal, along)[:, None]
        along /= np.maximum(np.sqrt(dot(along, along)), 1e-30)[:, None]
        start = point + LIFT * np.abs(world.corners[hits.face]).max(axis=(1, 2))[:, None] * flat
        return Views(LobeViews.of_lobes(self._lobes, k, -hits.direction, normal, along), flat, point, start)

    def _highlights(self, world: PictureScene, views: Views) -> np.ndarray:
        """Return the radiance (n, 3) of lights without a surface in gloss."""
        none = np.zeros(len(views.starts))
        light = arriving(
            self._lit.model.accelerator, self._lit.at, views.starts, views.flat, none, self._delta, world.size
        )
        light.strength[(light.direction * views.flat[:, None]).sum(axis=2) <= 0] = 0.0
        return highlights(views.lobe, light, self._delta.value)

    def _of_lamps(self, world: PictureScene, hits: Hits, views: Views, count: int, to_lamps: int) -> np.ndarray:
        """Return the radiance (n, 3) that `to_lamps` rays to lamps bring, beside `count` drawn from the lobe."""
        start = views.starts
        numbers = _numbers(hits, to_lamps, 1)[..., :2]
        rays = lamp_rays(self._lights.area, views.lobe, start, views.flat, numbers, count / to_lamps)
        out = np.zeros(rays.radiance.shape)
        rows = np.nonzero(rays.lamp >= 0)
        face = self._nearest(world, start[rows[0]], rays.direction[rows])[0]
        # A face of a quadrilateral has the same light as its other half, which the picture may draw in its place.
        base, of_face = world.base[face], self._lights.area.of_face
        beside = world.base[world.pieces[world.first[base + 1] - 1]]
        same = (of_face[base] == rays.lamp[rows]) | (of_face[beside] == rays.lamp[rows])
        seen = tuple(row[same & (face >= 0)] for row in rows)
        out[seen] = rays.radiance[seen]
        return out.mean(axis=1)

    def _of_lobe(self, lit: Coloured, hits: Hits, views: Views, k: int, count: int, to_lamps: int) -> np.ndarray:
        """Return the radiance (n, 3) that `count` rays drawn from the lobe of reflector k bring, beside `to_lamps`."""
        numbers, many = _numbers(hits, count, 0), views.repeated(count)
        new, factors, density = draw_lobe(many.lobe, numbers.reshape(-1, 3))
        # A normal between faces may send a ray below its own, where no ray to a lamp competes.
        below = np.minimum(dot(new, many.flat), 0.0)
        density[below < 0] = np.inf
        new = new - 2 * below[:, None] * many.flat
        eye = np.repeat(hits.eye, count, axis=0)
        travelled = np.sqrt(dot(many.points - eye, many.points - eye))[:, None]
        key = (hits.key[:, None] * count + np.arange(count)).reshape(-1)
        spread = hits.spread or len(self._reflectors[k].lobe.taps) > 1
        eye = many.points - travelled * new
        rival = density * count / to_lamps if to_lamps else np.full(len(density), np.inf)
        radiance = self._radiance(lit, many.starts, new, eye, key, rival, hits.bounce + 1, spread, hits.rays, k)
        return (factors * radiance).reshape(-1, count, 3).mean(axis=1)

    def _gloss_seen_in(self, k: int, world: PictureScene) -> Coloured | None:
        """Return gloss as reflector k shows it."""
        if k not in self._above:
            o, at = self._owner[k], self._lit.at
            eye = _virtual_eye(self._reflectors[k], at.rotation[o], at.position[o], self._view.camera.eye())
            gloss = self._lit.gloss_towards(eye, self._seen_from_eye)
            self._above[k] = above_textures(world, self._lit, gloss)
        return self._above[k]

    def _nearest(self, world: PictureScene, origins: np.ndarray, d: np.ndarray):
        """Return the face that rays (n,) see and its barycentric weights; face -1: none."""
        narrow = np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(d, np.float32)
        return visible_faces(self._lit, lambda hit: (world, hit), *narrow, self._view.cull)

    def _radiance(
        self, lit: Coloured, origins, d, eyes, keys, density, bounce, spread, count: int, k: int
    ) -> np.ndarray:
        """Return the radiance (n, 3) along rays of reflector k, without the share that rays to lamps bring.

        eyes, keys, bounce, spread, count: as in Hits; density (n,): as for share_of_lamps().
        """
        face, u, v = self._nearest(lit.world, origins, d)
        out = np.tile(self._background, (len(face), 1))
        if self._lights.sky.radiance.any():
            out = self._lights.sky.seen(d)
        rays = np.flatnonzero(face >= 0)
        if not len(rays):
            return out
        hits = Hits(face[rays], u[rays], v[rays], d[rays], eyes[rays], keys[rays], bounce, spread, count)
        seen = hits.face, hits.u, hits.v, hits.direction
        steps = None if self._pixel is None else _steps(hits.direction, self._pixel)
        radiance, facing = seen_radiance(lit, *seen, steps, hits.eye)
        above = self._gloss_seen_in(k, lit.world)
        if above is not None:
            gloss = seen_radiance(above, *seen, None, hits.eye)[0]
            # 3 bounces between sharp surfaces; the last one shows cells
            sharp = np.flatnonzero(self._of_face[hits.face] >= 0) if bounce < 3 else np.zeros(0, np.int64)
            if len(sharp):
                gloss[sharp] = self._gloss(lit, hits.at(sharp))
            radiance = radiance + gloss
        out[rays] = np.where((facing | ~lit.world.one_sided[hits.face])[:, None], radiance, 0.0)
        lamp = self._lights.area.of_face[lit.world.base[face]]
        bright = rays[facing & (lamp[rays] >= 0) & np.isfinite(density[rays])]
        if len(bright):
            e, share = lamp[bright], np.stack([1 - u - v, u, v], axis=1)[bright, :, None]
            way = (lit.world.corners[face[bright]] * share).sum(axis=1) - origins[bright]
            by_lamps = share_of_lamps(self._lights.area, e, way, density[bright])
            out[bright] -= by_lamps[:, None] * self._lights.area.radiance[e]
        return out


def sharp_gloss(lit: LitScene, view: PictureView, display: Display, gloss: Gloss) -> Sharp | None:
    """Return the reflections in a lit scene; None: it has no sharp gloss. Arguments as for Mirrors."""
    if lit.gloss is None or not lit.shows_radiance or not any(mesh.reflectors for mesh in lit.meshes):
        return None
    return Mirrors(lit, view, display, gloss).reflected


def _rays_wanted(shown: np.ndarray, at: np.ndarray, height: int, pixels: int) -> np.ndarray:
    """Return the number (n,) of rays, a power of two up to RAYS_PER_PIXEL_RAY, that samples need for PIXEL_NOISE.

    shown (n,) float64: the values of n samples, as a tone map shows them. at (n,) int: the pixel of each sample, among
    `pixels` of a strip that is `height` pixels high. The variance of a pixel is a mean over 3 x 3 pixels, because four
    samples estimate it badly.
    """
    count, total, squares = (np.bincount(at, w, minlength=pixels) for w in (None, shown, shown * shown))
    apart = np.maximum(squares - total * total / np.maximum(count, 1), 0.0)
    free = np.maximum(count - 1, 0)
    apart, free = (_around(a.reshape(height, -1)).reshape(-1) for a in (apart, free))
    wanted = apart / np.maximum(free, 1) / len(PIXEL_OFFSETS) / max(PIXEL_NOISE * PIXEL_NOISE, 1e-9)
    powers = np.ceil(np.log2(np.clip(wanted, 1.0, RAYS_PER_PIXEL_RAY)))
    return np.minimum(np.exp2(powers), RAYS_PER_PIXEL_RAY).astype(np.int64)[at]


def _around(of: np.ndarray) -> np.ndarray:
    """Return sums (h, w) over 3 x 3 pixels."""
    wide = np.pad(of, 1)
    down = wide[:-2] + wide[1:-1] + wide[2:]
    return down[:, :-2] + down[:, 1:-1] + down[:, 2:]


def _within(counts: np.ndarray, most: int) -> np.ndarray:
    """Return the counts (n,) of rays, halved until those above 1 are at most `most` in all."""
    while (counts[counts > 1]).sum() > most and (counts > 1).any():
        counts = np.maximum(counts // 2, 1)
    return counts


def _virtual_eye(r: Reflector, R: np.ndarray, position: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Return the mirrored eye (3,), or the centre of the probe."""
    if r.plane is None:
        return R @ r.probe.centre + position
    normal = R @ r.plane.equation[:3]
    return eye - 2 * (normal @ eye - r.plane.equation[3] - normal @ position) * normal


def _steps(d: np.ndarray, pixel: float) -> np.ndarray:
    """Return steps (n, 3, 3) of pixels around rays d (n, 3), as footprints() reads them."""
    axis = np.eye(3)[np.abs(d).argmin(axis=1)]
    across = np.cross(d, axis)
    across *= pixel / np.sqrt(dot(across, across))[:, None]
    return np.stack([across, np.cross(d, across), d], axis=1)


def _numbers(hits: Hits, count: int, use: int) -> np.ndarray:
    """Return `count` numbers in [0, 1) per hit, (n, count, 3); use: 0 for rays of the lobe, 1 for rays to lamps.

    The first rough lobe has a sequence per pixel, from a start of its own; each of its samples draws another part.
    Later ones have random numbers.
    """
    salt = 2 * hits.bounce + use
    if hits.spread:
        return _hashed(hits.key, salt)[:, None]
    pixel, sample = np.divmod(hits.key, len(PIXEL_OFFSETS))
    place = sample[:, None] * count + np.arange(count)
    return (_hashed(pixel, salt)[:, None] + place[..., None] * _STEPS) % 1


def _hashed(keys: np.ndarray, salt: int) -> np.ndarray:
    """Return random numbers (n, 3) in [0, 1) by key (n,) and salt < 8."""
    x: np.ndarray = (keys.astype(np.uint64)[:, None] * np.uint64(3) + np.arange(3, dtype=np.uint64)) * np.uint64(8)
    x = (x + np.uint64(salt + 1)) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        x = (x ^ (x >> np.uint64(shift))) * np.uint64(factor)
    return ((x ^ (x >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) * 2.0**-53

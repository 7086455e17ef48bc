"""Light of glossy receivers outside of pictures: their single rays, radiance, the faces that shine, and the reference.

The reference of gloss is radiance towards an eye by rays drawn from lobes. Light of a ray is followed by the paths of
the reference. Lights without a surface, which no ray meets, have highlights.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.threads import run_ranges
from gi_core.frames.frame_gloss import RADII
from gi_core.frames.light_setting import LIST, OPENED
from gi_core.gather.path_ends import starts
from gi_core.gather.path_tracer import BLOCK, PathTracer
from gi_core.gloss.hemisphere import CELLS, GRAZING
from gi_core.gloss.light import LEAST_ALPHA, Directions, gloss_radiance, room_for
from gi_core.gloss.lobe_rays import LobeViews, arriving, draw_lobe, gloss_alone, highlights, without_surface
from gi_core.gloss.rays import MOST_LISTED_PHOTONS
from gi_core.gloss.sharp import is_sharp
from gi_core.lights.lamps import Lights
from gi_core.model import Model
from gi_core.photons.paths import segments_of
from gi_core.rays.accelerator import LIFT, Transforms
from gi_core.solver import Solver

__all__ = [
    "CELLS", "GRAZING", "LEAST_ALPHA", "LIST", "MOST_LISTED_PHOTONS", "RADII", "Directions",
    "GlossViews", "bounced_once", "gloss_views", "radiance_of", "reference_gloss", "shining_faces", "single_rays",
]  # fmt: skip


def single_rays(solver: Solver, receivers: np.ndarray) -> tuple[Directions, np.ndarray]:
    """Return the single rays of a solver with gloss LIST, and the row (n,) int32 of each receiver (n,) in them."""
    light = solver.frame.gloss
    return light.directions()._replace(opened=OPENED[LIST]), np.searchsorted(light.rows, receivers).astype(np.int32)


def radiance_of(
    solver: Solver, light: Directions, row: np.ndarray, receiver: np.ndarray, eye, alpha: float | None = None
) -> np.ndarray:
    """Return the radiance (n, 3) of gloss under irradiance 1, towards an eye (3,) [m]; all faces have the first's lobe.

    row: of each receiver (n,) in `light`; alpha: in place of that lobe's.
    """
    s, n = solver.surfaces, len(row)
    position, normal = solver.receivers.positions[receiver], solver.receivers.normals[receiver]
    lobes, seen = np.tile(s.lobe[0] if alpha is None else (*s.lobe[0, :4], alpha), (n, 1)), room_for(n)
    gloss_radiance(light, row, np.ones((n, 3)), position, normal, lobes, normal, s.tables, eye, seen)
    return seen


def bounced_once(solver: Solver) -> np.ndarray:
    """Return the vectors (n, 3) [m] from first to second hit of the photons of a frame."""
    paths, _ = solver.frame.store.subset(solver.frame.photons)
    segments = segments_of(paths, 0, solver.frame.photons)
    return (segments.end - segments.origin)[segments.bounce == 1].astype(float)


def shining_faces(solver: Solver) -> tuple[np.ndarray, np.ndarray]:
    """Return a glossy face (R,) of each receiver that carries light for it, -1: none, and whether it is on the back."""
    s = solver.surfaces
    face, back = np.full(len(solver.irradiance), -1), np.zeros(len(solver.irradiance), bool)
    glossy = np.flatnonzero(~np.isnan(s.lobe[:, 4]) & ~is_sharp(s))
    for corners, is_back in ((s.corner_front[glossy], False), (s.corner_back[glossy], True)):
        real = corners >= 0
        rows = corners[real]
        face[rows], back[rows] = np.repeat(glossy[:, None], 3, axis=1)[real], is_back
    return face, back


class GlossViews(NamedTuple):
    """Views of n glossy points, in the world."""

    positions: np.ndarray  # (n, 3) float64 [m], lifted off the surface
    normals: np.ndarray  # (n, 3) float64 unit, of the lobe
    flat: np.ndarray  # (n, 3) float64 unit, of the face, on the same side
    tangents: np.ndarray  # (n, 3) float64 unit
    to_eye: np.ndarray  # (n, 3) float64 unit
    face: np.ndarray  # (n,) int64 global, whose lobe it is


def gloss_views(model: Model, at: Transforms, rows: np.ndarray, face: np.ndarray, eye: np.ndarray) -> GlossViews:
    """Return the views of receivers (n,) on glossy faces (n,) from an eye (3,) in the world."""
    s = model.surfaces
    of = np.searchsorted(s.first_face, face, side="right") - 1
    R = at.rotation[of]
    points, normals = (a[rows] for a in model.evaluation_points)
    place = np.einsum("nij,nj->ni", R, points) + at.position[of]
    normal, flat = (np.einsum("nij,nj->ni", R, a) for a in (normals, s.normals[face]))
    front = (s.corner_front[face] == rows[:, None]).any(axis=1)
    along = np.einsum("nij,nj->ni", R, s.tangent[face]) if len(s.tangent) else normal
    to_eye = eye - place
    to_eye = to_eye / np.sqrt((to_eye * to_eye).sum(axis=1))[:, None]
    return GlossViews(place, normal, np.where(front[:, None], flat, -flat), along, to_eye, face)


def reference_gloss(
    model: Model, at: Transforms, lights: Lights, views: GlossViews, rays: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the radiance of gloss towards the eye and its standard error, both (n, 3) float64 [W/m2/sr].

    lights: of one lamp; rays: per point, at least 2.
    """
    n = len(views.face)
    mean, error = np.zeros((n, 3)), np.zeros((n, 3))
    each = max((1 << 18) // rays, 1)  # rays at once, which bounds memory
    for first in range(0, n, each):
        part = slice(first, min(first + each, n))
        L = _by_rays(model, at, lights, GlossViews(*(a[part] for a in views)), rays, seed, first)
        mean[part], error[part] = L.mean(axis=1), L.std(axis=1, ddof=1) / math.sqrt(rays)
    delta = without_surface(lights)
    if len(delta.kind):
        lift = LIFT * np.abs(views.positions).max(axis=1, initial=0.0)
        light = arriving(model.accelerator, at, views.positions, views.flat, lift, delta, model.world.size)
        light.strength[(light.direction * views.flat[:, None]).sum(axis=2) <= 0] = 0.0
        mean += highlights(_lobe_views(model, views), light, delta.value)
    return mean, error


def _lobe_views(model: Model, views: GlossViews) -> LobeViews:
    faces, of = np.unique(views.face, return_inverse=True)
    lobes = gloss_alone(model.surfaces.lobe[faces], model.surfaces.tables)
    return LobeViews.of_lobes(lobes, of.reshape(-1), views.to_eye, views.normals, views.tangents)


def _by_rays(model: Model, at: Transforms, lights: Lights, views: GlossViews, rays: int, seed: int, first: int):
    """Return the radiance (n, rays, 3) that single rays bring; first: number of the first point."""
    n = len(views.face)
    position, normal, flat, face = (
        np.repeat(a, rays, axis=0) for a in (views.positions, views.normals, views.flat, views.face)
    )
    numbers = np.random.default_rng([seed, first]).random((n * rays, 3))
    d, factors, _ = draw_lobe(_lobe_views(model, views).repeated(rays), numbers)
    factors = np.where(((d * flat).sum(axis=1) > 0)[:, None], factors, 0.0)  # none from below the face
    path = np.int64(first) * rays + np.arange(n * rays)
    total, tracer = np.zeros((n * rays, lights.channels)), PathTracer(model, at, lights, seed)

    def work(_, a, b):
        for begin in range(a, b, BLOCK):
            k = slice(begin, min(begin + BLOCK, b))
            ends = starts(path[k].copy(), np.arange(k.stop - begin), position[k].copy(), normal[k].copy())
            # A mirror's density: no ray to a lamp competes.
            ends = ends._replace(
                throughput=factors[k].copy(), face=face[k].astype(np.int32), density=-np.ones(len(ends.row))
            )
            tracer.follow(ends, total[k], d[k].astype(np.float32))

    run_ranges(work, n * rays, model.threads, BLOCK // 2)
    return total.reshape(n, rays, -1)[..., :3] / math.pi

"""Gloss in the chart: its radiance towards the camera at vertices that carry directional light, and the truth of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.draw.draw_mesh import DrawMesh, meshes_of, with_vertices
from app.draw.shot import home_camera
from app.draw.vertex_colours import gloss_colours
from gi_core.gather.gloss_reference import gloss_views, reference_gloss
from gi_core.gather.reference_sample import draw_by_area
from gi_core.gloss.sharp import is_sharp
from gi_core.solver import Solver

SHARE = 0.2  # of the sample's points
RAYS = 4096  # per point: 1 to 2 % of noise in rooms with lamps
GRAZING = 0.1  # least cosine of a view: pictures hardly show less


class GlossTruth(NamedTuple):
    """Gloss at one pose, at n vertices drawn by area."""

    parts: tuple[DrawMesh, ...]  # these vertices per object, the static part first
    back: np.ndarray  # (n,) bool: seen from the back
    eye: np.ndarray  # (3,) float64 [m] in the model's space
    truth: np.ndarray  # (n, 3) float64 [W/m2/sr]
    standard_error: np.ndarray  # (n, 3) float64 [W/m2/sr]
    weights: np.ndarray  # (n,) float64


def truth_of(solver: Solver, points: int, seed: int, rays: int = RAYS) -> GlossTruth | None:
    """Return the gloss of a solver's poses at about SHARE of `points`; None: no vertex in view carries light for it."""
    s, model = solver.surfaces, solver.model
    face_of, is_back = _faces(solver)
    rows = np.flatnonzero((face_of >= 0) & (solver.receivers.areas > 0))
    at, eye = model.transforms(solver.poses), home_camera(solver).relative_to(model.origins[0]).eye()
    views = gloss_views(model, at, rows, face_of[rows], eye)
    towards = [(views.to_eye * normal).sum(axis=1) > GRAZING for normal in (views.normals, views.flat)]
    rows = rows[towards[0] & towards[1]]
    if not len(rows):
        return None
    rows, weights = draw_by_area(rows, solver.receivers.areas, max(1, round(SHARE * points)), seed)
    views = gloss_views(model, at, rows, face_of[rows], eye)
    found = reference_gloss(model, at, model.lights_at(solver.levels), views, rays, seed)
    parts = []
    for o, mesh in enumerate(meshes_of(model)):
        mine = rows[(rows >= s.first_receiver[o]) & (rows < s.first_receiver[o + 1])]
        parts.append(with_vertices(mesh, _vertices(mesh, mine, is_back[mine]), np.zeros((0, 3))))
    return GlossTruth(tuple(parts), is_back[rows], eye, *found, weights)


def _faces(solver: Solver) -> tuple[np.ndarray, np.ndarray]:
    """Return a glossy face (R,) of each receiver that carries light for it, -1: none, and whether it is on the back."""
    s = solver.surfaces
    face, back = np.full(len(solver.irradiance), -1), np.zeros(len(solver.irradiance), bool)
    glossy = np.flatnonzero(~np.isnan(s.lobe[:, 4]) & ~is_sharp(s))
    for corners, is_back in ((s.corner_front[glossy], False), (s.corner_back[glossy], True)):
        there = corners >= 0
        rows = corners[there]
        face[rows], back[rows] = np.repeat(glossy[:, None], 3, axis=1)[there], is_back
    return face, back


def _vertices(mesh: DrawMesh, rows: np.ndarray, is_back: np.ndarray) -> np.ndarray:
    """Return a glossy draw vertex (n,) of each receiver (n,)."""
    out = np.zeros(len(rows), np.int64)
    for side, receivers in enumerate((mesh.front, mesh.back)):
        mine = is_back == bool(side)
        if not mine.any():
            continue
        assert mesh.gloss is not None
        shining = np.flatnonzero(mesh.gloss[:, side] >= 0)
        order = shining[np.argsort(receivers[shining], kind="stable")]
        out[mine] = order[np.searchsorted(receivers[order], rows[mine])]
    return out


def drawn_gloss(solver: Solver, of: GlossTruth | None) -> np.ndarray | None:
    """Return the radiance (n, 3) of gloss as pictures of the solver's frame show it; None without gloss."""
    light = solver.frame.gloss
    if of is None or light is None:
        return None
    at, directions, sides = solver.model.transforms(solver.poses), light.directions(), []
    for o, part in enumerate(of.parts):
        if len(part.positions):
            local = at.rotation[o].T @ (of.eye - at.position[o])
            sides.append(gloss_colours(part, directions, solver.irradiance, local))
    front, back = (np.concatenate([pair[k] for pair in sides if pair is not None]) for k in range(2))
    return np.where(of.back[:, None], back, front)

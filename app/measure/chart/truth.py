"""Truth of the chart at some poses: unbiased light at sampled receivers, and radiance of gloss towards the camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.draw.draw_mesh import DrawMesh, meshes_of, with_vertices
from app.draw.shot import home_camera
from app.draw.vertex_colours import gloss_colours
from app.rest.reference_store import ReferenceStore
from gi_core.gather.reference_sample import draw_by_area
from gi_core.geometry.error import CLOUD_REACH, luminance
from gi_core.geometry.receiver_classes import CLASSES, receiver_classes
from gi_core.instruments.gloss_rays import gloss_views, reference_gloss, shining_faces
from gi_core.solver import Solver

SHARES = {"untouched": 0.4, "affected": 0.2, "mobile": 0.2, "border": 0.2}  # of the sample


class PoseTruth(NamedTuple):
    """One pose of the path, and the truth there at n receivers."""

    frame: int  # of the walk
    rows: np.ndarray  # (n,) receivers
    weights: np.ndarray  # (n,) area per sampled receiver [m2]
    kind: np.ndarray  # (n,) int, of CLASSES
    truth: np.ndarray  # (n, 3) float64 [W/m2]
    standard_error: np.ndarray  # (n, 3) float64 [W/m2]
    places: tuple[np.ndarray, np.ndarray]  # positions (n, 3) in units of the reach of clouds, and normals (n, 3)
    gloss: GlossTruth | None = None  # in view of the camera


def background_of(solver: Solver) -> np.ndarray:
    """Return the irradiance (R, 3) of the static part without mobiles; the poses are put back."""
    poses = dict(solver.poses)
    # 1e3 of the scene size: a mobile there changes nothing
    away = np.asarray(solver.scene.up, float) * 1e3 * solver.scene_size
    solver.move_all({name: p._replace(position=tuple(away * (k + 1))) for k, (name, p) in enumerate(poses.items())})
    irradiance = solver.irradiance.copy()
    solver.move_all(poses)
    return irradiance


def cases(
    solver: Solver, lap: list[dict], frames: list[int], points: int, error: float, seed: int, progress
) -> list[PoseTruth]:
    """Return the truth at some frames of a walk, with a noise of `error` (l1); kept on disk.

    The light of `solver`, which is solved, decides the class of each receiver; SHARES of `points` are drawn from each.
    `progress(stage, fraction)` is called on the way.
    """
    background, start, out = background_of(solver), dict(solver.poses), []
    for k, frame in enumerate(frames):
        solver.move_all(lap[frame])
        areas = solver.receivers.areas
        sides = receiver_classes(solver.surfaces, solver.receivers, solver.irradiance, background)
        rows, weights, kind = choose(sides, areas, points, np.random.default_rng([seed, frame]))
        store = ReferenceStore(solver.model, solver.poses, rows, seed, weights=weights, levels=solver.levels)
        for reached in store.gather(error):
            progress(f"truth {k + 1} of {len(frames)}", (k + reached.fraction) / len(frames))
        gloss = gloss_truth(solver, points, seed + frame)
        places = solver.receivers.positions[rows] / (CLOUD_REACH * solver.scene_size), solver.receivers.normals[rows]
        state = reached.state
        out.append(PoseTruth(frame, rows, weights, kind, state.mean, state.standard_error, places, gloss))
    solver.move_all(start)
    return out


def choose(sides: dict[str, np.ndarray], areas: np.ndarray, points: int, random) -> tuple[np.ndarray, ...]:
    """Return rows, weights and class of about `points` receivers, drawn by area in each class.

    Weights are areas / probabilities: weighted sums over the sample are unbiased estimates of sums over all.
    """
    rows, weights, kind = [], [], []
    for number, name in enumerate(CLASSES):
        mine = np.flatnonzero(sides[name] & (areas > 0))
        if not len(mine):
            continue
        count = max(1, round(SHARES[name] * points))
        if count >= len(mine):
            rows.append(mine)
            weights.append(areas[mine])
        else:
            drawn, times = draw_by_area(mine, areas, count, random)
            rows.append(drawn)
            weights.append(times * areas[mine].sum() / count)
        kind.append(np.full(len(rows[-1]), number))
    return np.concatenate(rows), np.concatenate(weights), np.concatenate(kind)


def steady_and_moved(light: np.ndarray, background: np.ndarray, areas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the receivers that a walk does not change and those that it changes, both (n,) bool.

    light: (frames, n) luminance by many photons; background: (n,) without mobiles. Not changed: never by more than a
    thousandth of the mean; changed: at some time by more than a hundredth.
    """
    mean = float((areas * background).sum() / areas.sum())
    change = np.abs(light - background).max(axis=0)
    return change <= 1e-3 * mean, change > 1e-2 * mean


def light_of(irradiance: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the luminance (n,) of some receivers."""
    return luminance(irradiance[rows])


class GlossTruth(NamedTuple):
    """Gloss at one pose, at n vertices drawn by area."""

    parts: tuple[DrawMesh, ...]  # these vertices per object, the static part first
    back: np.ndarray  # (n,) bool: seen from the back
    eye: np.ndarray  # (3,) float64 [m] in the model's space
    truth: np.ndarray  # (n, 3) float64 [W/m2/sr]
    standard_error: np.ndarray  # (n, 3) float64 [W/m2/sr]
    weights: np.ndarray  # (n,) float64


def gloss_truth(solver: Solver, points: int, seed: int) -> GlossTruth | None:
    """Return the gloss of a solver's poses at a fifth of `points`; None: no vertex in view carries light for it."""
    s, model = solver.surfaces, solver.model
    face_of, is_back = shining_faces(solver)
    rows = np.flatnonzero((face_of >= 0) & (solver.receivers.areas > 0))
    at, eye = model.transforms(solver.poses), home_camera(solver).relative_to(model.origins[0]).eye()
    views = gloss_views(model, at, rows, face_of[rows], eye)
    # least cosine of a view 0.1: pictures hardly show less
    towards = [(views.to_eye * normal).sum(axis=1) > 0.1 for normal in (views.normals, views.flat)]
    rows = rows[towards[0] & towards[1]]
    if not len(rows):
        return None
    rows, weights = draw_by_area(rows, solver.receivers.areas, max(1, round(0.2 * points)), seed)
    views = gloss_views(model, at, rows, face_of[rows], eye)
    radiance = reference_gloss(
        model, at, model.lights_at(solver.levels), views, 4096, seed
    )  # rays per point: 1 to 2 % of noise
    parts = []
    for o, mesh in enumerate(meshes_of(model)):
        mine = rows[(rows >= s.first_receiver[o]) & (rows < s.first_receiver[o + 1])]
        parts.append(with_vertices(mesh, _vertices(mesh, mine, is_back[mine]), np.zeros((0, 3))))
    return GlossTruth(tuple(parts), is_back[rows], eye, *radiance, weights)


def _vertices(mesh: DrawMesh, rows: np.ndarray, is_back: np.ndarray) -> np.ndarray:
    """Return a glossy draw vertex (n,) of each receiver (n,)."""
    out = np.zeros(len(rows), np.int64)
    for side, receivers in enumerate((mesh.front, mesh.back)):
        mine = is_back == bool(side)
        if not mine.any():
            continue
        assert mesh.gloss is not None
        shining = np.flatnonzero(mesh.gloss.receivers[:, side] >= 0)
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

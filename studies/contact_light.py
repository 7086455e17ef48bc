"""Error of drawn light at pixels of the first view, everywhere and beside other parts.

    python -m studies.contact_light showroom gallery --seconds 20 --points 1500 --paths 600

Luminance error (l1, gi_core.geometry.error) [%] of the static part without mobiles: light as pictures interpolate it,
next to independent paths at the very points. *near*: another surface lies along the tangent plane within 0.02 of the
scene's size; *beside*: within a quarter of that. The noise of the paths is subtracted in squares.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from PIL import Image

from app.draw.camera import from_camera
from app.draw.draw_mesh import meshes_of
from app.draw.fine_mesh import fine_points_of
from app.draw.shot import Shot, home_camera
from app.rest.scheduler import gather
from app.settings import Settings, make_solver, open_scene
from gi_core.base.vectors import cross, dot, length
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance
from gi_core.scene.types import Camera, Pose

SHOTS = (  # scene, camera, target, field of view [degrees], poses
    ("classroom", (0.4, 1.5, -2.3), (-0.5, 0.1, 0.5), 38.0, {}),
    ("office", (1.0, 1.3, 1.6), (2.9, 0.3, -0.75), 40.0, {}),
    ("office", (-1.2, 1.6, 1.9), (-2.2, 0.6, -0.4), 42.0, {}),
    ("cornell", (0.36, 0.13, -0.12), (0.34, 0.03, 0.2), 32.0, {"pawn": Pose((0.34, 0.0, 0.2))}),
    ("living_room", (0.8, 0.8, 0.8), (-0.9, 0.15, -1.6), 36.0, {}),
)
NEAR, BESIDE = 0.02, 0.005  # of the scene's size
WAYS = 16  # of the search for other surfaces
LIFT = 1e-4  # of the scene's size
SURFACES = 6  # looked through at most: backs of one-sided faces are not drawn


def seen(solver, camera, aspect: float, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (n, 3), faces (n,) and normals (n, 3) of the static part that random pixels show."""
    surfaces, size = solver.model.surfaces, solver.model.world.size
    at = np.random.default_rng(1).uniform(0, 1, (n, 2))
    origin, way = (np.array(a, float) for a in zip(*(camera.ray(u, v, aspect) for u, v in at), strict=True))
    place, face, left = np.zeros((n, 3)), np.full(n, -1), np.arange(n)
    for _ in range(SURFACES):
        t, hit = nearest(solver.model, origin[left], way[left], 8 * size)
        left, t, hit = left[hit >= 0], t[hit >= 0, None], hit[hit >= 0]
        drawn = (dot(surfaces.normals[hit], way[left]) < 0) | surfaces.two_sided[hit]
        origin[left] += way[left] * t
        place[left[drawn]], face[left[drawn]] = origin[left[drawn]], hit[drawn]
        left = left[~drawn]
        origin[left] += way[left] * (LIFT * size)
    rows = np.flatnonzero(face >= 0)
    normals = surfaces.normals[face[rows]]
    return place[rows], face[rows], normals * np.where(dot(normals, way[rows]) > 0, -1, 1)[:, None]


def nearest(model, origins, ways, limit: float):
    """Return distances (n,) and faces (n,), -1 for none, of rays against the static part."""
    limits = np.full(len(origins), limit, np.float32)
    return model.accelerator.nearest(0, origins.astype(np.float32), ways.astype(np.float32), limits)


def interpolated(solver, place: np.ndarray, face: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the luminance (n,) of irradiance at places as pictures draw it."""
    model, drawn = solver.model, solver.drawn(solver.irradiance)
    front = dot(model.surfaces.normals[face], normals) > 0
    corners = np.where(front[:, None], model.surfaces.corner_front[face], model.surfaces.corner_back[face])
    p = solver.model.object_receivers.positions[corners]
    across = [cross(p[:, (k + 2) % 3] - p[:, (k + 1) % 3], place - p[:, (k + 1) % 3]) for k in range(3)]
    shares = np.maximum(np.abs(np.stack([dot(a, normals) for a in across], axis=1)), 0)
    if drawn.weights is not None:
        shares *= drawn.weights[corners]
    return luminance((shares[..., None] * drawn.irradiance[corners]).sum(axis=1) / shares.sum(axis=1)[:, None])


def distance_to_others(model, place: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the distance (n,) [m] to the next surface along the tangent plane, inf for none."""
    across = cross(normals, np.where(np.abs(normals[:, :1]) > 0.5, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
    across /= length(across)[:, None]
    found = np.full(len(place), np.inf)
    for angle in np.linspace(0, 2 * np.pi, WAYS, endpoint=False):
        way = np.cos(angle) * across + np.sin(angle) * cross(normals, across) + 0.05 * normals
        t, hit = nearest(model, place, way / length(way)[:, None], model.world.size)
        found = np.minimum(found, np.where(hit >= 0, t, np.inf))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="*")
    parser.add_argument("--sheet", metavar="FILE", help="SHOTS: light at receivers, at fine points, per pixel")
    parser.add_argument("--last", nargs=3, default=(), metavar="FILE", help="480x300, the sheet's last row")
    for option, default in (("--seconds", 20.0), ("--points", 1500), ("--paths", 600)):
        parser.add_argument(option, type=type(default), default=default)
    a = parser.parse_args()
    if a.sheet:
        last = [np.hstack([np.asarray(Image.open(file).convert("RGB")) for file in a.last])] if a.last else []
        Image.fromarray(np.vstack([*(strip(a.seconds, *shot) for shot in SHOTS), *last])).save(a.sheet, quality=80)
    print("| scene | everywhere | near | beside | points |\n|---|---|---|---|---|")
    for name in a.scene:
        for line in row(name, a.seconds, a.points, a.paths):
            print(line, flush=True)


def strip(seconds: float, name: str, position, target, degrees: float, poses) -> np.ndarray:
    """Return three pictures of a view side by side, at one exposure."""
    settings, taken = Settings(scene=name, size=(480, 300)), []
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    solver.move_all(poses)
    gather(solver, seconds, lambda *_: None)
    shots = [Shot(solver, settings, paths) for paths in (None, None, 0)]
    for k, shot in enumerate(shots):
        shot.camera = from_camera(Camera(position, target, degrees), solver.scene.up, shot.camera.bounds)
        shots[0].expose()
        shot.exposure = shots[0].exposure
        if k:
            shot.refine()
        taken.append(shot.take())
    return np.concatenate(taken, axis=1)


def row(name: str, seconds: float, points: int, paths: int):
    """Yield rows of the table: light at receivers alone, and with fine points."""
    settings = Settings(scene=name)
    solver = make_solver(replace(open_scene(settings), mobiles=()), settings)
    solver.solve()
    gather(solver, seconds, lambda *_: None, at_poses=False)
    model, aspect = solver.model, settings.size[0] / settings.size[1]
    place, face, normals = seen(solver, home_camera(solver).relative_to(model.origins[0]), aspect, points)
    above = place + LIFT * model.world.size * normals
    truth, deviation = reference_irradiance(solver.scene, above + model.origins[0], normals, paths, 3, model=model)
    truth, noise = luminance(truth), np.sqrt(2 / np.pi) * luminance(deviation)
    others = distance_to_others(model, above, normals)
    meshes, at, levels = meshes_of(model), model.transforms(solver.poses), solver.levels
    *_, fine = fine_points_of(solver, meshes)
    drawn = solver.drawn(solver.irradiance)
    lights = (
        interpolated(solver, place, face, normals),
        of_fine(fine, model, fine.at(at, levels).of(drawn), place, face, normals),
    )
    names = f"{name}, {len(meshes[0].triangles):,} triangles", f"{name}, {len(fine.source):,}"
    for label, light in zip(names, lights, strict=True):
        error, cells = np.abs(light - truth), []
        for some in (others >= 0, others < NEAR * model.world.size, others < BESIDE * model.world.size):
            share, of_truth = (x[some].sum() / truth[some].sum() for x in (error, noise))
            cells.append(f"{100 * np.sqrt(max(share**2 - of_truth**2, 0)):.1f} %")
        yield f"| {label} | {' | '.join(cells)} | {len(place)}, {(others < BESIDE * model.world.size).sum()} beside |"


def of_fine(fine, model, drawn, place, face, normals):
    """Return the luminance (n,) of irradiance at places as pictures draw it with fine points."""
    s = model.surfaces
    order = np.argsort(fine.source, kind="stable")
    first = np.searchsorted(fine.source[order], np.arange(len(s.normals) + 1))
    corners = model.surfaces.vertices[0][model.surfaces.faces[0]]
    out = np.zeros(len(place))
    front = dot(s.normals[face], normals) > 0
    for k in range(len(place)):
        pieces = order[first[face[k]] : first[face[k] + 1]]
        p = np.einsum("fij,jc->fic", fine.weights[pieces], corners[face[k]])
        e1, e2, d = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0], place[k] - p[:, 0]
        a, b, c = (e1 * e1).sum(1), (e1 * e2).sum(1), (e2 * e2).sum(1)
        det = a * c - b * b
        u = ((d * e1).sum(1) * c - (d * e2).sum(1) * b) / det
        v = ((d * e2).sum(1) * a - (d * e1).sum(1) * b) / det
        bary = np.nan_to_num(np.stack([1 - u - v, u, v], axis=1), nan=-9.0)
        best = bary.min(axis=1).argmax()
        ids = fine.ids[pieces[best], :, 0 if front[k] else 1]
        w = np.maximum(bary[best], 0) * (1.0 if drawn.weights is None else drawn.weights[ids])
        out[k] = luminance((w[:, None] * drawn.irradiance[ids]).sum(axis=0) / w.sum())
    return out


if __name__ == "__main__":
    main()

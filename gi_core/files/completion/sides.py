"""Sides of surfaces: two-sided lamps turn their front to the scene, and sides that get no light have no receivers.

Many formats and exporters make every surface two-sided. The inside of a closed body is dark unless it holds a lamp;
the outside of a shell is dark if it holds all lamps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.base.vectors import cross, dot, every
from gi_core.files.completion.pilot import COMPLETION_SEED, Box, Rays, cosine, lift_off
from gi_core.files.formats.file_parts import listed
from gi_core.files.formats.winding import consistent_winding
from gi_core.geometry.mesh_parts import turned_mesh
from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import face_normals
from gi_core.scene.types import DistantLight, Mesh, Scene


def facing_the_scene(scene: Scene) -> tuple[Scene, Rays | None]:
    """Return the scene with two-sided lamps turned if their front faces a wall, and a note for each with two open
    sides; and rays against that scene, if some had to be cast.

    Emission leaves the front only. One-sided lamps are left as they are: their file says which side is the front.
    """
    open_share = 0.5  # of the rays of an open side hits something near, or the lamp; from 0.9 on a side is blocked
    mesh = scene.static
    shines = np.array([m.two_sided and any(m.emission) for m in scene.materials])[mesh.face_material]
    rows = np.flatnonzero(shines)
    if not len(rows):
        return scene, None
    rays = Rays(scene)
    normals, areas = face_normals(mesh)
    body = consistent_winding(weld(mesh.vertices)[mesh.faces[rows]], areas[rows]).body
    turn, both, turned = np.zeros(len(mesh.faces), bool), [], []
    rng = np.random.default_rng(COMPLETION_SEED)
    for b in range(int(body.max()) + 1):
        own = rows[body == b]
        if not areas[own].sum() > 0:
            continue
        front, back = (_blocked(mesh, rays, own, s * normals, areas, rng) for s in (1.0, -1.0))
        name = scene.materials[mesh.face_material[own[0]]].name
        if front > 0.9 and back < open_share:
            turn[own] = True
            turned.append(name)
        elif front < open_share and back < open_share:
            both.append(name)
    notes = list(scene.notes)
    if turned:
        notes.append(f"lamps that faced a wall are turned round: {listed(list(dict.fromkeys(turned)))}")
    if both:
        notes.append(f"two-sided lamps shine from their front alone: {listed(list(dict.fromkeys(both)))}")
    scene = replace(scene, notes=tuple(notes))
    return (replace(scene, static=turned_mesh(mesh, turn)), None) if turned else (scene, rays)


def _blocked(mesh: Mesh, rays: Rays, own, normals, areas, rng) -> float:
    """Return the share of rays from one side of the faces `own` that meet a near surface or one of `own`."""
    rays_per_side = 64  # rays from each side of a lamp
    share = np.cumsum(areas[own])
    pick = own[np.searchsorted(share / share[-1], rng.random(rays_per_side), side="right").clip(0, len(own) - 1)]
    u, v = np.sort(rng.random((2, rays_per_side)), axis=0)
    a, b, c = (mesh.vertices[mesh.faces[pick, k]] for k in range(3))
    n = normals[pick]
    origins = a * u[:, None] + b * (v - u)[:, None] + c * (1 - v)[:, None] + n * lift_off(np.stack([a, b, c], axis=1))
    d = cosine(n, rng)
    t, face = rays.hits(origins, d)
    # Above the lamp's own plane: a slanting ray under a ceiling goes far before it hits that.
    height = t * dot(d, n)
    # surfaces nearer than 0.25 of the root of the lamp's area block a side
    return float(((height < 0.25 * np.sqrt(share[-1])) | np.isin(face, own)).mean())


def one_sided_where_dark(scene: Scene, box: Box) -> Scene:
    """Return the scene with bodies that get light on one side only made one-sided, front outwards or inwards.

    box: of the pilot, with the hits per face and side.
    """
    plenty = 300  # hits on one side of a body and none on the other: the other gets less than a third of a percent
    mesh = scene.static
    two_sided = np.array([m.two_sided and not any(m.emission) for m in scene.materials])[mesh.face_material]
    rows = np.flatnonzero(two_sided)
    if not len(rows):
        return scene
    _, areas = face_normals(mesh)
    places = weld(mesh.vertices)[mesh.faces[rows]]
    winding = consistent_winding(places, areas[rows])
    body, bodies = winding.body, len(winding.orientable)
    hits = np.zeros((len(mesh.faces), 2), np.int64)
    hits[: len(box.side_hits)] = box.side_hits[: len(mesh.faces)]
    hits = hits[rows]
    hits[winding.turned] = hits[winding.turned][:, ::-1]
    front, back = (np.bincount(body, hits[:, k], bodies) for k in (0, 1))

    closed = winding.orientable & _closed(places, body, bodies)
    volume = _volumes(mesh, rows, winding.turned, body, bodies)
    # Fronts of a closed body of negative volume look inwards.
    empty = closed & (np.where(volume > 0, back, front) == 0)
    # The pilot starts sunlight where it lands: it does not count there.
    traced = winding.orientable & (not any(isinstance(light, DistantLight) for light in scene.lights))
    keep_front = (empty & (volume > 0)) | (traced & (front >= plenty) & (back == 0))
    keep_back = (empty & (volume < 0)) | (traced & (back >= plenty) & (front == 0))
    keep_back &= ~keep_front
    if not (keep_front | keep_back).any():
        return scene
    # Turn faces so that the side to keep is the front, and let them wear one-sided copies of their materials.
    turn, changed = np.zeros(len(mesh.faces), bool), np.zeros(len(mesh.faces), bool)
    turn[rows] = np.where(keep_back[body], ~winding.turned, winding.turned & keep_front[body])
    changed[rows] = (keep_front | keep_back)[body]
    materials, face_material = list(scene.materials), mesh.face_material.copy()
    for i in np.unique(face_material[changed]):
        face_material[changed & (mesh.face_material == i)] = len(materials)
        materials.append(materials[i]._replace(two_sided=False))
    static = turned_mesh(mesh, turn)._replace(face_material=face_material.astype(np.int32))
    note = f"{int(changed.sum()):,} of {len(mesh.faces):,} triangles are one-sided: no light gets to their other side"
    return replace(scene, static=static, materials=tuple(materials), notes=(*scene.notes, note))


def _closed(places: np.ndarray, body: np.ndarray, bodies: int) -> np.ndarray:
    """Return which bodies (B,) have two faces at every edge."""
    start, end = places.reshape(-1), places[:, [1, 2, 0]].reshape(-1)
    edge = group_of((np.minimum(start, end), np.maximum(start, end)))
    shut = every((np.bincount(edge)[edge] == 2).reshape(-1, 3))
    return np.bincount(body, ~shut, bodies) == 0


def _volumes(mesh: Mesh, rows, turned, body, bodies: int) -> np.ndarray:
    """Return six times the volume (B,) inside each body, negative where fronts look inwards."""
    p = mesh.vertices[mesh.faces[rows]] - mesh.vertices.mean(axis=0)
    v = dot(cross(p[:, 0], p[:, 1]), p[:, 2])
    return np.bincount(body, np.where(turned, -v, v), bodies)

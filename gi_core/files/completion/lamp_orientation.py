"""Orientation of two-sided lamps: only the front emits, so the front must face the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.base.vectors import dot
from gi_core.files.completion.pilot import SEED, Rays, cosine
from gi_core.files.formats.winding import consistent_winding, turned_mesh
from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import face_normals
from gi_core.scene.types import Mesh, Scene

RAYS_PER_SIDE = 64  # rays from each side of a lamp
NEAR = 0.25  # of the root of the lamp's area: nearer surfaces block a side
BLOCKED, OPEN = 0.9, 0.5  # share of the rays that hit something near, or the lamp itself: from and up to which


def facing_the_scene(scene: Scene) -> tuple[Scene, Rays | None]:
    """Return the scene with two-sided lamps turned if their front faces a wall, and a note for each with two open
    sides; and rays against that scene, if some had to be cast.

    Emission leaves the front only. One-sided lamps are left as they are: their file says which side is the front.
    """
    mesh = scene.static
    shines = np.array([m.two_sided and any(m.emission) for m in scene.materials])[mesh.face_material]
    rows = np.flatnonzero(shines)
    if not len(rows):
        return scene, None
    rays = Rays(scene)
    normals, areas = face_normals(mesh)
    body = consistent_winding(weld(mesh.vertices)[mesh.faces[rows]], areas[rows]).body
    turn, both, turned = np.zeros(len(mesh.faces), bool), [], []
    rng = np.random.default_rng(SEED)
    for b in range(int(body.max()) + 1):
        own = rows[body == b]
        if not areas[own].sum() > 0:
            continue
        front, back = (_blocked(mesh, rays, own, s * normals, areas, rng) for s in (1.0, -1.0))
        name = scene.materials[mesh.face_material[own[0]]].name
        if front > BLOCKED and back < OPEN:
            turn[own] = True
            turned.append(name)
        elif front < OPEN and back < OPEN:
            both.append(name)
    notes = list(scene.notes)
    if turned:
        notes.append(f"lamps that faced a wall are turned round: {_listed(turned)}")
    if both:
        notes.append(f"two-sided lamps shine from their front alone: {_listed(both)}")
    scene = replace(scene, notes=tuple(notes))
    return (replace(scene, static=turned_mesh(mesh, turn)), None) if turned else (scene, rays)


def _blocked(mesh: Mesh, rays: Rays, own, normals, areas, rng) -> float:
    """Return the share of rays from one side of the faces `own` that meet a near surface or one of `own`."""
    share = np.cumsum(areas[own])
    pick = own[np.searchsorted(share / share[-1], rng.random(RAYS_PER_SIDE), side="right").clip(0, len(own) - 1)]
    u, v = np.sort(rng.random((2, RAYS_PER_SIDE)), axis=0)
    a, b, c = (mesh.vertices[mesh.faces[pick, k]] for k in range(3))
    n = normals[pick]
    origins = a * u[:, None] + b * (v - u)[:, None] + c * (1 - v)[:, None] + n * rays.lift
    d = cosine(n, rng)
    t, face = rays.hits(origins, d)
    # Above the lamp's own plane: a slanting ray under a ceiling goes far before it hits that.
    height = t * dot(d, n)
    return float(((height < NEAR * np.sqrt(share[-1])) | np.isin(face, own)).mean())


def _listed(names: list[str]) -> str:
    names = list(dict.fromkeys(names))
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")

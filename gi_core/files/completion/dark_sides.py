"""Dark sides: surfaces become one-sided where their other side gets no light, so that it has no receivers.

Many formats and exporters make every surface two-sided. The inside of a closed body is dark unless it holds a lamp;
the outside of a shell is dark if it holds all lamps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.base.vectors import cross, dot, every
from gi_core.files.completion.pilot import Box
from gi_core.files.formats.winding import consistent_winding, turned_mesh
from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import face_normals
from gi_core.scene.types import DirectionalLight, Mesh, Scene, SkyLight

PLENTY = 300  # hits on one side of a body and none on the other: the other gets less than a third of a percent


def one_sided_where_dark(scene: Scene, box: Box) -> Scene:
    """Return the scene with bodies that get light on one side only made one-sided, front outwards or inwards.

    box: of the pilot, with the hits per face and side.
    """
    mesh = scene.static
    two_sided = np.array([m.two_sided and not any(m.emission) for m in scene.materials])[mesh.face_material]
    rows = np.flatnonzero(two_sided)
    if not len(rows):
        return scene
    _, areas = face_normals(mesh)
    places = weld(mesh.vertices)[mesh.faces[rows]]
    found = consistent_winding(places, areas[rows])
    body, bodies = found.body, len(found.orientable)
    hits = np.zeros((len(mesh.faces), 2), np.int64)
    hits[: len(box.side_hits)] = box.side_hits[: len(mesh.faces)]
    hits = hits[rows]
    hits[found.turned] = hits[found.turned][:, ::-1]
    front, back = (np.bincount(body, hits[:, k], bodies) for k in (0, 1))

    closed = found.orientable & _closed(places, body, bodies)
    volume = _volumes(mesh, rows, found.turned, body, bodies)
    # Fronts of a closed body of negative volume look inwards.
    empty = closed & (np.where(volume > 0, back, front) == 0)
    # The pilot starts sunlight where it lands: it does not count there.
    traced = found.orientable & (not any(isinstance(light, DirectionalLight | SkyLight) for light in scene.lights))
    keep_front = (empty & (volume > 0)) | (traced & (front >= PLENTY) & (back == 0))
    keep_back = (empty & (volume < 0)) | (traced & (back >= PLENTY) & (front == 0))
    keep_back &= ~keep_front
    if not (keep_front | keep_back).any():
        return scene
    # Turn faces so that the side to keep is the front, and let them wear one-sided copies of their materials.
    turn, changed = np.zeros(len(mesh.faces), bool), np.zeros(len(mesh.faces), bool)
    turn[rows] = np.where(keep_back[body], ~found.turned, found.turned & keep_front[body])
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

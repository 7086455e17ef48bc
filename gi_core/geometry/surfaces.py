"""Surfaces: all objects of a scene as flat arrays with one global numbering of faces and receivers.

Object 0 is the static part, object i + 1 is `scene.mobiles[i]`. Geometry stays in object space.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import cross, dot, length
from gi_core.bsdf.ggx import base_albedo
from gi_core.bsdf.table import Table, Tables, join
from gi_core.bsdf.tabulate import tabulate
from gi_core.geometry.receivers import Receivers, build_receivers, no_receivers
from gi_core.geometry.texture_filter import mean_colours
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Gloss, Mesh, Paint, Scene


class Surfaces(NamedTuple):
    """Faces of all objects; per-face arrays are in global face order."""

    vertices: tuple[np.ndarray, ...]  # per object: (V, 3) float64 [m], object space
    faces: tuple[np.ndarray, ...]  # per object: (F, 3) int32 into that object's vertices
    first_face: np.ndarray  # (objects + 1,) int64
    normals: np.ndarray  # (F, 3) float64 unit, object space
    areas: np.ndarray  # (F,) float64 [m2]
    reflectance: np.ndarray  # (F, 3) float64, hemispherical albedo of the diffuse part
    emission: np.ndarray  # (F, 3) float64 Le [W/m2/sr]
    two_sided: np.ndarray  # (F,) bool
    corner_front: np.ndarray  # (F, 3) int32, receiver of each corner on the front
    corner_back: np.ndarray  # (F, 3) int32, on the back; -1 where the face is one-sided
    patch: np.ndarray  # (F,) int32, connected smooth patch
    first_receiver: np.ndarray  # (objects + 1,) int64
    paint: tuple[Paint | None, ...]  # per object: paint, of which `reflectance` is the mean; None: unpainted
    means: tuple[np.ndarray | None, ...]  # per object: (F, 3) float64, of the paint in the scene; None: unpainted
    lobe: np.ndarray  # (F, 5) float64: F0 red, green, blue, F90, alpha of gloss; nan: diffuse; alpha -1 - k: table k
    tables: Tables  # of materials with a model of reflection
    tangent: np.ndarray  # (F, 3) float64 unit, object space, of anisotropic models; (0, 3) without tables
    pane: np.ndarray  # (F,) int32 into `panes`, -1: opaque
    panes: np.ndarray  # (K, 4) float64: internal transmittance red, green, blue; index of refraction

    @property
    def objects(self) -> int:
        return len(self.vertices)

    def face_range(self, o: int) -> slice:
        return slice(int(self.first_face[o]), int(self.first_face[o + 1]))

    def receiver_range(self, o: int) -> slice:
        return slice(int(self.first_receiver[o]), int(self.first_receiver[o + 1]))

    def object_of(self, receivers: np.ndarray | int) -> np.ndarray:
        """Return the object (n,) int64 of each receiver."""
        return np.searchsorted(self.first_receiver[1:], receivers, side="right")


def flatten(
    scene: Scene, with_receivers: bool = True, before: tuple[Scene, Surfaces] | None = None
) -> tuple[Surfaces, Receivers]:
    """Flatten a scene; return surfaces and receivers in object space, none without `with_receivers`.

    before: another version of the scene, whose means of paints are taken over where the paint is the same record.
    """
    meshes = [scene.static, *(m.mesh for m in scene.mobiles)]
    means_before = {} if before is None else _means_of(*before)
    rho = np.array([m.reflectance for m in scene.materials], np.float64).reshape(-1, 3)
    Le = np.array([m.emission for m in scene.materials], np.float64).reshape(-1, 3)
    sided = np.array([m.two_sided or m.pane is not None for m in scene.materials], bool)
    glass = np.cumsum([m.pane is not None for m in scene.materials]) - 1
    pane_of = np.array([k if m.pane else -1 for k, m in zip(glass, scene.materials, strict=True)], np.int32)
    rho[pane_of >= 0] = 0.0
    lobes = np.array([lobe_of(m.gloss) for m in scene.materials], np.float64).reshape(-1, 5)
    tables = tables_of(scene)
    for k, (m, table) in enumerate(tables.items()):
        lobes[m], rho[m] = (0, 0, 0, 0, -1 - k), table.diffuse
    grain = np.array([m.grain for m in scene.materials], np.float64).reshape(-1, 3)
    parts, receivers, paints, means = [], [], [], []
    receiver_count = patch_count = 0
    for mesh in meshes:
        two_sided = sided[mesh.face_material]
        normals, areas = face_normals(mesh)
        built = build_receivers(mesh, normals, areas, two_sided) if with_receivers else no_receivers(mesh)
        front = built.corner_front + receiver_count
        back = np.where(built.corner_back >= 0, built.corner_back + receiver_count, -1)
        reflectance = mesh.face_reflectance
        if reflectance is None:
            reflectance = rho[mesh.face_material] if mesh.paint is None else means_before.get(id(mesh.paint))
            reflectance = mean_colours(mesh.paint) if reflectance is None else reflectance
        means.append(reflectance if mesh.face_reflectance is None and mesh.paint is not None else None)
        lobe, reflectance, paint = lobes[mesh.face_material], np.asarray(reflectance, np.float64), mesh.paint
        tabulated = lobe[:, 4] < 0
        if tabulated.any():
            reflectance, paint = reflectance.copy(), _without(paint, tabulated, rho[mesh.face_material])
            reflectance[tabulated] = rho[mesh.face_material][tabulated]
        pane = pane_of[mesh.face_material]
        if (pane >= 0).any():
            reflectance = np.where((pane >= 0)[:, None], 0.0, reflectance)
        if (lobe[:, 4] >= 0).any():
            textured, reflectance = reflectance, base_albedo(lobe, reflectance)
            paint = _repainted(paint, textured, reflectance)
        paints.append(paint)
        sides = two_sided, front, back, built.patch + patch_count
        along = _tangents(normals, grain[mesh.face_material]) if tables else np.zeros((0, 3))
        parts.append((normals, areas, reflectance, Le[mesh.face_material], *sides, lobe, along, pane))
        # Probes are receivers too, without faces: the last ones of the static part.
        receivers.append(_with_probes(built.receivers, scene) if mesh is scene.static else built.receivers)
        receiver_count += len(receivers[-1].positions)
        patch_count += int(built.patch.max(initial=-1)) + 1
    normals, areas, reflectance, emission, two_sided, front, back, patch, lobe, tangent, pane = (
        np.concatenate(c) for c in zip(*parts, strict=True)
    )
    surfaces = Surfaces(
        vertices=tuple(np.ascontiguousarray(m.vertices, np.float64) for m in meshes),
        faces=tuple(np.ascontiguousarray(m.faces, np.int32) for m in meshes),
        first_face=_offsets([len(m.faces) for m in meshes]),
        normals=normals,
        areas=areas,
        reflectance=np.ascontiguousarray(reflectance, np.float64),
        emission=emission,
        two_sided=two_sided,
        corner_front=front.astype(np.int32),
        corner_back=back.astype(np.int32),
        patch=patch.astype(np.int32),
        first_receiver=_offsets([len(r.positions) for r in receivers]),
        paint=tuple(paints),
        means=tuple(means),
        lobe=np.ascontiguousarray(lobe, np.float64),
        tables=join(list(tables.values())),
        tangent=tangent,
        pane=pane.astype(np.int32),
        panes=np.array([(*m.pane.transmittance, m.pane.ior) for m in scene.materials if m.pane]).reshape(-1, 4),
    )
    return surfaces, Receivers(*(np.concatenate(c) for c in zip(*receivers, strict=True)))


def _means_of(scene: Scene, surfaces: Surfaces) -> dict[int, np.ndarray]:
    """Return the means (F, 3) of the paints of a flattened scene by id(); the scene keeps the paints alive."""
    meshes = (scene.static, *(m.mesh for m in scene.mobiles))
    return {id(mesh.paint): a for mesh, a in zip(meshes, surfaces.means, strict=True) if a is not None}


def tables_of(scene: Scene) -> dict[int, Table]:
    """Return the table of each material that has models of reflection, by material.

    Raises SceneError for a material that reflects more light than arrives.
    """
    out = {}
    for k, m in enumerate(scene.materials):
        if m.brdf:
            try:
                out[k] = tabulate(m.brdf, m.scaled)
            except ValueError as error:
                raise SceneError(f'{scene.name}: material "{m.name}": {error}') from None
    return out


def _repainted(paint: Paint | None, mean: np.ndarray, wanted: np.ndarray) -> Paint | None:
    """Return paint of mean colours `wanted` (F, 3) in place of `mean`: scaled, or plain where most is added to it."""
    most_scale_under_gloss = 2.0  # of paint: where facets add more than the base has, its texture does not show
    if paint is None:
        return None
    paint = _without(paint, wanted.max(axis=1) > most_scale_under_gloss * mean.max(axis=1), wanted)
    scale = np.clip(wanted / np.maximum(mean, 1e-12), 0, most_scale_under_gloss)
    scale[wanted.max(axis=1) > most_scale_under_gloss * mean.max(axis=1)] = 1.0
    return paint._replace(corner_colour=paint.corner_colour * scale[:, None].astype(np.float32))


def _without(paint: Paint | None, faces: np.ndarray, colour: np.ndarray) -> Paint | None:
    """Return paint in which some faces (F,) bool have a plain colour (F, 3)."""
    if paint is None:
        return None
    corners = np.where(faces[:, None, None], colour[:, None], paint.corner_colour).astype(np.float32)
    return paint._replace(face_texture=np.where(faces, -1, paint.face_texture).astype(np.int32), corner_colour=corners)


def _tangents(normals: np.ndarray, grain: np.ndarray) -> np.ndarray:
    """Return unit tangents (F, 3) along the grain (F, 3), or along any axis where it stands on the face."""
    along = np.zeros_like(normals)
    for way in (grain, np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])):
        flat = way - normals * dot(normals, np.broadcast_to(way, normals.shape))[:, None]
        size = length(flat)
        use = ~along.any(axis=1) & (size > 1e-3)
        along[use] = flat[use] / size[use, None]
    return along


def glossy_receivers(surfaces: Surfaces, besides: np.ndarray | None = None) -> np.ndarray:
    """Return the receivers at the corners of glossy faces, ascending, (n,) int64; besides (F,) bool: without these."""
    glossy = ~np.isnan(surfaces.lobe[:, 4]) & (True if besides is None else ~besides)
    corners = np.concatenate([surfaces.corner_front[glossy].reshape(-1), surfaces.corner_back[glossy].reshape(-1)])
    return np.unique(corners[corners >= 0]).astype(np.int64)


def lobe_of(gloss: Gloss | None) -> tuple[float, ...]:
    """Return F0 red, green, blue, F90 and alpha of gloss; nan without."""
    return (math.nan,) * 5 if gloss is None else (*gloss.f0, gloss.f90, gloss.alpha)


def _with_probes(receivers: Receivers, scene: Scene) -> Receivers:
    positions = np.array([p.position for p in scene.probes], np.float64).reshape(-1, 3)
    normals = np.array([p.normal for p in scene.probes], np.float64).reshape(-1, 3)
    normals = normals / np.sqrt((normals * normals).sum(axis=1))[:, None]
    more = Receivers(positions, normals, np.zeros(len(positions)))
    return Receivers(*(np.concatenate(pair) for pair in zip(receivers, more, strict=True)))


def face_normals(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (F, 3) and areas (F,); a zero-area face has normal 0."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    double = cross(b - a, c - a)
    size = length(double)
    return double / np.where(size > 0, size, 1)[:, None], size / 2


def _offsets(counts: list[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


INWARD = 1e-2  # of the offset to the mean centroid of a receiver's faces: well inside a cell, far from the wall


def evaluation_points(surfaces: Surfaces, receivers: Receivers) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and normals, both (R, 3) float64.

    A vertex on an edge lies in the plane of the neighbouring wall, which blocks every ray. Each receiver therefore
    moves by INWARD of the offset to the mean centroid of its faces, and is lifted along its normal. On a convex surface
    the centroids lie below the tangent plane: there the offset is projected on that plane. Centroids are computed from
    receivers, so `receivers` may be at any poses. Receivers without faces (probes) do not move.
    """
    P, N, n = receivers.positions, receivers.normals, len(receivers.positions)
    front, back = surfaces.corner_front, surfaces.corner_back
    sides = front, back[(back >= 0).all(axis=1)]
    rows = np.concatenate([corners.T.reshape(-1) for corners in sides])
    step = np.concatenate([np.tile(P[corners].mean(axis=1), (3, 1)) for corners in sides]) - P[rows]
    count = np.maximum(np.bincount(rows, minlength=n), 1)
    way = np.stack([np.bincount(rows, each, n) for each in step.T], axis=1) / count[:, None]
    distance = np.bincount(rows, np.sqrt((step * step).sum(axis=1)), n) / count
    below = np.minimum((way * N).sum(axis=1), 0)
    way -= below[:, None] * N
    return P + INWARD * way + (1e-3 * distance)[:, None] * N, N.copy()  # edge points stay near the wall

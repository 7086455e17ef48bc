"""Meshes joined, taken apart and turned, with all values of their faces and corners; other colours of faces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gi_core.geometry.receivers import build_receivers
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.texture_filter import MOST_REFLECTANCE
from gi_core.scene.types import Finish, Material, Mesh, Paint, Scene


def plain_paint(mesh: Mesh, materials: Sequence[Material]) -> Paint:
    """Return untextured paint equivalent to the mesh's face reflectances or materials."""
    colour = mesh.face_reflectance
    if colour is None:
        colour = np.array([m.reflectance for m in materials], np.float64).reshape(-1, 3)[mesh.face_material]
    return untextured(np.repeat(colour[:, None], 3, axis=1))


def untextured(corners: np.ndarray) -> Paint:
    """Return the paint of colours (F, 3, 3) alone."""
    n = len(corners)
    return Paint((), np.full(n, -1, np.int32), np.zeros((n, 3, 2), np.float32), corners.astype(np.float32))


def join_paints(meshes: Sequence[Mesh], materials: Sequence[Material]) -> Paint | None:
    """Return the paint of the concatenated faces of several meshes; None if none is painted.

    The face materials of all meshes index `materials`.
    """
    if all(m.paint is None for m in meshes):
        return None
    return _joined([m.paint or plain_paint(m, materials) for m in meshes])


def join_finishes(meshes: Sequence[Mesh]) -> Finish | None:
    """Return the textures of gloss of the concatenated faces of several meshes; None if none has any."""
    if all(m.finish is None for m in meshes):
        return None
    white = [np.ones((len(m.faces), 3, 3), np.float32) for m in meshes]
    layers = []
    for paints in zip(*(m.finish or Finish() for m in meshes), strict=True):
        textured = any(p is not None for p in paints)
        layers.append(_joined([p or untextured(w) for p, w in zip(paints, white, strict=True)]) if textured else None)
    return Finish(*layers)


def each_layer(finish: Finish | None, change: Callable[[Paint], Paint]) -> Finish | None:
    """Return textures of gloss with every paint changed."""
    return None if finish is None else Finish(*(None if p is None else change(p) for p in finish))


def _joined(paints: list[Paint]) -> Paint:
    first = np.cumsum([0, *(len(p.textures) for p in paints)])
    moved = [np.where(p.face_texture < 0, -1, p.face_texture + k) for p, k in zip(paints, first, strict=False)]
    return Paint(
        tuple(t for p in paints for t in p.textures),
        np.concatenate(moved).astype(np.int32),
        np.concatenate([p.corner_uv for p in paints]),
        np.concatenate([p.corner_colour for p in paints]),
    )


def rows_of(paint: Paint, faces: np.ndarray) -> Paint:
    """Return the paint of the given faces."""
    columns = (paint.face_texture, paint.corner_uv, paint.corner_colour)
    return Paint(paint.textures, *(c[faces] for c in columns))


def with_colours(mesh: Mesh, rows: np.ndarray, colours: np.ndarray, rho: np.ndarray) -> Mesh:
    """Return a mesh with k of its faces, rows (F,) bool, in colours (k, 3) or one (1, 3), without texture.

    rho (M, 3): reflectance of the materials, which other faces keep.
    """
    if mesh.paint is not None:
        texture, colour = mesh.paint.face_texture.copy(), mesh.paint.corner_colour.copy()
        texture[rows], colour[rows] = -1, colours[:, None]
        mesh = mesh._replace(paint=mesh.paint._replace(face_texture=texture, corner_colour=colour))
    if mesh.paint is None or mesh.face_reflectance is not None:
        faces = rho[mesh.face_material] if mesh.face_reflectance is None else mesh.face_reflectance.copy()
        faces[rows] = colours
        mesh = mesh._replace(face_reflectance=faces)
    return mesh


def with_scaled_colours(mesh: Mesh, factors: np.ndarray) -> Mesh:
    """Return a mesh whose faces have their colours times factors (F, 3) or (F, 1), up to MOST_REFLECTANCE."""
    paint, flat = mesh.paint, mesh.face_reflectance
    if paint is not None:
        colour = np.minimum(paint.corner_colour * factors[:, None].astype(np.float32), 1)
        paint = paint._replace(corner_colour=colour)
    if flat is not None:
        flat = np.where(factors == 1, flat, np.minimum(flat * factors, MOST_REFLECTANCE))
    return mesh._replace(paint=paint, face_reflectance=flat)


def with_meshes(scene: Scene, change: Callable[[Mesh], Mesh]) -> Scene:
    """Return a scene with the mesh of each object changed."""
    static = change(scene.static)
    return replace(scene, static=static, mobiles=tuple(m._replace(mesh=change(m.mesh)) for m in scene.mobiles))


def join(meshes: list[Mesh], materials: Sequence[Material]) -> Mesh:
    """Return several meshes as one; face materials already index the same list."""
    if len(meshes) == 1:
        return meshes[0]
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    normals = colours = None
    if any(m.corner_normals is not None for m in meshes):
        normals = np.concatenate(
            [m.corner_normals if m.corner_normals is not None else crease_corner_normals(m) for m in meshes]
        )
    if any(m.face_reflectance is not None for m in meshes):
        rho = np.array([m.reflectance for m in materials])
        colours = np.concatenate(
            [m.face_reflectance if m.face_reflectance is not None else rho[m.face_material] for m in meshes]
        )
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + o for m, o in zip(meshes, first, strict=False)]).astype(np.int32),
        np.concatenate([m.face_material for m in meshes]).astype(np.int32),
        normals,
        colours,
        join_paints(meshes, materials),
        join_finishes(meshes),
    )


def part_of(mesh: Mesh, rows: np.ndarray) -> Mesh:
    """Return the mesh of some of the faces, rows (F,) bool, and of their vertices alone."""
    paint, normals, colours = mesh.paint, mesh.corner_normals, mesh.face_reflectance
    return compact(
        Mesh(
            mesh.vertices,
            mesh.faces[rows],
            mesh.face_material[rows],
            None if normals is None else normals[rows],
            None if colours is None else colours[rows],
            None if paint is None else rows_of(paint, rows),
        )
    )


def compact(mesh: Mesh) -> Mesh:
    """Drop vertices that no face uses."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    return mesh._replace(
        vertices=np.ascontiguousarray(mesh.vertices[used]), faces=faces.reshape(-1, 3).astype(np.int32)
    )


def flipped(corners: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return values (F, 3, ...) per corner of faces, some wound the other way."""
    corners = corners.copy()
    corners[turn] = corners[turn][:, ::-1]
    return corners


def turned_mesh(mesh: Mesh, turn: np.ndarray) -> Mesh:
    """Return the mesh with some faces wound the other way, with all their values per corner."""

    def turned(paint):
        uv, colour = (flipped(a, turn) for a in (paint.corner_uv, paint.corner_colour))
        return paint._replace(corner_uv=uv, corner_colour=colour)

    normals = mesh.corner_normals
    if normals is not None:
        normals = flipped(normals, turn)
        normals[turn] = -normals[turn]
    paint, finish = None if mesh.paint is None else turned(mesh.paint), each_layer(mesh.finish, turned)
    return mesh._replace(faces=flipped(mesh.faces, turn), corner_normals=normals, paint=paint, finish=finish)


def crease_corner_normals(mesh: Mesh) -> np.ndarray:
    """Return corner normals (F, 3, 3) smoothed across edges that turn by less than the crease angle."""
    built = build_receivers(mesh, *face_normals(mesh), np.zeros(len(mesh.faces), bool))
    return built.receivers.normals[built.corner_front]

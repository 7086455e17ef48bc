"""Meshes joined, taken apart and turned, with all values of their faces and corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gi_core.geometry.paint import each_layer, join_finishes, join_paints, rows_of
from gi_core.geometry.receivers import build_receivers
from gi_core.geometry.surfaces import face_normals
from gi_core.scene.types import Material, Mesh


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

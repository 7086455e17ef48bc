"""Mesh files as clean triangles: read by format, then repaired, with a note for every repair.

Each format has a reader in a file beside this one.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import group_of, order_of
from gi_core.base.vectors import cross, dot, every, greatest, length
from gi_core.files.formats.boundary import MOST_AT_VERTEX, Boundary
from gi_core.files.formats.file_parts import FileParts, listed
from gi_core.files.formats.gltf_file import read_gltf
from gi_core.files.formats.obj_file import read_obj
from gi_core.files.formats.ply_file import read_ply
from gi_core.files.formats.stl_file import read_stl
from gi_core.files.formats.winding import faces_to_turn
from gi_core.geometry.mesh_parts import compact, crease_corner_normals, each_layer, flipped, join, rows_of, turned_mesh
from gi_core.geometry.receivers import FACES_COMPARED, weld
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.texture_filter import MOST_REFLECTANCE
from gi_core.scene.errors import SceneError, one_line, shown, utf8
from gi_core.scene.rules import BIGGEST
from gi_core.scene.types import Camera, Light, Material, Mesh, Paint, PlacedLight
from gi_core.scene.validate import strength_of

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")
BRIGHTEST = FARTHEST = BIGGEST  # radiance, coordinates: as in scene files
FARTHEST_UV = 1e6  # texture coordinates beyond have no digits left for a place in the texture


class MeshFile(NamedTuple):
    """A mesh file, cleaned. Face materials index `materials`."""

    mesh: Mesh
    materials: list[Material]
    lights: list[Light]
    camera: Camera | None
    up: str  # "y" or "z", by the format's custom
    notes: list[str]


def read_mesh_file(path: Path, where: str | None = None, boundary: Boundary | None = None) -> MeshFile:
    """Read a mesh file and clean it; the files that it names lie within the boundary, its own folder if None.

    Raises SceneError if the file is missing, of another format, damaged, or holds no triangle.
    """
    path = Path(path)
    where = where or str(path)
    boundary = boundary or Boundary(path.parent, named=path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"{where}: a mesh file must be one of {' '.join(SUFFIXES)}, got {suffix or 'no suffix'}")
    data = boundary.read(path, where)
    if not data:
        raise SceneError(f"{where}: the file is empty, 0 bytes long; export it again")
    read = {".glb": read_gltf, ".gltf": read_gltf, ".obj": read_obj, ".ply": read_ply}.get(suffix, read_stl)
    with np.errstate(all="ignore"):  # numbers that overflow are refused or limited when all are read
        return _clean(read(path, data, where, boundary), where)


def _clean(read: FileParts, where: str) -> MeshFile:
    notes = list(read.notes)
    parts = [_tamed(p) for p in read.parts if len(p.faces)]
    materials = _clamped(read.materials, _worn(parts, read.materials), notes, where)
    if not parts:
        raise SceneError(f"{where}: the mesh has no triangles; a scene needs at least one")
    for p in parts:
        farthest = np.abs(p.vertices[p.faces]).max()
        if not np.isfinite(farthest):
            raise SceneError(f"{where}: vertices must be finite numbers, got NaN or infinity; repair the mesh")
        if farthest > FARTHEST:
            raise SceneError(
                f"{where}: vertices must be numbers up to {FARTHEST:g}, got {farthest:.3g}; repair the mesh"
            )
    mesh = join([p._replace(corner_normals=None) for p in parts], materials)
    most = int(np.bincount(mesh.faces.reshape(-1)).max())
    if most > MOST_AT_VERTEX:
        raise SceneError(
            f"{where}: a vertex must have no more than {MOST_AT_VERTEX:,} triangles, got {most:,}; cut its polygon"
        )
    part_of = np.repeat(np.arange(len(parts)), [len(p.faces) for p in parts])
    turn, torn = faces_to_turn(parts, mesh.vertices, mesh.faces)
    mesh = turned_mesh(mesh, turn)
    look = _looks(mesh)
    keep, sided = _repair(mesh.vertices, mesh.faces, mesh.face_material, look, materials, notes)
    if turn[keep].any():
        notes.append(f"{int(turn[keep].sum()):,} triangles were wound against their neighbours or normals: turned")
    if not len(keep):
        raise SceneError(f"{where}: every triangle of the mesh has zero area; is it compressed or flattened?")
    material = _with_sides(mesh.face_material, sided | torn, True, materials)
    vertices, faces, apart = _moved_apart(mesh.vertices, mesh.faces[keep], look[keep], notes)
    material = _with_sides(material, np.isin(np.arange(len(mesh.faces)), keep[apart]), False, materials)
    material, materials = _needed(material[keep], materials)
    paint, finish = mesh.paint, mesh.finish if any(mesh.finish or ()) else None
    mesh = Mesh(vertices, faces.astype(np.int32), material.astype(np.int32))
    mesh = mesh._replace(
        corner_normals=_corner_normals(mesh, parts, part_of[keep], keep, turn, notes),
        paint=None if paint is None else rows_of(_limited(paint._replace(textures=read.textures)), keep),
        finish=each_layer(finish, lambda layer: rows_of(layer._replace(textures=read.finishes), keep)),
    )
    materials = [m._replace(name=utf8(m.name)) for m in materials]
    lights = [light._replace(name=utf8(light.name)) for light in read.lights]
    return MeshFile(compact(mesh), materials, lights, read.camera, read.up, [one_line(n) for n in notes])


def _tamed(part: Mesh) -> Mesh:
    """Return the part with finite normals, colours and texture coordinates; vertices must be finite already.

    A vertex that no face uses may be anything, infinite too: it is put where it does no harm.
    """

    def tamed(paint: Paint) -> Paint:
        uv = np.clip(np.nan_to_num(paint.corner_uv), -FARTHEST_UV, FARTHEST_UV)
        return paint._replace(corner_uv=uv, corner_colour=np.nan_to_num(paint.corner_colour))

    normals = part.corner_normals
    used = np.zeros(len(part.vertices), bool)
    used[part.faces] = True
    return part._replace(
        vertices=np.where(used[:, None], part.vertices, part.vertices[part.faces[0, 0]]),
        corner_normals=None if normals is None else np.clip(np.nan_to_num(normals), -FARTHEST, FARTHEST),
        paint=None if part.paint is None else tamed(part.paint),
        finish=each_layer(part.finish, tamed),
    )


def _worn(parts: list[Mesh], materials: list[Material]) -> set[int]:
    """Return the materials whose reflectance is the colour of a face."""
    rho, worn = np.array([m.reflectance for m in materials], np.float32), set[int]()
    for p in parts:
        rows = slice(None)
        if p.paint is not None:
            same = (p.paint.corner_colour == rho[p.face_material][:, None]).all(axis=(1, 2))
            rows = same & (p.paint.face_texture < 0)
        worn |= set(p.face_material[rows].tolist())
    return worn


def _clamped(materials: list[Material], worn: set[int], notes: list[str], where: str) -> list[Material]:
    """Return materials with reflectance clamped to the largest one; noted where faces have that colour."""
    result, bright = [], []
    for i, m in enumerate(materials):
        for what, colour in (("reflectance", m.reflectance), ("emission", m.emission)):
            if not all(0 <= c <= BRIGHTEST for c in colour):
                raise SceneError(
                    f'{where}: material "{m.name}": its {what} must be from 0 to {BRIGHTEST:g} in each channel, '
                    f"got {shown(list(colour))}; correct it, or export it again"
                )
        if max(m.reflectance) > MOST_REFLECTANCE:
            if i in worn:
                bright.append(m.name)
            m = m._replace(reflectance=tuple(min(c, MOST_REFLECTANCE) for c in m.reflectance))
        result.append(m)
    if bright:
        notes.append(f"reflectance limited to {MOST_REFLECTANCE}: {listed(list(dict.fromkeys(bright)))}")
    return result


def _looks(mesh: Mesh) -> np.ndarray:
    """Return a number (F,) int64 for each look of faces: material, texture, mean place in it, mean colour."""
    paint = mesh.paint
    if paint is None:
        return mesh.face_material
    values = np.concatenate([paint.corner_uv.mean(axis=1), paint.corner_colour.mean(axis=1)], axis=1, dtype=np.float64)
    # colours and places in a texture that differ by less than 1e-4 are the same
    columns = np.round(np.clip(values, -FARTHEST_UV, FARTHEST_UV) / 1e-4).astype(np.int64)
    return group_of((mesh.face_material, paint.face_texture, *columns.T))


def _repair(vertices, faces, material, look, materials, notes):
    """Return the faces to keep, and which of them must become two-sided."""
    p = vertices[faces]
    double = cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    longest = greatest(length(p - p[:, [2, 0, 1]]))
    reach = np.abs(p - np.median(p, axis=(0, 1))).max(axis=(1, 2), initial=0.0)
    height = length(double) / np.where(longest > 0, longest, 1)
    # a face lower than 2e-7 of its coordinates is a line (float32 files cannot say it better)
    solid = np.flatnonzero(height > 2e-7 * reach)

    # Faces on the same three places: keep the emissive one, else the first, and one back to back that looks different.
    ids = weld(vertices)[faces[solid]]
    key = np.sort(ids, axis=1)
    emissive = np.array([any(m.emission) for m in materials])[material[solid]]
    order = order_of((*key.T, ~emissive))
    k = key[order]
    first = np.ones(len(k), bool)
    first[1:] = (k[1:] != k[:-1]).any(axis=1)
    leader = order[np.maximum.accumulate(np.where(first, np.arange(len(k)), 0))]
    back = np.flatnonzero(dot(double[solid[order]], double[solid[leader]]) < 0)
    back = back[np.unique(leader[back], return_index=True)[1]]  # one for each leader
    same = look[solid[order[back]]] == look[solid[leader[back]]]
    # A pair of one look stands for a sheet that is seen from both sides.
    sided = np.zeros(len(faces), bool)
    sided[solid[leader[back[same]]]] = True
    first[back[~same]] = True
    keep = np.sort(solid[order[first]])
    zero, double = len(faces) - len(solid), len(solid) - len(keep)
    if zero or double:
        counts = (zero, "triangle", " of zero area"), (double, "duplicate", "")
        parts = [f"{n:,} {what}{'s' * (n != 1)}{kind}" for n, what, kind in counts if n]
        notes.append(f"left out {' and '.join(parts)} of {len(faces):,}")
    return keep, sided


def _moved_apart(vertices, faces, look, notes):
    """Return vertices, faces (F, 3) and which of these are back to back, each moved to its front by a hair.

    Rays end on the first face that they meet, and of two in one place it may be the one that they meet from behind. Two
    faces of two looks lie back to back where they share an edge, run it in opposite directions and have opposite
    normals, however the sheet is triangulated.
    """
    sheet_gap = 1e-5  # of the distance from the middle of the mesh: between a sheet and each of two faces back to back
    normals, _ = face_normals(Mesh(vertices, faces, look))
    places = weld(vertices)[faces]
    start, end = places.reshape(-1), places[:, [1, 2, 0]].reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = order_of((low, high))
    apart = np.zeros(len(faces), bool)
    for ahead in range(1, FACES_COMPARED + 1):
        a, b = order[:-ahead], order[ahead:]
        facing = (low[a] == low[b]) & (high[a] == high[b]) & (start[a] == end[b])
        a, b = a[facing] // 3, b[facing] // 3
        # cosine between normals of faces that lie in one plane
        facing = (look[a] != look[b]) & (dot(normals[a], normals[b]) < -(1 - 1e-6))
        apart[a[facing]] = apart[b[facing]] = True
    if not apart.any():
        return vertices, faces, apart
    # Corners of one place and look move as one; faces between such corners come along.
    side = group_of((places.reshape(-1), np.repeat(look, 3))).reshape(-1, 3)
    ways = np.zeros((side.max() + 1, 3))
    np.add.at(ways, side[apart], normals[apart][:, None])
    size = length(ways)
    ways /= np.where(size > 0, size, 1.0)[:, None]
    apart |= (dot(ways[side], normals[:, None]) > 0.5).all(axis=1)
    corners = faces[apart]
    reach = float(np.abs(vertices[corners] - np.median(vertices, axis=0)).max())
    moved = vertices[corners] + sheet_gap * reach * ways[side[apart]]
    _, first, number = np.unique(weld(moved.reshape(-1, 3)), return_index=True, return_inverse=True)
    faces = faces.copy()
    faces[apart] = len(vertices) + number.reshape(-1, 3)
    gap = f"{2 * sheet_gap * reach:.1g}"
    notes.append(f"{int(apart.sum()):,} triangles back to back are apart by {gap}, each seen from its front")
    return np.concatenate([vertices, moved.reshape(-1, 3)[first]]), faces, apart


def _with_sides(material, rows, two_sided: bool, materials):
    """Return materials (F,) of faces; those of `rows` (F,) bool are two-sided or not, as copies where need be."""
    material = material.copy()
    changed = [i for i in np.unique(material[rows]) if materials[i].two_sided != two_sided]
    copies = np.arange(len(materials))
    copies[changed] = len(materials) + np.arange(len(changed))
    materials += [materials[i]._replace(two_sided=two_sided) for i in changed]
    material[rows] = copies[material[rows]]
    return material


def _needed(material: np.ndarray, materials: list[Material]) -> tuple[np.ndarray, list[Material]]:
    """Return the materials (F,) of faces among fewer, and these: without copies of a name that no face has."""
    used = np.isin(np.arange(len(materials)), material)
    names = {m.name for m, is_used in zip(materials, used, strict=True) if is_used}
    needed = used | np.array([m.name not in names for m in materials], bool)
    return (np.cumsum(needed) - 1)[material], [m for m, is_needed in zip(materials, needed, strict=True) if is_needed]


def _corner_normals(mesh: Mesh, parts: list[Mesh], part_of, keep, turn, notes) -> np.ndarray | None:
    """Return unit normals (F, 3, 3), None if no part has usable ones."""
    bare = np.array([p.corner_normals is None for p in parts])
    if bare.all():
        return None
    faces = [np.zeros((len(p.faces), 3, 3)) if p.corner_normals is None else p.corner_normals for p in parts]
    flat = np.repeat(face_normals(mesh)[0][:, None], 3, axis=1)
    n = flipped(np.concatenate(faces), turn)[keep]
    size = length(n)[..., None]
    good = np.isfinite(size) & (size > 1e-12)
    n = np.where(good, n / np.where(good, size, 1), flat)
    # below a cosine of 0.1 to the geometric normal, a file's normal is not believed
    wrong = ~every(dot(n, flat) >= 0.1)
    wrongs, counts = (np.bincount(part_of, of, len(parts)) for of in (wrong, None))
    opposed = ~bare & (wrongs > 0.1 * counts)  # with more than 0.1 of such faces, no normal of the part is believed
    if opposed.any():
        notes.append(f"normals of {opposed.sum()} of {len(parts)} parts oppose their faces: taken from crease angles")
    if (bare | opposed).all():
        return None
    n[wrong] = flat[wrong]  # the odd wrong face stays flat
    rest = np.flatnonzero((bare | opposed)[part_of])
    if len(rest):
        n[rest] = crease_corner_normals(Mesh(mesh.vertices, mesh.faces[rest], mesh.face_material[rest]))
    return n


def _limited(paint: Paint) -> Paint:
    """Return the paint with colours from 0 to the largest reflectance; a texture has a limit of its own."""
    most = np.where(paint.face_texture < 0, MOST_REFLECTANCE, 1.0)[:, None, None]
    return paint._replace(corner_colour=np.clip(paint.corner_colour, 0, most).astype(np.float32))


def scaled(read: MeshFile, factor: float) -> MeshFile:
    """Return the file with every length times `factor`, and the same picture.

    Irradiance falls with the square of the distance: lamps with a place get the square of the factor, so that
    irradiance stays. Radiance and sunlight do not depend on distance and stay.
    """
    if factor == 1.0:
        return read
    camera = read.camera
    if camera is not None:
        camera = Camera(_times(camera.position, factor), _times(camera.target, factor), camera.vertical_fov_degrees)
    return read._replace(
        mesh=read.mesh._replace(vertices=read.mesh.vertices * factor),
        lights=[_scaled_light(light, factor) for light in read.lights],
        camera=camera,
    )


def _scaled_light(light: Light, factor: float) -> Light:
    if not isinstance(light, PlacedLight):
        return light
    strength = strength_of(light)
    place, more = _times(light.position, factor), _times(getattr(light, strength), factor**2)
    return light._replace(position=place, **{strength: more})


def _times(values, factor: float) -> tuple[float, float, float]:
    return tuple(v * factor for v in values)

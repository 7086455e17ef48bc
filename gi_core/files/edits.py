"""Edits of a scene after loading: a material, a mobile inserted, copied or removed, static faces made mobile and back.

An edited scene is a scene: it equals one that was built so, and its solver needs no history. `Solver.edited` keeps the
photon paths that an edit does not touch.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gi_core.base.grouping import components
from gi_core.base.vectors import cross, dot
from gi_core.bsdf.ggx import further_albedo, under_gloss
from gi_core.files.completion.completion import complete
from gi_core.files.completion.pilot import bottom_centre
from gi_core.files.formats.materials_table import FINISH, checked, overridden
from gi_core.files.formats.mesh_file import compact
from gi_core.files.formats.metallic_roughness import as_metal_rough
from gi_core.files.formats.toml_fields import Table
from gi_core.files.gloss_classes import with_gloss_classes
from gi_core.files.load import finished, join, with_mobile_file
from gi_core.geometry.cutouts import without_holes
from gi_core.geometry.surfaces import Surfaces, lobe_of
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.origin import origin_of, translated
from gi_core.scene.pose import as_pose, three, to_world, to_world_directions
from gi_core.scene.rules import PLACE
from gi_core.scene.types import Mesh, Mobile, Pose, Scene
from gi_core.scene.validate import check_scene

Values = tuple[tuple[str, Any], ...]  # keys and values of [materials.NAME] in a scene file


class Finish(NamedTuple):
    """Give all faces of a mobile, or of a material, another reflection.

    A reflectance replaces textures; without one they stay. Without roughness or a model the surface is diffuse.
    """

    name: str  # of a mobile, else of a material
    material: Values  # of FINISH, or parameters of a model


class Insert(NamedTuple):
    """Add a mobile from a mesh file, turned upright and sized as `load_scene(mobiles=...)` does."""

    name: str
    file: str
    pose: Pose | None = None  # None: on the nearest free floor in view


class Duplicate(NamedTuple):
    """Add a copy of a mobile."""

    name: str
    of: str
    pose: Pose


class Remove(NamedTuple):
    """Remove a mobile."""

    name: str


class Promote(NamedTuple):
    """Make a connected piece of the static part a mobile: the one whose surface is nearest to a point."""

    name: str
    point: tuple[float, float, float]  # [m]


class Freeze(NamedTuple):
    """Make a mobile at a pose part of the static part."""

    name: str
    pose: Pose


class EditError(SceneError):
    """An edit that its scene refuses; `number`: its place in the list of edits, from 0."""

    number = 0


Edit = Finish | Insert | Duplicate | Remove | Promote | Freeze
KINDS: dict[str, type[Edit]] = {
    kind.__name__.lower(): kind for kind in (Finish, Insert, Duplicate, Remove, Promote, Freeze)
}

ADDING, TAKING = (Insert, Duplicate, Promote), (Remove, Freeze)  # a mobile


def edited(scene: Scene, edits: Sequence[Edit], allow_outside: bool = False) -> Scene:
    """Return a scene after edits, in order; allow_outside: as for load_scene(), of inserted files.

    Raises EditError for a name that the scene does not have at that point, or has already, and for a bad value.
    """
    for number, edit in enumerate(edits):
        try:
            scene = _edited(scene, edit, allow_outside)
            if number == len(edits) - 1:
                check_scene(scene)
        except SceneError as problem:
            refused = EditError(str(problem))
            refused.number = number
            raise refused from None
    return scene


def names_after(names: Iterable[str], before: Sequence[Edit], after: Sequence[Edit]) -> set[str]:
    """Return the names of the mobiles after some edits, from those after other edits of the same scene."""
    found = set(names)
    for edit in reversed(before):
        found = found - {edit.name} if isinstance(edit, ADDING) else found
        found = found | {edit.name} if isinstance(edit, TAKING) else found
    for edit in after:
        found = found | {edit.name} if isinstance(edit, ADDING) else found
        found = found - {edit.name} if isinstance(edit, TAKING) else found
    return found


def _edited(scene: Scene, edit: Edit, allow_outside: bool) -> Scene:
    match edit:
        case Finish(name, material):
            values = {key: list(v) if isinstance(v, tuple) else v for key, v in material}
            table = checked(values, f"{scene.name}: the material of {shown(name)}", FINISH)
            return _finished(scene, name, table)
        case Insert(name, file, pose):
            return _inserted(scene, _new(scene, name), Path(file), pose, allow_outside)
        case Duplicate(name, of, pose):
            copy = _mobile(scene, of)._replace(name=_new(scene, name), pose=_pose(scene, name, pose), path=None)
            return replace(scene, mobiles=(*scene.mobiles, copy))
        case Remove(name):
            return _without(scene, _mobile(scene, name))
        case Promote(name, point):
            return _promoted(scene, _new(scene, name), PLACE.check(f"{scene.name}: the point of {shown(name)}", point))
        case Freeze(name, pose):
            return _frozen(scene, _mobile(scene, name), _pose(scene, name, pose))


def _mobile(scene: Scene, name: str) -> Mobile:
    for mobile in scene.mobiles:
        if mobile.name == name:
            return mobile
    there = ", ".join(f'"{m.name}"' for m in scene.mobiles) or "none"
    raise SceneError(f"{scene.name}: no mobile is called {shown(name)}; there is {there}")


def _new(scene: Scene, name: str) -> str:
    if not name or any(m.name == name for m in scene.mobiles):
        raise SceneError(f"{scene.name}: a new mobile must have a name of its own, got {shown(name)}")
    return name


def _pose(scene: Scene, name: str, pose: Pose) -> Pose:
    return as_pose(pose, f"{scene.name}: mobile {shown(name)}")


def _without(scene: Scene, mobile: Mobile) -> Scene:
    return replace(scene, mobiles=tuple(m for m in scene.mobiles if m is not mobile))


# Materials ------------------------------------------------------------------------------------------


def _recoloured_faces(scene: Scene, these: np.ndarray, colours: np.ndarray) -> Scene:
    """Return a scene in which faces of some materials, these (n,) bool, have their colours (n, 3)."""
    rho = np.array([m.reflectance for m in scene.materials], np.float64)

    def painted(mesh: Mesh) -> Mesh:
        rows = these[mesh.face_material]
        return _painted(mesh, rows, colours[mesh.face_material[rows]], rho) if rows.any() else mesh

    mobiles = tuple(m._replace(mesh=painted(m.mesh)) for m in scene.mobiles)
    return replace(scene, static=painted(scene.static), mobiles=mobiles)


def _painted(mesh: Mesh, rows: np.ndarray, reflectance: np.ndarray, rho: np.ndarray) -> Mesh:
    """Return a mesh with k of its faces, rows (F,) bool, in colours (k, 3) or one (1, 3), without texture."""
    if mesh.paint is not None:
        texture, colour = mesh.paint.face_texture.copy(), mesh.paint.corner_colour.copy()
        texture[rows], colour[rows] = -1, reflectance[:, None]
        mesh = mesh._replace(paint=mesh.paint._replace(face_texture=texture, corner_colour=colour))
    if mesh.paint is None or mesh.face_reflectance is not None:
        faces = rho[mesh.face_material] if mesh.face_reflectance is None else mesh.face_reflectance.copy()
        faces[rows] = reflectance
        mesh = mesh._replace(face_reflectance=faces)
    return mesh


def _materials_called(scene: Scene, name: str) -> np.ndarray:
    """Return which materials (n,) bool have a name. Raises SceneError where none has."""
    these = np.array([m.name == name for m in scene.materials], bool)
    if not these.any():
        names = ", ".join(dict.fromkeys(f'"{m.name}"' for m in (*scene.mobiles, *scene.materials)))
        raise SceneError(f"{scene.name}: no mobile or material is called {shown(name)}; there is {names}")
    return these


def _finished(scene: Scene, name: str, table: Table) -> Scene:
    """Return a scene whose mobile has materials of its own, or whose materials of a name are others."""
    for mobile in scene.mobiles:
        if mobile.name == name:
            used, index = np.unique(mobile.mesh.face_material, return_inverse=True)
            own = tuple(scene.materials[k]._replace(name=name) for k in used)
            mesh = mobile.mesh._replace(face_material=(len(scene.materials) + index.reshape(-1)).astype(np.int32))
            mobiles = tuple(m._replace(mesh=mesh) if m is mobile else m for m in scene.mobiles)
            scene = replace(scene, materials=(*scene.materials, *own), mobiles=mobiles)
            break
    these = _materials_called(scene, name)
    materials = tuple(
        overridden(m._replace(gloss=None, brdf=()), table) if this else m
        for m, this in zip(scene.materials, these.tolist(), strict=True)
    )
    if "reflectance" in table:
        scene = _recoloured_faces(scene, these, np.array([m.reflectance for m in materials], np.float64))
    return replace(scene, materials=materials)


def finish_of(scene: Scene, surfaces: Surfaces, name: str, of_static: bool) -> Values:
    """Return the reflection of a mobile, or of a material of the static part: that of its largest face.

    A diffuse reflectance is the mean over the area. () for an unknown name.
    """
    names = [m.name for m in scene.mobiles]
    o = 0 if of_static or name not in names else 1 + names.index(name)
    faces = (scene.static if o == 0 else scene.mobiles[o - 1].mesh).face_material
    area = surfaces.areas[surfaces.face_range(o)]
    if o == 0:
        area = area * np.array([m.name == name for m in scene.materials])[faces]
    if not area.sum() > 0:
        return ()
    m = scene.materials[faces[area.argmax()]]
    if m.brdf:
        return (("brdf", m.brdf[0].model), *m.brdf[0].parameters)
    base = ("reflectance", three(np.minimum(area @ surfaces.reflectance[surfaces.face_range(o)] / area.sum(), 0.98)))
    if m.gloss is None:
        return (base,)
    row = np.array([lobe_of(m.gloss)])  # surfaces have the base's reflectance under gloss: base_albedo() inverted
    further, through = further_albedo(row)[0], under_gloss(row)
    found = as_metal_rough(np.maximum(np.array(base[1]) - further, 0) / np.maximum(through - further, 1e-9), m.gloss)
    colour = ("reflectance", three(np.minimum(found.base, 0.98)))
    return colour, ("metallic", found.metallic), ("roughness", found.roughness), ("ior", found.ior)


# Objects --------------------------------------------------------------------------------------------


def _inserted(scene: Scene, name: str, path: Path, pose: Pose | None, allow_outside: bool) -> Scene:
    origin = origin_of(scene.static)
    scene, up = with_mobile_file(translated(scene, -origin), path, name, allow_outside)
    scene, *_ = complete(scene, [(len(scene.mobiles) - 1, up)], bare=False)
    mobile = finished(scene.mobiles[-1])
    scene = with_gloss_classes(replace(scene, mobiles=(*scene.mobiles[:-1], mobile)))
    mobile = scene.mobiles[-1]._replace(mesh=without_holes(scene.mobiles[-1].mesh))
    scene = translated(replace(scene, mobiles=(*scene.mobiles[:-1], mobile)), origin)
    if pose is None:
        return scene
    return replace(scene, mobiles=(*scene.mobiles[:-1], scene.mobiles[-1]._replace(pose=_pose(scene, name, pose))))


def piece_at(mesh: Mesh, point) -> np.ndarray:
    """Return which faces (F,) bool hang together with the face nearest to a point (3,) [m]: they share corners."""
    near = int(_distances(np.asarray(point, np.float64), mesh.vertices[mesh.faces]).argmin())
    _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = same.reshape(-1)[mesh.faces]
    label = components(np.concatenate([faces[:, :2], faces[:, 1:]]), int(faces.max()) + 1)[faces[:, 0]]
    return label == label[near]


def _distances(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the squared distances (F,) [m2] of a point (3,) from triangles (F, 3, 3)."""
    normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inside, best = np.ones(len(corners), bool), np.full(len(corners), np.inf)
    for k in range(3):
        edge, way = corners[:, (k + 1) % 3] - corners[:, k], point - corners[:, k]
        inside &= dot(cross(edge, way), normal) >= 0
        along = np.clip(dot(way, edge) / np.maximum(dot(edge, edge), 1e-300), 0, 1)
        off = way - along[:, None] * edge
        best = np.minimum(best, dot(off, off))
    height = dot(point - corners[:, 0], normal) ** 2 / np.maximum(dot(normal, normal), 1e-300)
    return np.where(inside, height, best)


def _promoted(scene: Scene, name: str, point) -> Scene:
    rows = piece_at(scene.static, point)
    where = f"{scene.name}: mobile {shown(name)}"
    if rows.all():
        raise SceneError(f"{where}: the whole static part hangs together there; nothing of it can become a mobile")
    for k in np.unique(scene.static.face_material[rows]):
        if max(scene.materials[k].emission) > 0:
            raise SceneError(
                f'{where}: its material "{scene.materials[k].name}" emits light, and lamps must stand still'
            )
    mesh = part_of(scene.static, rows)
    centre = bottom_centre(mesh.vertices, np.array(scene.up, np.float64))
    mobile = Mobile(name, mesh._replace(vertices=mesh.vertices - centre), Pose(tuple(float(c) for c in centre)))
    return replace(scene, static=part_of(scene.static, ~rows), mobiles=(*scene.mobiles, mobile))


def part_of(mesh: Mesh, rows: np.ndarray) -> Mesh:
    """Return the mesh of some of the faces, rows (F,) bool, and of their vertices alone."""
    paint = mesh.paint
    if paint is not None:
        paint = paint._replace(
            face_texture=paint.face_texture[rows], corner_uv=paint.corner_uv[rows],
            corner_colour=paint.corner_colour[rows],
        )  # fmt: skip
    normals, colours = mesh.corner_normals, mesh.face_reflectance
    return compact(
        Mesh(
            mesh.vertices,
            mesh.faces[rows],
            mesh.face_material[rows],
            None if normals is None else normals[rows],
            None if colours is None else colours[rows],
            paint,
        )
    )


def _frozen(scene: Scene, mobile: Mobile, pose: Pose) -> Scene:
    mesh = mobile.mesh
    mesh = mesh._replace(vertices=to_world(pose, mesh.vertices))
    if mesh.corner_normals is not None:
        normals = to_world_directions(pose, mesh.corner_normals.reshape(-1, 3)).reshape(-1, 3, 3)
        mesh = mesh._replace(corner_normals=normals)
    return replace(_without(scene, mobile), static=join([scene.static, mesh], scene.materials))

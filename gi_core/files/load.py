"""load_scene: a scene file or a single mesh file, with mobiles from other files, becomes a complete Scene."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gi_core.bsdf.tabulate import tabulate
from gi_core.files.completion import complete
from gi_core.files.completion.crossings import with_corners_at_crossings
from gi_core.files.completion.pilot import Box, Rays, useful_box
from gi_core.files.completion.refinement import COARSEST, refined
from gi_core.files.completion.sides import facing_the_scene, one_sided_where_dark
from gi_core.files.find import find_scene
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.classes import with_gloss_classes
from gi_core.files.formats.materials_table import check_used, override, single
from gi_core.files.formats.mesh_file import SUFFIXES, MeshFile, read_mesh_file, scaled
from gi_core.files.formats.shapes import Shape, shape_mesh
from gi_core.files.formats.toml_file import UP, MobileEntry, SceneFile, StaticEntry, read_scene_file, up_of
from gi_core.geometry.mesh_parts import join, with_meshes
from gi_core.geometry.surfaces import tables_of
from gi_core.geometry.tessellation import check_edge, tessellate
from gi_core.lights.daylight import daylit
from gi_core.scene.errors import SceneError, named, shown, utf8
from gi_core.scene.origin import origin_of, translated
from gi_core.scene.pose import as_pose
from gi_core.scene.rules import FILE, FLAG, LENGTH
from gi_core.scene.types import Material, Mesh, Mobile, Pose, Scene
from gi_core.scene.validate import check_lamp, check_scene, check_size, check_surface

GLTF = ".glb", ".gltf"
MOST_RECEIVERS = 150_000  # a bare mesh is refined to about as many, both sides counted, unless it is fine enough before


def load_scene(
    path: str | Path,
    *,
    mobiles: Sequence[str | Path] = (),
    max_edge: float | None = None,
    up=None,
    allow_outside: bool = False,
) -> Scene:
    """Load a scene file (TOML), a mesh file (.glb .gltf .obj .ply .stl), or a shipped scene by name.

    mobiles: mesh files added as mobiles, resting on the floor; max_edge [m]: the longest edge of the
    static part, instead of the scene file's or, for a bare mesh, of the one that MOST_RECEIVERS allows;
    up: "x", "y", "z" or three numbers, instead of the up axis of the file;
    allow_outside: files that the scene names may lie outside its folder.

    Raises SceneError with one sentence: file, rule, value found, value to write instead.
    """
    for name in (path, *(mobiles if isinstance(mobiles, list | tuple) else (mobiles,))):
        FILE.check("a scene or a mobile", name)
    FLAG.check("allow_outside", allow_outside)
    file = find_scene(path)
    where = str(path) if os.path.isfile(path) else f"scenes/{file.name}"
    if max_edge is not None and not (isinstance(max_edge, Real) and max_edge == np.inf):  # inf: as it is
        max_edge = LENGTH.check(f"{where}: max_edge", max_edge)
    suffix = file.suffix.lower()
    boundary = Boundary(file.parent, allow_outside, file)
    if suffix == ".toml":
        described = read_scene_file(file, where, boundary)
    elif suffix in SUFFIXES:
        entry = StaticEntry([file], 1.0, None, [])
        described = SceneFile(entry, [], {}, {}, None, {"name": utf8(file.stem)})
    else:
        raise SceneError(
            f"{where}: a scene is a .toml file or one of {' '.join(SUFFIXES)}, got {suffix or 'no suffix'}"
        )
    loading = Loading(described, boundary, where, suffix != ".toml", max_edge)
    try:
        with named(where, *map(str, mobiles)):
            scene = _described(loading, up_of(up, where))
            scene = _completed(loading, scene, [Path(mobile) for mobile in mobiles])
            check_scene(scene)
            for name, _ in scene.watts:
                check_lamp(f"{where}: [watts]", name, scene)
            for surface in scene.surfaces:
                check_surface(where, surface, scene)
            return replace(scene, files=(tuple(boundary.files), *scene.files))
    except MemoryError:
        raise SceneError(f"{where}: the scene does not fit into memory; simplify its meshes") from None


class Loading(NamedTuple):
    """A file that is loaded."""

    file: SceneFile
    boundary: Boundary
    where: str
    bare: bool  # a mesh file without a scene file
    max_edge: float | None  # [m], before that of the file; inf: as it is

    def split(self, mesh: Mesh, max_edge: float, where: str) -> Mesh:
        """Return a mesh with edges up to max_edge [m]. Raises SceneError for too many triangles."""
        with named(where):
            finer = tessellate(mesh, max_edge)
        self.boundary.take(where, "triangles", max(len(finer.faces) - len(mesh.faces), 0))
        return finer


# What the file describes ----------------------------------------------------------------------------


def _described(loading: Loading, up) -> Scene:
    """Return the scene that a file describes, of its meshes as they are."""
    file, where, materials = loading.file, loading.where, list[Material]()
    cache = dict[str, MeshFile]()  # by absolute path
    notes = [note for photometry in file.photometry.values() for note in photometry.notes]
    names = [where if loading.bare else f"{where}: {path.name}" for path in file.static.meshes]
    parts = [_read(loading, cache, *named) for named in zip(file.static.meshes, names, strict=True)]
    parts = [scaled(part, file.static.scale) for part in parts]
    for shape in file.static.shapes:
        edge = loading.max_edge or shape.max_edge or file.static.max_edge or np.inf
        parts.append(_made(shape, edge, loading.file.materials, loading.boundary))
    meshes = []
    for part in parts:
        meshes.append(_adopted(*override(part.mesh, part.materials, file.materials), materials))
        notes += part.notes
    static = join(meshes, materials)
    check_size(f"{where}: a scene", static)
    punctual = any(part.lights for part in parts)  # glTF lights are photometric, and so is its emission
    glows = any(any(m.emission) for m in parts[0].materials)
    nits = loading.bare and glows and file.static.meshes[0].suffix.lower() in GLTF
    scene = Scene(static, tuple(materials), notes=tuple(notes), **file.scene)
    scene = replace(
        scene,
        lights=(*scene.lights, *(light for part in parts for light in part.lights)),
        camera=scene.camera or next((part.camera for part in parts if part.camera), None),
        up=up or file.scene.get("up") or UP[parts[0].up],
        units="photometric" if punctual or nits else scene.units,
    )
    for entry in file.mobiles:
        scene = _with_entry(loading, cache, entry, scene)
    check_used(file.materials, {m.name for m in scene.materials})
    tables_of(replace(scene, name=where))
    return daylit(scene, file.daylight, where) if file.daylight else scene


def _read(loading: Loading, cache: dict[str, MeshFile], path: Path, where: str) -> MeshFile:
    """Return a mesh file that a scene file names, read once."""
    real = os.path.abspath(path)
    if real in cache:
        loading.boundary.take(where, "triangles", len(cache[real].mesh.faces))
    else:
        cache[real] = read_mesh_file(path, where, loading.boundary)
    return cache[real]


def _made(shape: Shape, max_edge: float | None, tabled: Collection[str], boundary: Boundary) -> MeshFile:
    """Return a shape as if a file held it, with edges up to max_edge [m]; None: those of a mobile.

    tabled: names of [materials.NAME].
    """
    mesh, materials = shape_mesh(shape, np.inf, tabled)
    max_edge = max_edge or _fine_edge(mesh)
    if np.isfinite(max_edge):
        with named(shape.where):
            check_edge(mesh, max_edge)
            mesh = tessellate(shape_mesh(shape, max_edge, tabled)[0], max_edge)
    boundary.take(shape.where, "triangles", len(mesh.faces))
    return MeshFile(mesh, materials, [], None, "y", [])


def _with_entry(loading: Loading, cache: dict[str, MeshFile], entry: MobileEntry, scene: Scene) -> Scene:
    """Return a scene with a mobile of its file."""
    tables = loading.file.materials
    if isinstance(entry.mesh, Shape):
        r = _made(entry.mesh, entry.max_edge, tables, loading.boundary)
    else:
        r = _read(loading, cache, entry.mesh, f"{entry.where}: {entry.mesh.name}")
    if entry.material is None:
        mesh, own = override(r.mesh, r.materials, tables)
    else:
        mesh, own = single(r.mesh, entry.material, r.materials, tables, entry.where)
    mesh = mesh._replace(vertices=mesh.vertices * entry.scale)
    scene = _with_mobile(scene, entry.name, r._replace(mesh=mesh, materials=own), entry.where)
    *before, mobile = scene.mobiles
    if entry.max_edge is not None:
        mobile = mobile._replace(mesh=loading.split(mobile.mesh, entry.max_edge, entry.where))
    mobile = mobile._replace(pose=entry.pose or Pose(), path=entry.path)
    return replace(scene, mobiles=(*before, mobile))


def _adopted(mesh: Mesh, own: list[Material], materials: list[Material]) -> Mesh:
    """Return a mesh whose faces index `materials`, to which its own are appended."""
    mesh = mesh._replace(face_material=(mesh.face_material + len(materials)).astype(np.int32))
    materials += own
    return mesh


def _check_dark(mesh: Mesh, materials: list[Material], where: str) -> None:
    for i in np.unique(mesh.face_material):
        if any(materials[i].emission):
            raise SceneError(
                f'{where}: a mobile cannot emit light, its material "{materials[i].name}" has emission '
                f"{list(materials[i].emission)}; give it emission = [0, 0, 0] under [materials] of a scene file"
            )


# What it leaves open --------------------------------------------------------------------------------


def _completed(loading: Loading, scene: Scene, added: list[Path]) -> Scene:
    """Return the scene with all that its file leaves open, and with mesh files added as mobiles."""
    origin, described = origin_of(scene.static), len(scene.mobiles)
    scene = translated(scene, -origin)  # rays of completion are float32
    unplaced: list[tuple[int, Any]] = [(i, None) for i, entry in enumerate(loading.file.mobiles) if entry.pose is None]
    for path in added:
        scene, up = _with_source(scene, path, None, loading.boundary.open)
        unplaced.append((len(scene.mobiles) - 1, up))
    scene, rays = facing_the_scene(scene)
    scene, rays, box = complete(scene, unplaced, loading.bare, rays)
    finer = (m._replace(mesh=_fine(m.mesh)) for m in scene.mobiles[described:])
    scene = replace(scene, mobiles=(*scene.mobiles[:described], *finer))
    if loading.bare:
        scene = one_sided_where_dark(scene, box)
    scene = with_gloss_classes(_split_static(loading, scene, rays, box))
    scene = replace(scene, notes=(*scene.notes, *_darkened(scene.materials)))
    scene = with_meshes(scene, lambda mesh: with_corners_at_crossings(mesh, scene.materials))
    return translated(scene, origin)


def _split_static(loading: Loading, scene: Scene, rays: Rays | None, box: Box | None) -> Scene:
    """Edges as the file or the user says, else, of a bare mesh or a coarse one, finest where light goes."""
    max_edge = loading.max_edge or loading.file.static.max_edge
    if max_edge == np.inf or (max_edge is None and any(shape.max_edge for shape in loading.file.static.shapes)):
        return scene
    if max_edge is not None:
        return replace(scene, static=loading.split(scene.static, max_edge, loading.where))
    rays = rays or Rays(scene)
    box = box if loading.bare else useful_box(scene, rays)
    if not (loading.bare or _is_coarse(scene, box)):
        return scene
    mesh, edge = refined(scene, rays, box, MOST_RECEIVERS)
    before, after = len(scene.static.faces), len(mesh.faces)
    if after <= before:
        return scene
    note = f"mesh refined for light, edges up to {edge:.3g} m (max_edge): {before:,} triangles became {after:,}"
    return replace(scene, static=mesh, notes=(*scene.notes, note))


def _is_coarse(scene: Scene, box: Box) -> bool:
    """Return whether triangles too long to show shadows get most of the light, lamps aside."""
    glows = np.array([any(m.emission) for m in scene.materials])
    lit = ~glows[scene.static.face_material] & box.side_hits.any(axis=1)  # no faces far outside
    hits, corners = box.side_hits[lit].sum(axis=1), scene.static.vertices[scene.static.faces[lit]]
    longest = np.sqrt(((corners - corners[:, [1, 2, 0]]) ** 2).sum(axis=2).max(axis=1))
    return 2 * hits[longest > COARSEST * box.size].sum() > hits.sum()


def _darkened(materials: Iterable[Material]) -> list[str]:
    """Return a note per material whose model is darkened, as it would reflect more light than arrives."""
    limited = {}
    for m in materials:
        if m.scaled and m.brdf:
            with suppress(ValueError):  # refused with the surfaces
                limited[m.name] = tabulate(m.brdf, True).limited
    return [f'material "{name}": {where}: darkened there' for name, where in limited.items() if where]


def _fine(mesh: Mesh) -> Mesh:
    """Return the mesh of a mobile with flat sides split, since light at their corners alone shows no shading."""
    return tessellate(mesh, _fine_edge(mesh))


def _fine_edge(mesh: Mesh) -> float:
    return COARSEST * float(np.ptp(mesh.vertices, axis=0).max())


def _with_source(scene: Scene, source: Path | Shape, name: str | None, allow_outside: bool):
    """Return a scene with one more mobile, not yet placed, and the up axis of its mesh file; None: of a shape.

    name: None: that of the file, with a number if it is taken. Raises SceneError.
    """
    if isinstance(source, Shape):
        boundary, where = Boundary(Path()), source.where
        r = _made(source, source.max_edge, (), boundary)
    else:
        boundary, where = Boundary(source.parent, allow_outside, source), str(source)
        r = read_mesh_file(source, where, boundary)
    scene = _with_mobile(scene, free_name((m.name for m in scene.mobiles), name or Path(where).stem), r, where)
    scene = replace(scene, files=(*scene.files, *([tuple(boundary.files)] if boundary.files else [])))
    return scene, None if isinstance(source, Shape) else UP[r.up]


def _with_mobile(scene: Scene, name: str, read: MeshFile, where: str) -> Scene:
    """Return a scene with one more mobile, not yet placed, and its materials and notes. Raises SceneError."""
    check_size(f"{where}: a mobile", read.mesh)
    _check_dark(read.mesh, read.materials, where)
    materials = list(scene.materials)
    mobile = Mobile(name, _adopted(read.mesh, read.materials, materials))
    notes = (*scene.notes, *(f'mobile "{name}": {n}' for n in read.notes))
    return replace(scene, materials=tuple(materials), mobiles=(*scene.mobiles, mobile), notes=notes)


def inserted(scene: Scene, source: Path | Shape, name: str, pose: Pose | None, allow_outside: bool) -> Scene:
    """Return a loaded scene with one more mobile, by the same steps; pose: None: on a free floor.

    Raises SceneError.
    """
    origin = origin_of(scene.static)
    scene, up = _with_source(translated(scene, -origin), source, name, allow_outside)
    scene, *_ = complete(scene, [(len(scene.mobiles) - 1, up)], bare=False)
    *before, mobile = scene.mobiles
    scene = with_gloss_classes(replace(scene, mobiles=(*before, mobile._replace(mesh=_fine(mobile.mesh)))))
    *before, mobile = scene.mobiles
    mesh = with_corners_at_crossings(mobile.mesh, scene.materials)
    scene = translated(replace(scene, mobiles=(*before, mobile._replace(mesh=mesh))), origin)
    if pose is None:
        return scene
    *before, mobile = scene.mobiles
    mobile = mobile._replace(pose=as_pose(pose, f"{scene.name}: mobile {shown(name)}"))
    return replace(scene, mobiles=(*before, mobile))


def free_name(names: Iterable[str], name: str) -> str:
    """Return the name of a new mobile: the given one, with a number if it is among `names`."""
    name = utf8(name)
    names, k, out = set(names), 2, name
    while out in names:
        out, k = f"{name} {k}", k + 1
    return out

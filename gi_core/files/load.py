"""load_scene: a scene file or a single mesh file, with mobiles from other files, becomes a complete Scene by STEPS."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import Any

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
from gi_core.files.formats.toml_file import UP, MobileEntry, SceneFile, StaticEntry, read_scene_file
from gi_core.geometry.mesh_parts import join, with_meshes
from gi_core.geometry.tessellation import check_edge, tessellate
from gi_core.lights.daylight import daylit
from gi_core.scene.errors import SceneError, named, shown, utf8
from gi_core.scene.origin import origin_of, translated
from gi_core.scene.pose import as_pose
from gi_core.scene.rules import FILE, FLAG, LENGTH, is_direction
from gi_core.scene.types import Defaults, Material, Mesh, Mobile, Pose, Scene
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
        described = SceneFile(utf8(file.stem), None, "radiometric", entry, [], [], {}, None, [], Defaults(), [], {})
    else:
        raise SceneError(
            f"{where}: a scene is a .toml file or one of {' '.join(SUFFIXES)}, got {suffix or 'no suffix'}"
        )
    loading = Loading(described, boundary, where, suffix != ".toml", tuple(map(Path, mobiles)), max_edge)
    try:
        with named(where, *map(str, mobiles)):
            loading.scene = _described(loading, utf8(file.stem), _checked_up(up, where))
            for step in STEPS:
                step(loading)
            check_scene(loading.scene)
            for name, _ in loading.scene.watts:
                check_lamp(f"{where}: [watts]", name, loading.scene)
            for surface in loading.scene.surfaces:
                check_surface(where, surface, loading.scene)
            return replace(loading.scene, files=(tuple(boundary.files), *loading.scene.files))
    except MemoryError:
        raise SceneError(f"{where}: the scene does not fit into memory; simplify its meshes") from None


@dataclass
class Loading:
    """A scene between the steps of loading."""

    file: SceneFile
    boundary: Boundary
    where: str
    bare: bool  # a mesh file without a scene file
    mobiles: tuple[Path, ...]  # added to those of the file
    max_edge: float | None  # [m], before that of the file; inf: as it is
    scene: Scene = field(init=False)
    unplaced: list[tuple[int, Any]] = field(default_factory=list)  # mobiles, and the up axes of their files or None
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))  # of the coordinates that steps use
    rays: Rays | None = None
    box: Box | None = None  # of the lit part

    def change(self, **values: Any) -> None:
        """Replace fields of the scene."""
        self.scene = replace(self.scene, **values)

    def note(self, *notes: str) -> None:
        """Add notes for the reader."""
        self.change(notes=(*self.scene.notes, *notes))

    def change_meshes(self, changed: Callable[[Mesh], Mesh]) -> None:
        """Replace the mesh of each object."""
        self.scene = with_meshes(self.scene, changed)

    def split(self, mesh: Mesh, max_edge: float, where: str) -> Mesh:
        """Return a mesh with edges up to max_edge [m]. Raises SceneError for too many triangles."""
        with named(where):
            finer = tessellate(mesh, max_edge)
        self.boundary.take(where, "triangles", max(len(finer.faces) - len(mesh.faces), 0))
        return finer


# What the file describes ----------------------------------------------------------------------------


def _described(loading: Loading, stem: str, up) -> Scene:
    """Return the scene that a file describes, of its meshes as they are."""
    file, where, materials = loading.file, loading.where, list[Material]()
    cache = dict[str, MeshFile]()  # by real path
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
    mobiles = [_mobile(loading, cache, entry, materials, notes) for entry in file.mobiles]
    loading.unplaced = [(i, None) for i, entry in enumerate(file.mobiles) if entry.pose is None]
    check_used(file.materials, {m.name for m in materials})
    _check_models(materials, where)
    punctual = any(part.lights for part in parts)  # glTF lights are photometric, and so is its emission
    glows = any(any(m.emission) for m in parts[0].materials)
    nits = loading.bare and glows and file.static.meshes[0].suffix.lower() in GLTF
    scene = Scene(
        static,
        tuple(materials),
        tuple(mobiles),
        (*file.lights, *(light for part in parts for light in part.lights)),
        tuple(file.probes),
        file.camera or next((part.camera for part in parts if part.camera), None),
        up or file.up or UP[parts[0].up],
        "photometric" if punctual or nits else file.units,
        stem if loading.bare else file.title,
        file.defaults,
        tuple(notes),
        tuple(file.light_scenes),
        surfaces=file.surfaces,
        watts=file.watts,
        maintenance_factor=file.maintenance_factor,
        hold=file.hold,
    )
    return daylit(scene, file.daylight, where) if file.daylight else scene


def _read(loading: Loading, cache: dict[str, MeshFile], path: Path, where: str) -> MeshFile:
    """Return a mesh file that a scene file names, read once."""
    if not loading.boundary.holds(path):
        raise SceneError(f"{where}: lies outside the folder of the scene; move it there, or give --allow-outside")
    real = os.path.realpath(path)
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


def _mobile(loading: Loading, cache, entry: MobileEntry, materials: list[Material], notes: list[str]) -> Mobile:
    """Return a mobile of a scene file; its materials and notes are appended."""
    tables = loading.file.materials
    if isinstance(entry.mesh, Shape):
        r = _made(entry.mesh, entry.max_edge, tables, loading.boundary)
    else:
        r = _read(loading, cache, entry.mesh, f"{entry.where}: {entry.mesh.name}")
    mesh, own = override(r.mesh, r.materials, tables)
    if entry.material is not None:
        mesh, own = single(mesh, entry.material, r.materials, tables, entry.where)
    mesh = mesh._replace(vertices=mesh.vertices * entry.scale)
    check_size(f"{entry.where}: a mobile", mesh)
    _check_dark(mesh, own, entry.where)
    mesh = _adopted(mesh, own, materials)
    if entry.max_edge is not None:
        mesh = loading.split(mesh, entry.max_edge, entry.where)
    notes += [f'mobile "{entry.name}": {n}' for n in r.notes]
    return Mobile(entry.name, mesh, entry.pose or Pose(), entry.path)


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


def _check_models(materials: Iterable[Material], where: str) -> None:
    """Raise SceneError for a material whose model would reflect more light than arrives."""
    for m in materials:
        if m.brdf:
            try:
                tabulate(m.brdf, m.scaled)
            except ValueError as error:
                raise SceneError(f'{where}: material "{m.name}": {error}') from None


# Steps ----------------------------------------------------------------------------------------------


def _go_near_the_origin(loading: Loading) -> None:
    """Rays of completion are float32."""
    loading.origin = origin_of(loading.scene.static)
    loading.scene = translated(loading.scene, -loading.origin)


def _add_mobiles(loading: Loading) -> None:
    for path in loading.mobiles:
        loading.scene, up = _with_mobile(loading.scene, path, None, loading.boundary.open)
        loading.unplaced.append((len(loading.scene.mobiles) - 1, up))


def _turn_lamps(loading: Loading) -> None:
    loading.scene, loading.rays = facing_the_scene(loading.scene)


def _complete(loading: Loading) -> None:
    loading.scene, loading.rays, loading.box = complete(loading.scene, loading.unplaced, loading.bare, loading.rays)


def _split_added_mobiles(loading: Loading) -> None:
    first = len(loading.file.mobiles)
    finer = (m._replace(mesh=_fine(m.mesh)) for m in loading.scene.mobiles[first:])
    loading.change(mobiles=(*loading.scene.mobiles[:first], *finer))


def _leave_out_dark_sides(loading: Loading) -> None:
    if loading.bare:
        loading.scene = one_sided_where_dark(loading.scene, loading.box)


def _split_static(loading: Loading) -> None:
    """Edges as the file or the user says, else, of a bare mesh or a coarse one, finest where light goes."""
    scene, max_edge = loading.scene, loading.max_edge or loading.file.static.max_edge
    if max_edge is not None:
        if max_edge != np.inf:
            loading.change(static=loading.split(scene.static, max_edge, loading.where))
        return
    if any(shape.max_edge for shape in loading.file.static.shapes):
        return
    rays = loading.rays or Rays(scene)
    box = loading.box if loading.bare else useful_box(scene, rays)
    if loading.bare or _is_coarse(scene, box):
        mesh, edge = refined(scene, rays, box, MOST_RECEIVERS)
        before, after = len(scene.static.faces), len(mesh.faces)
        if after > before:
            loading.change(static=mesh)
            loading.note(
                f"mesh refined for light, edges up to {edge:.3g} m (max_edge): {before:,} triangles became {after:,}"
            )


def _classify_gloss(loading: Loading) -> None:
    loading.scene = with_gloss_classes(loading.scene)


def _note_darkened_models(loading: Loading) -> None:
    loading.note(*_darkened(loading.scene.materials))


def _cut_at_crossings(loading: Loading) -> None:
    loading.change_meshes(lambda mesh: with_corners_at_crossings(mesh, loading.scene.materials))


def _go_back(loading: Loading) -> None:
    loading.scene = translated(loading.scene, loading.origin)


STEPS: tuple[Callable[[Loading], None], ...] = (
    _go_near_the_origin,
    _add_mobiles,
    _turn_lamps,
    _complete,  # places of mobiles, a light, a camera
    _split_added_mobiles,
    _leave_out_dark_sides,
    _split_static,
    _classify_gloss,
    _note_darkened_models,
    _cut_at_crossings,
    _go_back,
)


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


def _with_mobile(scene: Scene, source: Path | Shape, name: str | None, allow_outside: bool):
    """Return a scene with one more mobile, not yet placed, and the up axis of its mesh file; None: of a shape.

    name: None: that of the file, with a number if it is taken. Raises SceneError.
    """
    if isinstance(source, Shape):
        boundary, where = Boundary(Path()), source.where
        r = _made(source, source.max_edge, (), boundary)
    else:
        boundary, where = Boundary(source.parent, allow_outside, source), str(source)
        r = read_mesh_file(source, where, boundary)
    name = free_name((m.name for m in scene.mobiles), name or Path(where).stem)
    check_size(f"{where}: a mobile", r.mesh)
    _check_dark(r.mesh, r.materials, where)
    mesh = r.mesh._replace(face_material=(r.mesh.face_material + len(scene.materials)).astype(np.int32))
    scene = replace(
        scene,
        materials=(*scene.materials, *r.materials),
        mobiles=(*scene.mobiles, Mobile(name, mesh)),
        notes=(*scene.notes, *(f'mobile "{name}": {n}' for n in r.notes)),
        files=(*scene.files, *([tuple(boundary.files)] if boundary.files else [])),
    )
    return scene, None if isinstance(source, Shape) else UP[r.up]


def inserted(scene: Scene, source: Path | Shape, name: str, pose: Pose | None, allow_outside: bool) -> Scene:
    """Return a loaded scene with one more mobile, by the same steps; pose: None: on a free floor.

    Raises SceneError.
    """
    origin = origin_of(scene.static)
    scene, up = _with_mobile(translated(scene, -origin), source, name, allow_outside)
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


def _checked_up(up, where: str):
    if up is None:
        return None
    if isinstance(up, str):
        if up not in UP:
            raise SceneError(f'{where}: up must be "x", "y", "z" or three numbers, got {up!r}')
        return UP[up]
    if not is_direction(up):
        raise SceneError(f'{where}: up must be "x", "y", "z" or three numbers that are not all 0, got {shown(up)}')
    v = np.asarray(up, np.float64)
    return tuple(float(x) for x in v / np.sqrt((v * v).sum()))

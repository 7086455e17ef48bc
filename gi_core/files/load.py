"""load_scene: a scene file or a single mesh file, with mobiles from other files, becomes a complete Scene."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from numbers import Real
from pathlib import Path

import numpy as np

from gi_core.bsdf.tabulate import tabulate
from gi_core.files.completion.completion import complete
from gi_core.files.completion.crossings import with_corners_at_crossings
from gi_core.files.completion.dark_sides import one_sided_where_dark
from gi_core.files.completion.lamp_orientation import facing_the_scene
from gi_core.files.completion.refinement import COARSEST, FINEST, refined
from gi_core.files.find import find_scene
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.materials_table import check_used, override, single
from gi_core.files.formats.mesh_file import SUFFIXES, MeshFile, read_mesh_file
from gi_core.files.formats.toml_file import UP, SceneFile, StaticEntry, read_scene_file
from gi_core.files.gloss_classes import with_gloss_classes
from gi_core.files.scaling import scaled
from gi_core.geometry.cutouts import without_holes
from gi_core.geometry.paint import join_finishes, join_paints
from gi_core.geometry.tessellation import tessellate
from gi_core.scene.errors import SceneError, named, shown
from gi_core.scene.origin import origin_of, translated
from gi_core.scene.rules import FILE, FLAG, LENGTH, is_direction
from gi_core.scene.types import Defaults, Material, Mesh, Mobile, Scene
from gi_core.scene.validate import check_scene, check_size

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
    boundary = Boundary(file.parent, allow_outside)
    if suffix == ".toml":
        described = read_scene_file(file, where, boundary)
    elif suffix in SUFFIXES:
        entry = StaticEntry([file], 1.0, None)
        described = SceneFile(file.stem, None, "radiometric", entry, [], [], {}, None, [], Defaults(), [], {})
    else:
        raise SceneError(
            f"{where}: a scene is a .toml file or one of {' '.join(SUFFIXES)}, got {suffix or 'no suffix'}"
        )
    up = _checked_up(up, where)
    builder = _Builder(described, where, file.stem, up, suffix != ".toml", boundary)
    try:
        with named(where, *map(str, mobiles)):
            scene = builder.build(mobiles, max_edge)
            check_scene(scene)
            return replace(scene, files=(tuple(boundary.files), *scene.files))
    except MemoryError:
        raise SceneError(f"{where}: the scene does not fit into memory; simplify its meshes") from None


class _Builder:
    """Collects materials while the meshes of one scene are read."""

    def __init__(self, described: SceneFile, where: str, name: str, up, bare: bool, boundary: Boundary):
        self.file, self.where, self.name, self.up, self.bare = described, where, name, up or described.up, bare
        self.boundary = boundary
        self.read: dict[str, MeshFile] = {}  # by real path
        self.materials: list[Material] = []
        self.notes: list[str] = [note for file in described.photometry.values() for note in file.notes]

    def build(self, extra: Sequence[str | Path], max_edge: float | None) -> Scene:
        scale = self.file.static.scale
        read = [scaled(self._read(p, self._shown(p)), scale) for p in self.file.static.meshes]
        self.up = self.up or UP[read[0].up]
        static = self._static(read)
        check_size(f"{self.where}: a scene", static)
        lights = [*self.file.lights, *(light for r in read for light in r.lights)]
        punctual = any(r.lights for r in read)  # glTF lights are photometric, and so is its emission
        nits = (
            self.bare
            and self.file.static.meshes[0].suffix.lower() in GLTF
            and any(any(m.emission) for m in read[0].materials)
        )
        camera = self.file.camera or next((r.camera for r in read if r.camera), None)
        mobiles = [self._described(m) for m in self.file.mobiles]
        check_used(self.file.materials, {m.name for m in self.materials})
        _check_models(self.materials, self.where)
        scene = Scene(
            static,
            tuple(self.materials),
            tuple(mobiles),
            tuple(lights),
            tuple(self.file.probes),
            camera,
            self.up,
            "photometric" if punctual or nits else self.file.units,
            self.file.title if not self.bare else self.name,
            self.file.defaults,
            tuple(self.notes),
            tuple(self.file.light_scenes),
        )
        # Completion casts float32 rays: it works near the origin.
        origin = origin_of(static)
        scene = translated(scene, -origin)
        unplaced: list[tuple[int, tuple | None]] = [
            (i, None) for i, m in enumerate(self.file.mobiles) if m.pose is None
        ]
        for path in extra:
            scene, up = with_mobile_file(scene, Path(path), None, self.boundary.open)
            unplaced.append((len(scene.mobiles) - 1, up))
        scene, rays = facing_the_scene(scene)
        scene, rays, box = complete(scene, unplaced, self.bare, rays)
        described = len(self.file.mobiles)
        finer = tuple(finished(m) for m in scene.mobiles[described:])
        scene = replace(scene, mobiles=(*scene.mobiles[:described], *finer))
        scene = with_gloss_classes(self._refined(scene, max_edge, rays, box))
        scene = replace(scene, notes=(*scene.notes, *_darkened(scene.materials)))
        cut = tuple(m._replace(mesh=cut_for_light(m.mesh, scene.materials)) for m in scene.mobiles)
        static = cut_for_light(scene.static, scene.materials)
        return translated(replace(scene, static=static, mobiles=cut), origin)

    def _shown(self, path: Path) -> str:
        return self.where if self.bare else f"{self.where}: {path.name}"

    def _read(self, path: Path, where: str) -> MeshFile:
        """Read a mesh file that the scene file names."""
        if not self.boundary.holds(path):
            raise SceneError(f"{where}: lies outside the folder of the scene; move it there, or give --allow-outside")
        real = os.path.realpath(path)
        if real in self.read:
            self.boundary.take(where, "triangles", len(self.read[real].mesh.faces))
        else:
            self.read[real] = read_mesh_file(path, where, self.boundary)
        return self.read[real]

    def _static(self, read: list[MeshFile]) -> Mesh:
        meshes = []
        for r in read:
            mesh, materials = override(r.mesh, r.materials, self.file.materials)
            meshes.append(self._adopt(mesh, materials))
            self.notes += r.notes
        return join(meshes, self.materials)

    def _described(self, entry) -> Mobile:
        r = self._read(entry.mesh, f"{entry.where}: {entry.mesh.name}")
        mesh, materials = override(r.mesh, r.materials, self.file.materials)
        if entry.material is not None:
            mesh, materials = single(mesh, entry.material, r.materials, self.file.materials, entry.where)
        mesh = mesh._replace(vertices=mesh.vertices * entry.scale)
        check_size(f"{entry.where}: a mobile", mesh)
        _check_dark(mesh, materials, entry.where)
        mesh = self._adopt(mesh, materials)
        if entry.max_edge is not None:
            mesh = self._cut(mesh, entry.max_edge, entry.where)
        self.notes += [f'mobile "{entry.name}": {n}' for n in r.notes]
        mobile = Mobile(entry.name, mesh, path=entry.path)
        return mobile._replace(pose=entry.pose) if entry.pose is not None else mobile

    def _adopt(self, mesh: Mesh, materials: list[Material]) -> Mesh:
        """Append a mesh's materials to the scene's, and number its faces' materials accordingly."""
        mesh = mesh._replace(face_material=(mesh.face_material + len(self.materials)).astype(np.int32))
        self.materials += materials
        return mesh

    def _cut(self, mesh: Mesh, max_edge: float, where: str) -> Mesh:
        with named(where):
            cut = tessellate(mesh, max_edge)
        self.boundary.take(where, "triangles", max(len(cut.faces) - len(mesh.faces), 0))
        return cut

    def _refined(self, scene: Scene, max_edge: float | None, rays, box) -> Scene:
        if self.bare:
            scene = one_sided_where_dark(scene, box)
        wanted = max_edge or self.file.static.max_edge
        if wanted is not None:
            return scene if wanted == np.inf else replace(scene, static=self._cut(scene.static, wanted, self.where))
        if not self.bare:
            return _with_note_on_edges(scene)
        before = len(scene.static.faces)
        mesh, edge = refined(scene, rays, box, MOST_RECEIVERS)
        if len(mesh.faces) == before:
            return scene
        note = f"edges split to {edge:.3g} m where light goes: {before:,} triangles became {len(mesh.faces):,}"
        return replace(scene, static=mesh, notes=(*scene.notes, note))


def _with_note_on_edges(scene: Scene) -> Scene:
    """Return the scene, with a note if triangles too long to show shadows are most of its area, lamps aside."""
    glows = np.array([any(m.emission) for m in scene.materials])
    corners = scene.static.vertices[scene.static.faces[~glows[scene.static.face_material]]]
    a, b, c = (corners[:, k] for k in range(3))
    longest = np.sqrt(np.max([((v - w) ** 2).sum(axis=1) for v, w in ((a, b), (b, c), (c, a))], axis=0))
    area, size = np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=1)), float(np.ptp(scene.static.vertices, axis=0).max())
    if not area[longest > COARSEST * size].sum() > 0.5 * area.sum():
        return scene
    wanted = f"{1.5 * FINEST * size:.1g}"
    note = (
        f"edges up to {longest.max():.3g} m stay as they are, and light is interpolated along them: no shadow shows "
        f"on a large triangle; add max_edge = {wanted} under [static], or --max-edge {wanted}, to split them"
    )
    return replace(scene, notes=(*scene.notes, note))


def with_mobile_file(scene: Scene, path: Path, name: str | None, allow_outside: bool) -> tuple[Scene, tuple]:
    """Return a scene with one more mobile from a mesh file, not yet placed, and the up axis of the file.

    name: None: that of the file, with a number if it is taken. Raises SceneError.
    """
    boundary = Boundary(path.parent, allow_outside)
    r = read_mesh_file(path, str(path), boundary)
    name = free_name((m.name for m in scene.mobiles), name or path.stem)
    check_size(f"{path}: a mobile", r.mesh)
    _check_dark(r.mesh, r.materials, str(path))
    mesh = r.mesh._replace(face_material=(r.mesh.face_material + len(scene.materials)).astype(np.int32))
    scene = replace(
        scene,
        materials=(*scene.materials, *r.materials),
        mobiles=(*scene.mobiles, Mobile(name, mesh)),
        notes=(*scene.notes, *(f'mobile "{name}": {n}' for n in r.notes)),
        files=(*scene.files, tuple(boundary.files)),
    )
    return scene, UP[r.up]


def finished(mobile: Mobile) -> Mobile:
    """Return a placed mobile from a mesh file, its edges fine enough to show shading."""
    return mobile._replace(mesh=_fine(mobile.mesh))


def cut_for_light(mesh: Mesh, materials: tuple[Material, ...]) -> Mesh:
    """Return the mesh of an object without invisible faces, and with corners where its parts touch."""
    return with_corners_at_crossings(without_holes(mesh), materials)


def free_name(names: Iterable[str], name: str) -> str:
    """Return the name of a new mobile: the given one, with a number if it is among `names`."""
    names, k, out = set(names), 2, name
    while out in names:
        out, k = f"{name} {k}", k + 1
    return out


def _check_dark(mesh: Mesh, materials: list[Material], where: str) -> None:
    for i in np.unique(mesh.face_material):
        if any(materials[i].emission):
            raise SceneError(
                f'{where}: a mobile cannot emit light, its material "{materials[i].name}" has emission '
                f"{list(materials[i].emission)}; give it emission = [0, 0, 0] under [materials] of a scene file"
            )


def _fine(mesh: Mesh) -> Mesh:
    """Return the mesh of a mobile with flat sides split, since light at their corners alone shows no shading."""
    return tessellate(mesh, COARSEST * float(np.ptp(mesh.vertices, axis=0).max()))


def join(meshes: list[Mesh], materials) -> Mesh:
    """Return several meshes as one; face materials already index the same list."""
    if len(meshes) == 1:
        return meshes[0]
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    normals = colours = None
    if any(m.corner_normals is not None for m in meshes):
        from gi_core.files.formats.mesh_file import crease_corner_normals

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


def _check_models(materials: Iterable[Material], where: str) -> None:
    """Raise SceneError for a material whose model would reflect more light than arrives."""
    for m in materials:
        if m.brdf:
            try:
                tabulate(m.brdf, m.scaled)
            except ValueError as error:
                raise SceneError(f'{where}: material "{m.name}": {error}') from None


def _darkened(materials: Iterable[Material]) -> list[str]:
    """Return a note per material whose model is darkened, as it would reflect more light than arrives."""
    found = {}
    for m in materials:
        if m.scaled and m.brdf:
            with suppress(ValueError):  # refused with the surfaces
                found[m.name] = tabulate(m.brdf, True).limited
    return [f'material "{name}": {limited}: darkened there' for name, limited in found.items() if limited]


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

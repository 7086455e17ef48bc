"""Another reflection for some faces of a scene: those of a material, or a part of a mobile.

A part is the faces of one mobile with one material. It gets materials of its own, so other objects keep theirs; so do
mobiles where a material of the static part changes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gi_core.bsdf.ggx import further_albedo, under_gloss
from gi_core.files.formats.classes import base_colours
from gi_core.files.formats.materials_table import overridden
from gi_core.files.formats.metallic_roughness import MetalRough, as_metal_rough
from gi_core.files.formats.toml_fields import Table
from gi_core.geometry.mesh_parts import part_of, with_colours, with_meshes, with_scaled_colours
from gi_core.geometry.surfaces import Surfaces, face_normals, lobe_of
from gi_core.geometry.texture_filter import MOST_REFLECTANCE
from gi_core.scene.errors import SceneError, nearest, shown
from gi_core.scene.pose import three
from gi_core.scene.types import Material, Mesh, Mobile, Scene, material_named, part_named

Values = tuple[tuple[str, Any], ...]  # keys and values of [materials.NAME] in a scene file, tables as such tuples too


def mobile_called(scene: Scene, name: str) -> Mobile:
    """Return the mobile of a name. Raises SceneError."""
    for mobile in scene.mobiles:
        if mobile.name == name:
            return mobile
    hint = nearest(name, (m.name for m in scene.mobiles))
    raise SceneError(f"{scene.name}: no mobile is called {shown(name)}; {hint}")


def _recoloured_faces(scene: Scene, these: np.ndarray, colours: np.ndarray) -> Scene:
    """Return a scene in which faces of some materials, these (n,) bool, have their colours (n, 3)."""
    rho = np.array([m.reflectance for m in scene.materials], np.float64)

    def painted(mesh: Mesh) -> Mesh:
        rows = these[mesh.face_material]
        return with_colours(mesh, rows, colours[mesh.face_material[rows]], rho) if rows.any() else mesh

    return with_meshes(scene, painted)


def _materials_called(scene: Scene, name: str) -> np.ndarray:
    """Return which materials (n,) bool have a name. Raises SceneError where none has."""
    these = np.array([m.name == name for m in scene.materials], bool)
    if not these.any():
        hint = nearest(name, (m.name for m in (*scene.mobiles, *scene.materials)))
        raise SceneError(f"{scene.name}: no mobile or material is called {shown(name)}; {hint}")
    return these


def parts_of(scene: Scene, name: str) -> tuple[str, ...]:
    """Return the parts of a mobile, in the order of its faces."""
    used, first = np.unique(mobile_called(scene, name).mesh.face_material, return_index=True)
    return tuple(dict.fromkeys(part_named(name, scene.materials[k].name) for k in used[np.argsort(first)]))


def materials_to_finish(scene: Scene, name: str, part: str) -> tuple[Scene, np.ndarray]:
    """Return the scene and which of its materials (n,) bool a Finish changes, which no other object uses."""
    mobile = next((m for m in scene.mobiles if m.name == name), None)
    if part:
        mobile = mobile_called(scene, name)
    elif any(scene.materials[k].name == name for k in np.unique(scene.static.face_material)):
        return _with_static_apart(scene, _materials_called(scene, name))
    elif mobile is None:
        return scene, _materials_called(scene, name)
    used, index = np.unique(mobile.mesh.face_material, return_inverse=True)
    wanted = np.array([part in ("", part_named(name, scene.materials[k].name)) for k in used])
    if not wanted.any():
        hint = nearest(part, parts_of(scene, name))
        raise SceneError(f"{scene.name}: mobile {shown(name)} has no part {shown(part)}; {hint}")
    own = tuple(scene.materials[k]._replace(name=material_named(name, part)) for k in used[wanted])
    numbers = used.copy()
    numbers[wanted] = len(scene.materials) + np.arange(len(own))
    mesh = mobile.mesh._replace(face_material=numbers[index.reshape(-1)].astype(np.int32))
    mobiles = tuple(m._replace(mesh=mesh) if m is mobile else m for m in scene.mobiles)
    these = np.r_[np.zeros(len(scene.materials), bool), np.ones(len(own), bool)]
    return replace(scene, materials=(*scene.materials, *own), mobiles=mobiles), these


def _with_static_apart(scene: Scene, these: np.ndarray) -> tuple[Scene, np.ndarray]:
    """Return a scene whose mobiles have copies of some materials, and which of these (n,) bool the static part uses."""
    static, shared = np.zeros((2, len(these)), bool)
    static[scene.static.face_material] = True
    for mobile in scene.mobiles:
        shared[mobile.mesh.face_material] = True
    these = these & static
    shared &= these
    numbers = np.where(shared, len(these) + np.cumsum(shared) - 1, np.arange(len(these))).astype(np.int32)
    meshes = [m.mesh._replace(face_material=numbers[m.mesh.face_material]) for m in scene.mobiles]
    mobiles = tuple(m._replace(mesh=mesh) for m, mesh in zip(scene.mobiles, meshes, strict=True))
    copies = tuple(scene.materials[k] for k in np.flatnonzero(shared))
    scene = replace(scene, materials=(*scene.materials, *copies), mobiles=mobiles)
    return scene, np.r_[these, np.zeros(len(copies), bool)]


def finished_materials(scene: Scene, these: np.ndarray, table: Table) -> Scene:
    """Return a scene in which some materials, these (n,) bool, reflect as a table says."""
    if "reflectance" not in table and "brdf" not in table:
        return _with_other_gloss(scene, these, table)
    materials = tuple(
        overridden(m._replace(gloss=None, brdf=()), table) if this else m
        for m, this in zip(scene.materials, these.tolist(), strict=True)
    )
    if "reflectance" in table:
        scene = _recoloured_faces(scene, these, np.array([m.reflectance for m in materials], np.float64))
    return replace(scene, materials=materials)


def _with_other_gloss(scene: Scene, these: np.ndarray, table: Table) -> Scene:
    """Return a scene in which some materials have other gloss, or none, over the colours and textures of their faces.

    Metal takes light from the base: colours are scaled by the rest. The colour of the metal is their mean.
    """
    materials, means = list(scene.materials), _mean_colours(scene, these)
    scales = np.ones((len(materials), 3))
    for k in np.flatnonzero(these):
        m = materials[k]._replace(gloss=None, brdf=())
        before = MetalRough(means[k], 0.0, 1.0, 1.5) if materials[k].gloss is None else as_metal_rough(
            means[k], materials[k].gloss
        )  # fmt: skip
        if before.metallic > 0 or table.values.get("metallic", 0) > 0:
            m = m._replace(reflectance=three(np.minimum(before.base, MOST_REFLECTANCE)))
            scales[k] = np.array(overridden(m, table).reflectance) / np.maximum(means[k], 1e-12)
        materials[k] = overridden(m, table)
    # Metal has left less than 2 % of the colours, which is no colour: the base has one.
    lost = (scales > 50.0).any(axis=1)
    scene = _scaled_faces(scene, these & ~lost & (scales != 1).any(axis=1), scales)
    scene = _recoloured_faces(scene, these & lost, np.array([m.reflectance for m in materials], np.float64))
    return replace(scene, materials=tuple(materials))


def _mean_colours(scene: Scene, these: np.ndarray) -> np.ndarray:
    """Return the mean base colour (n, 3) of the faces of some materials, these (n,) bool; 0 for others."""
    total, area = np.zeros((len(these), 3)), np.zeros(len(these))
    for mesh in (scene.static, *(m.mesh for m in scene.mobiles)):
        rows = these[mesh.face_material]
        if rows.any():
            part = part_of(mesh, rows)
            of, size = part.face_material, np.maximum(face_normals(part)[1], 1e-300)
            np.add.at(total, of, size[:, None] * base_colours(part, scene.materials))
            np.add.at(area, of, size)
    return total / np.maximum(area, 1e-300)[:, None]


def _scaled_faces(scene: Scene, these: np.ndarray, scales: np.ndarray) -> Scene:
    """Return a scene in which the colours of faces of some materials, these (n,) bool, are scaled, by scales (n, 3)."""

    def scaled(mesh: Mesh) -> Mesh:
        rows, by = these[mesh.face_material], scales[mesh.face_material]
        if not rows.any():
            return mesh
        by[~rows] = 1
        return with_scaled_colours(mesh, by)

    return with_meshes(scene, scaled)


def _faces_of(scene: Scene, name: str, of_static: bool, part: str) -> tuple[int, Mesh, np.ndarray]:
    """Return number and mesh of an object, and which of its faces (F,) bool belong to a material or a part."""
    names = [m.name for m in scene.mobiles]
    o = 0 if of_static or name not in names else 1 + names.index(name)
    mesh = scene.mobiles[o - 1].mesh if o else scene.static
    called = [part in ("", part_named(name, m.name)) if o else m.name == name for m in scene.materials]
    return o, mesh, np.array(called, bool)[mesh.face_material]


def is_textured(scene: Scene, name: str, of_static: bool, part: str = "") -> bool:
    """Return whether a part of a mobile, or a material of the static part, has a texture or several colours."""
    _, mesh, rows = _faces_of(scene, name, of_static, part)
    if mesh.paint is not None:
        colours = mesh.paint.corner_colour[rows].reshape(-1, 3)
        return bool((mesh.paint.face_texture[rows] >= 0).any() or (colours != colours[:1]).any())
    return mesh.face_reflectance is not None and bool(
        (mesh.face_reflectance[rows] != mesh.face_reflectance[rows][:1]).any()
    )


def finish_of(scene: Scene, surfaces: Surfaces, name: str, of_static: bool, part: str = "") -> Values:
    """Return the reflection of a part of a mobile, or of a material of the static part: that of its largest face.

    A diffuse reflectance is the mean over the area. () for an unknown name.
    """
    o, mesh, rows = _faces_of(scene, name, of_static, part)
    area = surfaces.areas[surfaces.face_range(o)] * rows
    if not area.sum() > 0:
        return ()
    m = scene.materials[mesh.face_material[area.argmax()]]
    if m.brdf:
        return _models_of(m)
    base = np.minimum(area @ surfaces.reflectance[surfaces.face_range(o)] / area.sum(), 0.98)
    if m.gloss is None:
        return (("reflectance", _known(base)),)
    row = np.array([lobe_of(m.gloss)])  # surfaces have the base's reflectance under gloss: base_albedo() inverted
    further, through = further_albedo(row)[0], under_gloss(row)
    finish = as_metal_rough(np.maximum(base - further, 0) / np.maximum(through - further, 1e-9), m.gloss)
    ior, metallic, roughness = _known((finish.ior, finish.metallic, finish.roughness))
    colour = ("reflectance", _known(np.minimum(finish.base, 0.98)))
    return colour, ("metallic", metallic), ("roughness", roughness), ("ior", ior)


def _known(numbers) -> tuple[float, float, float]:
    """Return three numbers to nine digits: means and inverses make 0.6999999999999914 of 0.7."""
    return three(float(f"{float(x):.9g}") for x in numbers)


def _models_of(m: Material) -> Values:
    """Return the models of a material: one by its name and parameters, each of a linear combination as pairs."""
    scale = (("scale", True),) if m.scaled else ()
    if len(m.brdf) == 1 and m.brdf[0].factor == 1.0:
        return ("brdf", m.brdf[0].model), *scale, *m.brdf[0].parameters
    parts = ((("model", lobe.model), ("factor", lobe.factor), *lobe.parameters) for lobe in m.brdf)
    return ("brdf", tuple(parts)), *scale

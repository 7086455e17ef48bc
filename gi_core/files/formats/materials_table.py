"""[materials.NAME] of a scene file: change materials of mesh files, or define one for a mobile."""

from __future__ import annotations

import numpy as np

from gi_core.files.formats.metallic_roughness import metallic_roughness
from gi_core.files.formats.toml_fields import Table, nearest, shown
from gi_core.scene.errors import SceneError
from gi_core.scene.rules import SHARE
from gi_core.scene.types import Material, Mesh

KEYS = ("reflectance", "emission", "two_sided", "metallic", "roughness", "ior")
SHARES = ("metallic", "roughness")
IOR = 1.5  # of glass, varnish and most plastics
MOST_IOR = 10.0


def read_materials(root: Table) -> dict[str, Table]:
    """Return the checked tables by material name."""
    tables = root.values.get("materials", {})
    if not isinstance(tables, dict):
        raise SceneError(f"{root.where}: materials are written as [materials.NAME], got {shown(tables)}")
    result = {}
    for name, values in tables.items():
        table = Table(values, f'{root.where}: material "{name}"', KEYS)
        table.vector("reflectance", 3, None, least=0, below=1)
        table.vector("emission", 3, None, least=0)
        table.flag("two_sided", False)
        gloss_of(table, Material(name))
        result[name] = table
    return result


def overridden(material: Material, table: Table | None) -> Material:
    """Return the material with the fields that its table gives."""
    if table is None:
        return material
    material = material._replace(
        reflectance=table.vector("reflectance", 3, material.reflectance),
        emission=table.vector("emission", 3, material.emission),
        two_sided=table.flag("two_sided", material.two_sided),
    )
    return gloss_of(table, material)


def gloss_of(table: Table, material: Material) -> Material:
    """Return the material with the gloss that its table gives: metallic, roughness and ior, as glTF defines them."""
    given = {key: SHARE.check(f"{table.where}: {key}", table.values[key]) for key in SHARES if key in table}
    ior = table.number("ior", IOR, least=1, below=MOST_IOR)
    if "roughness" not in given:
        if "metallic" in given or "ior" in table:
            raise SceneError(f"{table.where}: metallic and ior need a roughness from 0 to 1; write roughness = 0.3")
        return material
    metallic, roughness = given.get("metallic", 0.0), given["roughness"]
    return metallic_roughness(material, metallic, roughness, ((ior - 1) / (ior + 1)) ** 2)


def override(mesh: Mesh, materials: list[Material], tables: dict[str, Table]) -> tuple[Mesh, list[Material]]:
    """Apply the tables to a mesh and its materials: a reflectance written there replaces textures."""
    if mesh.face_reflectance is not None:
        colours = mesh.face_reflectance.copy()
        for i, m in enumerate(materials):
            if m.name in tables and "reflectance" in tables[m.name]:
                colours[mesh.face_material == i] = tables[m.name].vector("reflectance")
        mesh = mesh._replace(face_reflectance=colours)
    if mesh.paint is not None:
        texture, colour = mesh.paint.face_texture.copy(), mesh.paint.corner_colour.copy()
        for i, m in enumerate(materials):
            if m.name in tables and "reflectance" in tables[m.name]:
                texture[mesh.face_material == i] = -1
                colour[mesh.face_material == i] = tables[m.name].vector("reflectance")
        mesh = mesh._replace(paint=mesh.paint._replace(face_texture=texture, corner_colour=colour))
    return mesh, [overridden(m, tables.get(m.name)) for m in materials]


def single(mesh: Mesh, name: str, materials: list[Material], tables: dict[str, Table], where: str):
    """Return the mesh with every face of one material, named in the scene file or in the mesh file."""
    found = next((m for m in materials if m.name == name), None)
    if found is None and name not in tables:
        known = sorted({*tables, *(m.name for m in materials)})
        raise SceneError(f'{where}: there is no material "{name}"; {nearest(name, known)}')
    material = overridden(found or Material(name), tables.get(name))
    plain = mesh._replace(face_material=np.zeros(len(mesh.faces), np.int32), face_reflectance=None, paint=None)
    return plain, [material]


def check_used(tables: dict[str, Table], used: set[str]) -> None:
    """Raise SceneError for a material that no face uses, such as a misspelt name."""
    for name, table in tables.items():
        if name not in used:
            raise SceneError(f"{table.where}: no mesh has a material of that name; {nearest(name, used)}")

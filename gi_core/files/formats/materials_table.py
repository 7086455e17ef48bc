"""[materials.NAME] of a scene file: change materials of mesh files, or define one for a mobile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gi_core.bsdf.models import MODELS, lobe
from gi_core.files.formats.metallic_roughness import metallic_roughness
from gi_core.files.formats.toml_fields import Table, nearest, shown
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import three
from gi_core.scene.rules import SHARE
from gi_core.scene.types import Material, Mesh

FINISH = "reflectance", "metallic", "roughness", "ior", "brdf", "scale", "grain"
KEYS = ("emission", "two_sided", *FINISH)
SHARES = ("metallic", "roughness")
IOR = 1.5  # of glass, varnish and most plastics
MOST_IOR = 10.0
EXAMPLE = 'brdf = "ward" or brdf = [{ model = "ward", ks = 0.3 }, { model = "lewis", factor = 0.5 }]'


def read_materials(root: Table) -> dict[str, Table]:
    """Return the checked tables by material name."""
    tables = root.values.get("materials", {})
    if not isinstance(tables, dict):
        raise SceneError(f"{root.where}: materials are written as [materials.NAME], got {shown(tables)}")
    result = {}
    for name, values in tables.items():
        result[name] = checked(values, f'{root.where}: material "{name}"', KEYS)
    return result


def checked(values: Mapping[str, Any], where: str, keys: tuple[str, ...]) -> Table:
    """Return a checked table of some of KEYS and of the parameters of its model. Raises SceneError."""
    named = values.get("brdf") if isinstance(values, dict) else None
    more = tuple(MODELS[named].PARAMETERS) if isinstance(named, str) and named in MODELS else ()
    table = Table(values, where, keys + more)
    table.vector("reflectance", 3, None, least=0, below=1)
    table.vector("emission", 3, None, least=0)
    table.flag("two_sided", False)
    gloss_of(table, Material(""))
    brdf_of(table, Material(""))
    return table


def overridden(material: Material, table: Table | None) -> Material:
    """Return the material with the fields that its table gives."""
    if table is None:
        return material
    material = material._replace(
        reflectance=table.vector("reflectance", 3, material.reflectance),
        emission=table.vector("emission", 3, material.emission),
        two_sided=table.flag("two_sided", material.two_sided),
    )
    return brdf_of(table, gloss_of(table, material))


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


def brdf_of(table: Table, material: Material) -> Material:
    """Return the material with the models of reflection that its table gives: brdf = "ward", or a list of tables."""
    if "brdf" not in table:
        for key in ("scale", "grain"):
            if key in table:
                raise SceneError(f'{table.where}: {key} belongs to a model of reflection; write brdf = "ward"')
        return material
    for key in ("reflectance", *SHARES, "ior"):
        if key in table:
            raise SceneError(f"{table.where}: {key} and brdf exclude each other; write the parameters of the model")
    given = table.values["brdf"]
    if isinstance(given, str):
        known = MODELS[given].PARAMETERS if given in MODELS else ()
        given = [{"model": given, **{key: table.values[key] for key in known if key in table}}]
    if not (isinstance(given, list) and given and all(isinstance(part, dict) and "model" in part for part in given)):
        raise SceneError(f"{table.where}: brdf must be a model or a list, got {shown(given)}; write {EXAMPLE}")
    parts = ({**part} for part in given)
    try:
        lobes = tuple(lobe(part.pop("model"), factor=part.pop("factor", 1.0), parameters=part) for part in parts)
    except (ValueError, TypeError) as error:
        raise SceneError(f"{table.where}: {error}") from None
    scaled, grain = table.flag("scale", False), table.direction("grain", material.grain)
    return material._replace(brdf=lobes, scaled=scaled, grain=three(grain), gloss=None, varied=None)


def override(mesh: Mesh, materials: list[Material], tables: dict[str, Table]) -> tuple[Mesh, list[Material]]:
    """Apply the tables to a mesh and its materials: a reflectance written there replaces textures."""
    changed = [overridden(m, tables.get(m.name)) for m in materials]
    coloured = np.array([m.name in tables and "reflectance" in tables[m.name] for m in materials], bool)
    rows = coloured[mesh.face_material] if materials else np.zeros(0, bool)
    rho = np.array([m.reflectance for m in changed]).reshape(-1, 3)[mesh.face_material[rows]]
    if mesh.face_reflectance is not None:
        colours = mesh.face_reflectance.copy()
        colours[rows] = rho
        mesh = mesh._replace(face_reflectance=colours)
    if mesh.paint is not None:
        texture, colour = mesh.paint.face_texture.copy(), mesh.paint.corner_colour.copy()
        texture[rows], colour[rows] = -1, rho[:, None]
        mesh = mesh._replace(paint=mesh.paint._replace(face_texture=texture, corner_colour=colour))
    return mesh, changed


def single(mesh: Mesh, name: str, materials: list[Material], tables: dict[str, Table], where: str):
    """Return the mesh with every face of one material, named in the scene file or in the mesh file."""
    found = next((m for m in materials if m.name == name), None)
    if found is None and name not in tables:
        known = sorted({*tables, *(m.name for m in materials)})
        raise SceneError(f'{where}: there is no material "{name}"; {nearest(name, known)}')
    material = overridden(found or Material(name), tables.get(name))
    one = np.zeros(len(mesh.faces), np.int32)
    plain = mesh._replace(face_material=one, face_reflectance=None, paint=None, finish=None)
    return plain, [material]


def check_used(tables: dict[str, Table], used: set[str]) -> None:
    """Raise SceneError for a material that no face uses, such as a misspelt name."""
    for name, table in tables.items():
        if name not in used:
            raise SceneError(f"{table.where}: no mesh has a material of that name; {nearest(name, used)}")

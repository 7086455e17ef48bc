"""[materials.NAME] of a scene file: change materials of mesh files, or define one for a mobile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gi_core.bsdf.models import MODELS, Lobe, lobe
from gi_core.files.formats.metallic_roughness import metallic_roughness
from gi_core.files.formats.toml_fields import Table
from gi_core.geometry.mesh_parts import with_colours
from gi_core.scene.errors import SceneError, nearest, shown
from gi_core.scene.rules import DIRECTION, FLAG, INDEX, REFLECTANCE, SHARE, SHARES, STRENGTH
from gi_core.scene.types import Material, Mesh, Pane

FINISH = "reflectance", "metallic", "roughness", "ior", "brdf", "scale", "grain"
KEYS = ("emission", "two_sided", *FINISH, "pane", "transmittance")
OF_GLOSS = ("metallic", "roughness")
IOR = 1.5  # of glass, varnish and most plastics
EXAMPLE = 'brdf = "ward" or brdf = [{ model = "ward", ks = 0.3 }, { model = "lewis", factor = 0.5 }]'
# A model that has each key of models; "ward" where it has it.
OF_MODELS = {key: name for name in (*MODELS, "ward") for key in ("model", "factor", *MODELS[name].PARAMETERS)}


def read_materials(root: Table) -> dict[str, Table]:
    """Return the checked tables by material name."""
    tables = root.values.get("materials", {})
    if not isinstance(tables, dict):
        raise SceneError(f"{root.where}: materials are written as [materials.NAME], got {shown(tables)}")
    return {name: checked(values, f'{root.where}: material "{name}"', KEYS) for name, values in tables.items()}


def checked(values: Mapping[str, Any], where: str, keys: tuple[str, ...]) -> Table:
    """Return a checked table of some of KEYS and of the parameters of its model. Raises SceneError."""
    if not isinstance(values, dict):
        raise SceneError(f"{where}: a material is written as a table [materials.NAME], got {shown(values)}")
    brdf = values.get("brdf")
    if isinstance(brdf, str):
        _lobe({"model": brdf}, f"{where}: brdf")
    elif brdf is not None and not (isinstance(brdf, list) and brdf):
        raise SceneError(f"{where}: brdf must name a model or list several, got {shown(brdf)}; write {EXAMPLE}")
    more = tuple(MODELS[brdf].PARAMETERS) if isinstance(brdf, str) else ()
    for key in values:
        if key in OF_MODELS and key not in keys + more:
            raise SceneError(f"{where}: {_misplaced(key, brdf)}")
    table = Table(values, where, keys + more)
    overridden(Material(""), table)
    return table


def _misplaced(key: str, brdf) -> str:
    """Return a sentence about a key of models in a material without it."""
    if isinstance(brdf, str):
        return f'{brdf} has no parameter "{key}"; it has {", ".join(MODELS[brdf].PARAMETERS)}'
    if brdf is None:
        return f'{key} belongs to a model of reflection; write brdf = "{OF_MODELS[key]}"'
    return f'{key} belongs to a model of the list; write brdf = [{{ model = "{OF_MODELS[key]}", {key} = ... }}]'


def overridden(material: Material, table: Table | None) -> Material:
    """Return the material with the fields that its table gives."""
    if table is None:
        return material
    material = material._replace(
        reflectance=table.value("reflectance", REFLECTANCE, material.reflectance),
        emission=table.value("emission", STRENGTH, material.emission),
        two_sided=table.value("two_sided", FLAG, material.two_sided),
    )
    return finished(table, material)


def finished(table: Table, material: Material) -> Material:
    """Return the material with the pane, or the gloss or model of reflection, that its table gives."""
    if table.value("pane", FLAG, False):
        return pane_of(table, material)
    if material.pane and ("pane" in table or any(key in table for key in FINISH)):
        material = material._replace(pane=None)
    if "transmittance" in table:
        raise SceneError(f"{table.where}: transmittance belongs to a pane; write pane = true")
    return gloss_of(table, brdf_of(table, material))


def pane_of(table: Table, material: Material) -> Material:
    """Return the material as the pane that its table describes."""
    for key in ("reflectance", "emission", "two_sided", "brdf", "scale", "grain", *OF_GLOSS):
        if key in table:
            raise SceneError(f"{table.where}: {key} and pane exclude each other; a pane has transmittance and ior")
    clear = Pane()
    passes = table.value("transmittance", SHARES, clear.transmittance)
    return material.as_pane(Pane(passes, table.value("ior", INDEX, clear.ior)))


def gloss_of(table: Table, material: Material) -> Material:
    """Return the material with the gloss that its table gives: metallic, roughness and ior, as glTF defines them."""
    rules = {**dict.fromkeys(OF_GLOSS, SHARE), "ior": INDEX}
    gloss = {key: table.value(key, rule) for key, rule in rules.items() if key in table}
    if gloss and "roughness" not in gloss:
        raise SceneError(f"{table.where}: {next(iter(gloss))} needs a roughness from 0 to 1; write roughness = 0.3")
    if not gloss:
        return material
    ior = gloss.get("ior", IOR)
    return metallic_roughness(material, gloss.get("metallic", 0.0), gloss["roughness"], ((ior - 1) / (ior + 1)) ** 2)


def brdf_of(table: Table, material: Material) -> Material:
    """Return the material with the models of reflection that its table gives: brdf = "ward", or a list of tables."""
    if "brdf" not in table:
        for key in ("scale", "grain"):
            if key in table:
                raise SceneError(f'{table.where}: {key} belongs to a model of reflection; write brdf = "ward"')
        return material
    for key in ("reflectance", *OF_GLOSS, "ior"):
        if key in table:
            raise SceneError(f"{table.where}: {key} and brdf exclude each other; write the parameters of the model")
    lobes = _lobes(table)
    scaled, grain = table.value("scale", FLAG, False), table.value("grain", DIRECTION, material.grain)
    return material._replace(brdf=lobes, scaled=scaled, grain=grain, gloss=None, varied=None)


def _lobes(table: Table) -> tuple[Lobe, ...]:
    brdf = table.values["brdf"]
    if isinstance(brdf, str):
        own = {key: table.values[key] for key in MODELS[brdf].PARAMETERS if key in table}
        return (_lobe({"model": brdf, **own}, table.where),)
    return tuple(_lobe(part, f"{table.where}: model {k} of brdf") for k, part in enumerate(brdf, 1))


def _lobe(part, where: str) -> Lobe:
    """Return the model that a table in a list describes."""
    if not isinstance(part, dict):
        raise SceneError(f'{where} must be a table such as {{ model = "ward", ks = 0.3 }}, got {shown(part)}')
    if "model" not in part:
        raise SceneError(f'{where}: model is missing; write model = "ward"')
    for key in part:
        if key in KEYS:
            raise SceneError(f"{where}: {key} belongs to the whole material; write it beside brdf")
    values = {**part}
    try:
        return lobe(values.pop("model"), factor=values.pop("factor", 1.0), parameters=values)
    except ValueError as error:
        raise SceneError(f"{where}: {error}") from None


def override(mesh: Mesh, materials: list[Material], tables: dict[str, Table]) -> tuple[Mesh, list[Material]]:
    """Apply the tables to a mesh and its materials: a reflectance written there replaces textures."""
    changed = [overridden(m, tables.get(m.name)) for m in materials]
    coloured = np.array([m.name in tables and "reflectance" in tables[m.name] for m in materials], bool)
    rows = coloured[mesh.face_material] if materials else np.zeros(0, bool)
    rho = np.array([m.reflectance for m in changed]).reshape(-1, 3)
    plain = mesh.face_reflectance is None and mesh.paint is None  # materials give all colours
    return mesh if plain else with_colours(mesh, rows, rho[mesh.face_material[rows]], rho), changed


def single(mesh: Mesh, name: str, materials: list[Material], tables: dict[str, Table], where: str):
    """Return the mesh with every face of one material, named in the scene file or in the mesh file."""
    of_mesh = next((m for m in materials if m.name == name), None)
    if of_mesh is None and name not in tables:
        names = (*tables, *(m.name for m in materials))
        raise SceneError(f'{where}: there is no material "{name}"; {nearest(name, names)}')
    material = overridden(of_mesh or Material(name), tables.get(name))
    one = np.zeros(len(mesh.faces), np.int32)
    plain = mesh._replace(face_material=one, face_reflectance=None, paint=None, finish=None)
    return plain, [material]


def check_used(tables: dict[str, Table], used: set[str]) -> None:
    """Raise SceneError for a material that no face uses, such as a misspelt name."""
    for name, table in tables.items():
        if name not in used:
            raise SceneError(f"{table.where}: no mesh has a material of that name; {nearest(name, sorted(used))}")

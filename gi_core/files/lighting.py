"""Lights of a scene, added, changed and removed after loading."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gi_core.files.completion import default_lights
from gi_core.files.finishing import Values
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.lights_table import Luminaires, changed_light, read_light
from gi_core.files.formats.mesh_file import part_of
from gi_core.files.formats.toml_fields import Table, as_table
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.types import LightScene, Mesh, Scene
from gi_core.scene.validate import check_lamp, lamps_of


class Light(NamedTuple):
    """Add a light, or change one: the given values replace its own. With a `type` among them it is a new one."""

    name: str
    light: Values  # of a table [[light]], without name and file
    file: str = ""  # photometric
    of: str = ""  # begin with the values of the light of this name, for a new one
    number: int = 1  # of the lights of that name, from 1


class Darken(NamedTuple):
    """Remove a lamp: its lights, and the emission of its faces; with a number, one of its lights.

    Of a default light the faces go too.
    """

    name: str
    number: int | None = None


def place_of(scene: Scene, name: str, number: int) -> int | None:
    """Return the place in `scene.lights` of a light, by its number among those of its name, from 1; None: none is."""
    places = [k for k, light in enumerate(scene.lights) if light.name == name]
    return places[number - 1] if 1 <= number <= len(places) else None


def lit(scene: Scene, edit: Light, allow_outside: bool) -> Scene:
    """Return a scene with a light that an edit adds or changes. Raises SceneError."""
    where = f"{scene.name}: light {shown(edit.name)}"
    values = as_table(edit.light)
    place = place_of(scene, edit.name, edit.number)
    if "type" in values:
        file = Path(edit.file)
        boundary = Boundary(file.parent, allow_outside)
        luminaires = Luminaires(file.parent, boundary, scene.units, scene.up)
        named = {"file": file.name} if edit.file else {}
        light = read_light({**values, **named, "name": edit.name}, where, edit.name, luminaires)
        notes = [note for found in luminaires.files.values() for note in found.notes]
        if boundary.files:
            scene = replace(scene, files=(*scene.files, tuple(boundary.files)))
    else:
        of = place if not edit.of else place_of(scene, edit.of, edit.number)
        place = None if edit.of else place
        if of is None:
            there = ", ".join(f'"{light.name}"' for light in scene.lights) or "none"
            raise SceneError(f"{scene.name}: no light is called {shown(edit.of or edit.name)}; there is {there}")
        light, notes = changed_light(scene.lights[of]._replace(name=edit.name), Table(values, where, None)), []
    lights = (*scene.lights, light) if place is None else (*scene.lights[:place], light, *scene.lights[place + 1 :])
    return replace(scene, lights=lights, notes=(*scene.notes, *notes))


def darkened(scene: Scene, name: str, number: int | None) -> Scene:
    """Return a scene without a lamp, or without one of its lights. Raises SceneError."""
    check_lamp(f"{scene.name}: remove a lamp", name, scene)
    if number is not None:
        place = place_of(scene, name, number)
        if place is None:
            raise SceneError(f"{scene.name}: lamp {shown(name)} has no light {number}")
        scene = replace(scene, lights=(*scene.lights[:place], *scene.lights[place + 1 :]))
    else:
        materials = tuple(m._replace(emission=(0.0, 0.0, 0.0)) if m.name == name else m for m in scene.materials)
        lights = tuple(light for light in scene.lights if light.name != name)
        scene = replace(scene, lights=lights, materials=materials, static=_without_stand_in(scene, name))
    there = lamps_of(scene)
    kept = (LightScene(s.name, tuple(level for level in s.levels if level.lamp in there)) for s in scene.light_scenes)
    return replace(scene, light_scenes=tuple(kept))


def _without_stand_in(scene: Scene, name: str) -> Mesh:
    """Return the static part without the faces of a default light: they would stay as a dark plate."""
    these = np.array([m.name == name for m in scene.materials], bool)[scene.static.face_material]
    stands_in = name == default_lights.NAME and default_lights.lit_by_stand_ins(scene)
    return part_of(scene.static, ~these) if stands_in and these.any() else scene.static

"""Edits of a scene after loading: materials, lights, mobiles inserted, copied or removed, static faces made mobile.

An edited scene equals one that was built so, and its solver needs no history. `edited_solver` of `gi_core.solver` keeps
the photon paths that an edit does not touch.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import components
from gi_core.base.vectors import length
from gi_core.files.completion import DEFAULT_LAMP, lit_by_stand_ins
from gi_core.files.completion.pilot import bottom_centre
from gi_core.files.finishing import Values, finished_materials, materials_to_finish, mobile_called
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.materials_table import FINISH, checked
from gi_core.files.formats.shapes import read_shape
from gi_core.files.formats.toml_fields import Table, as_table
from gi_core.files.formats.toml_file import DAYLIGHT, Luminaires, changed_light, read_daylight, read_light
from gi_core.files.load import inserted
from gi_core.geometry.mesh_parts import join, part_of
from gi_core.geometry.surfaces import face_normals
from gi_core.lights.daylight import SKY, SUN, daylit
from gi_core.scene.errors import SceneError, nearest, shown
from gi_core.scene.pose import as_pose, to_world, to_world_directions
from gi_core.scene.rules import PLACE
from gi_core.scene.types import LightScene, Mesh, Mobile, Pose, Scene
from gi_core.scene.validate import check_lamp, check_scene, lamps_of

__all__ = [
    "KINDS", "Darken", "Daylight", "Duplicate", "Edit", "EditError", "Finish", "Freeze", "Insert", "Light", "Promote",
    "Remove", "Versions", "edited", "files_of_edits", "names_after", "piece_at", "removed_lamps", "with_edit",
]  # fmt: skip


class Finish(NamedTuple):
    """Give all faces of a material, or a part of a mobile, another reflection.

    A part is the faces of one mobile with one material. A reflectance replaces textures and colours per face; without
    one they stay. Without roughness or a model the surface is diffuse.
    """

    name: str  # of a mobile if there is a part, else of a material of the static part, else of a mobile or material
    material: Values  # of FINISH, or parameters of a model
    part: str = ""  # material of the mobile's faces; "": all of them


class Insert(NamedTuple):
    """Add a mobile: a mesh file, turned upright and sized as `load_scene(mobiles=...)` does, or a shape."""

    name: str
    file: str = ""
    pose: Pose | None = None  # None: on the nearest free floor in view
    shape: Values = ()  # of a table [[shape]], without name and place; (): the file


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


class Light(NamedTuple):
    """Add a light, or change one: the given values replace its own. With a `type` among them it is a new one."""

    name: str
    light: Values  # of a table [[light]], without name and file
    file: str = ""  # photometric
    of: str = ""  # begin with the values of the light of this name, for a new one
    number: int = 1  # of the lights of that name, from 1


class Daylight(NamedTuple):
    """Add daylight, or change it: the given values replace its own."""

    light: Values  # of the table [daylight]
    name: str = "daylight"


class Darken(NamedTuple):
    """Remove a lamp: its lights, and the emission of its faces; with a number, one of its lights.

    Of a default light the faces go too.
    """

    name: str
    number: int | None = None


class EditError(SceneError):
    """An edit that its scene refuses; `number`: its place in the list of edits, from 0."""

    number = 0


Edit = Finish | Insert | Duplicate | Remove | Promote | Freeze | Light | Daylight | Darken
KINDS: dict[str, type[Edit]] = {
    kind.__name__.lower(): kind
    for kind in (Finish, Insert, Duplicate, Remove, Promote, Freeze, Light, Daylight, Darken)
}

ADDING, TAKING = (Insert, Duplicate, Promote), (Remove, Freeze)  # a mobile


class Versions(NamedTuple):
    """A scene, and those after the last of some edits. Others begin at the last version that they share with these."""

    scenes: Mapping[int, Scene]  # by number of edits: 0 and the last three, as each edit copies the static part
    edits: tuple[Edit, ...] = ()

    @property
    def last(self) -> Scene:
        return self.scenes[len(self.edits)]

    def after(self, edits: Sequence[Edit], allow_outside: bool = False) -> Versions:
        """Return the versions of other edits. Raises EditError, as edited()."""
        same = [a == b for a, b in zip(self.edits, edits, strict=False)]
        shared = [*same, False].index(False)
        scenes = {number: scene for number, scene in self.scenes.items() if number <= shared}
        first = max(scenes)
        scene = scenes[first]
        for number, edit in enumerate(edits[first:], first):
            try:
                scene = scenes[number + 1] = _edited(scene, edit, allow_outside)
                if number == len(edits) - 1:
                    check_scene(scene)
            except SceneError as problem:
                refused = EditError(str(problem))
                refused.number = number
                raise refused from None
        return Versions({k: v for k, v in scenes.items() if k == 0 or k > len(edits) - 3}, tuple(edits))


def edited(scene: Scene, edits: Sequence[Edit], allow_outside: bool = False) -> Scene:
    """Return a scene after edits, in order; allow_outside: as for load_scene(), of inserted files.

    Raises EditError for a name that the scene does not have at that point, or has already, and for a bad value.
    """
    return Versions({0: scene}).after(edits, allow_outside).last


def names_after(names: Iterable[str], before: Sequence[Edit], after: Sequence[Edit]) -> set[str]:
    """Return the names of the mobiles after some edits, from those after other edits of the same scene."""
    mobiles = set(names)
    for edit in reversed(before):
        mobiles = mobiles - {edit.name} if isinstance(edit, ADDING) else mobiles
        mobiles = mobiles | {edit.name} if isinstance(edit, TAKING) else mobiles
    for edit in after:
        mobiles = mobiles | {edit.name} if isinstance(edit, ADDING) else mobiles
        mobiles = mobiles - {edit.name} if isinstance(edit, TAKING) else mobiles
    return mobiles


def files_of_edits(edits: Iterable[Edit]) -> list[str]:
    """Return the files that edits read."""
    return [edit.file for edit in edits if isinstance(edit, Insert | Light) and edit.file]


def with_edit(edits: Sequence[Edit], edit: Edit) -> tuple[Edit, ...]:
    """Return edits with one more at the end, which replaces an earlier one of the same faces or of the same light.

    The earlier one stays if an edit in between may depend on it.
    """
    if isinstance(edit, Light) and not edit.of:
        for k in reversed(range(len(edits))):
            earlier = edits[k]
            if not isinstance(earlier, Light | Finish) or (isinstance(earlier, Light) and earlier.of == edit.name):
                break
            if isinstance(earlier, Light) and (earlier.name, earlier.number) == (edit.name, edit.number):
                return (*edits[:k], *edits[k + 1 :], _merged(earlier, edit))
    if isinstance(edit, Daylight) and edits and isinstance(edits[-1], Daylight):
        return (*edits[:-1], _merged(edits[-1], edit))
    if isinstance(edit, Finish):
        for k in reversed(range(len(edits))):
            earlier = edits[k]
            if not isinstance(earlier, Finish):
                break
            if (earlier.name, earlier.part) == (edit.name, edit.part):
                return (*edits[:k], *edits[k + 1 :], edit)
            if not (earlier.part and edit.part) and (earlier.part or earlier.name) == (edit.part or edit.name):
                break  # a part of a mobile, and the material of that name
    return (*edits, edit)


def _merged(earlier: Light | Daylight, edit: Light | Daylight) -> Light | Daylight:
    """Return one edit of a light in place of two."""
    if "type" in dict(edit.light):
        return edit
    return earlier._replace(light=tuple({**dict(earlier.light), **dict(edit.light)}.items()))


def removed_lamps(edits: Iterable[Edit]) -> set[str]:
    """Return the names of lamps that edits have removed; settings may still name them, for an undo."""
    removed: set[str] = set()
    for edit in edits:
        if isinstance(edit, Darken) and edit.number is None:
            removed.add(edit.name)
        elif isinstance(edit, Light):
            removed.discard(edit.name)
    return removed


def _edited(scene: Scene, edit: Edit, allow_outside: bool) -> Scene:
    match edit:
        case Finish(name, material, part):
            values = as_table(material)
            table = checked(values, f"{scene.name}: the material of {shown(name)}", FINISH)
            return finished_materials(*materials_to_finish(scene, name, part), table)
        case Insert(name, file, pose, shape):
            where, up = f"{scene.name}: shape {shown(name)}", int(np.argmax(np.abs(scene.up)))
            source = read_shape({**as_table(shape), "name": name}, where, 0, up) if shape else Path(file)
            return inserted(scene, source, _new(scene, name), pose, allow_outside)
        case Duplicate(name, of, pose):
            copy = mobile_called(scene, of)._replace(name=_new(scene, name), pose=_pose(scene, name, pose), path=None)
            return replace(scene, mobiles=(*scene.mobiles, copy))
        case Remove(name):
            return _without(scene, mobile_called(scene, name))
        case Promote(name, point):
            return _promoted(scene, _new(scene, name), PLACE.check(f"{scene.name}: the point of {shown(name)}", point))
        case Freeze(name, pose):
            return _frozen(scene, mobile_called(scene, name), _pose(scene, name, pose))
        case Light():
            return _lit(scene, edit, allow_outside)
        case Daylight(values):
            return _daylit(scene, values)
        case Darken(name, number):
            return _darkened(scene, name, number)


def _new(scene: Scene, name: str) -> str:
    if not name or any(m.name == name for m in scene.mobiles):
        raise SceneError(f"{scene.name}: a new mobile must have a name of its own, got {shown(name)}")
    return name


def _pose(scene: Scene, name: str, pose: Pose) -> Pose:
    return as_pose(pose, f"{scene.name}: mobile {shown(name)}")


def _without(scene: Scene, mobile: Mobile) -> Scene:
    return replace(scene, mobiles=tuple(m for m in scene.mobiles if m is not mobile))


# Objects --------------------------------------------------------------------------------------------


def piece_at(mesh: Mesh, point) -> np.ndarray:
    """Return which faces (F,) bool hang together with the face nearest to a point (3,) [m]: they share corners."""
    from trimesh.triangles import closest_point

    solid = np.flatnonzero(face_normals(mesh)[1] > 0)  # of others trimesh 5.2 gives wrong points
    corners, at = mesh.vertices[mesh.faces[solid]], np.broadcast_to(np.asarray(point, np.float64), (len(solid), 3))
    near = solid[length(closest_point(corners, at) - at).argmin()]
    _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = same.reshape(-1)[mesh.faces]
    label = components(np.concatenate([faces[:, :2], faces[:, 1:]]), int(faces.max()) + 1)[faces[:, 0]]
    return label == label[near]


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


def _frozen(scene: Scene, mobile: Mobile, pose: Pose) -> Scene:
    mesh = mobile.mesh
    mesh = mesh._replace(vertices=to_world(pose, mesh.vertices))
    if mesh.corner_normals is not None:
        normals = to_world_directions(pose, mesh.corner_normals.reshape(-1, 3)).reshape(-1, 3, 3)
        mesh = mesh._replace(corner_normals=normals)
    return replace(_without(scene, mobile), static=join([scene.static, mesh], scene.materials))


# Lights ---------------------------------------------------------------------------------------------


def place_of(scene: Scene, name: str, number: int) -> int | None:
    """Return the place in `scene.lights` of a light, by its number among those of its name, from 1; None: none is."""
    places = [k for k, light in enumerate(scene.lights) if light.name == name]
    return places[number - 1] if 1 <= number <= len(places) else None


def _lit(scene: Scene, edit: Light, allow_outside: bool) -> Scene:
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
        notes = [note for photometry in luminaires.files.values() for note in photometry.notes]
        if boundary.files:
            scene = replace(scene, files=(*scene.files, tuple(boundary.files)))
    else:
        of = place if not edit.of else place_of(scene, edit.of, edit.number)
        place = None if edit.of else place
        if of is None:
            name, hint = edit.of or edit.name, nearest(edit.of or edit.name, (light.name for light in scene.lights))
            raise SceneError(f"{scene.name}: no light is called {shown(name)}; {hint}")
        light, notes = changed_light(scene.lights[of]._replace(name=edit.name), Table(values, where, None)), []
    lights = (*scene.lights, light) if place is None else (*scene.lights[:place], light, *scene.lights[place + 1 :])
    return replace(scene, lights=lights, notes=(*scene.notes, *notes))


def _daylit(scene: Scene, values: Values) -> Scene:
    """Return a scene with daylight, or with its own at another place, date or hour. Raises SceneError."""
    own = {} if scene.daylight is None else scene.daylight._asdict()
    own = {key: value for key, value in own.items() if value is not None}
    table = Table(as_table(tuple({**own, **dict(values)}.items())), f"{scene.name}: [daylight]", DAYLIGHT)
    return daylit(scene, read_daylight(table), scene.name)


def _darkened(scene: Scene, name: str, number: int | None) -> Scene:
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
    if scene.daylight is not None and not {SUN, SKY} & {light.name for light in scene.lights}:
        scene = replace(scene, daylight=None)
    lamps = lamps_of(scene)
    kept = (LightScene(s.name, tuple(level for level in s.levels if level.name in lamps)) for s in scene.light_scenes)
    return replace(scene, light_scenes=tuple(kept))


def _without_stand_in(scene: Scene, name: str) -> Mesh:
    """Return the static part without the faces of a default light: they would stay as a dark plate."""
    these = np.array([m.name == name for m in scene.materials], bool)[scene.static.face_material]
    stands_in = name == DEFAULT_LAMP and lit_by_stand_ins(scene)
    return part_of(scene.static, ~these) if stands_in and these.any() else scene.static

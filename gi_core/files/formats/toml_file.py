"""Scene files: TOML, read into descriptions with every value checked. Meshes are loaded by `load.py`.

`scenes/cornell.toml` shows every table with comments. A table [[light]] is read by its type, and changed key by key.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gi_core.base.fixed_point import MAX_PHOTONS
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.materials_table import read_materials
from gi_core.files.formats.photometry_file import PhotometryFile, read_photometry
from gi_core.files.formats.shapes import Shape, read_shape
from gi_core.files.formats.toml_fields import REQUIRED, Table, read_toml
from gi_core.scene.errors import SceneError, shown, utf8
from gi_core.scene.pose import as_pose, axis_angle, multiply_quaternions, three
from gi_core.scene.rules import (
    DIRECTION,
    FLAG,
    LENGTH,
    LEVEL,
    NAME,
    NUMBER,
    PLACE,
    STRENGTH,
    TEXT,
    TINIEST,
    Rule,
    is_array,
    is_direction,
    is_number,
    number,
    numbers,
    rows,
    vector,
    whole,
    word,
)
from gi_core.scene.types import (
    MOST_GRID_POINTS,
    OVERCAST_SKY,
    QUANTITIES,
    TARGETS,
    CalculationSurface,
    Camera,
    Daylight,
    Defaults,
    DirectionalLight,
    KeyFrames,
    LampLevel,
    Light,
    LightScene,
    PhotometricLight,
    PointLight,
    Pose,
    Probe,
    SkyLight,
    SpotLight,
)
from gi_core.scene.validate import FIELDS, check_fields

LIGHTS: dict[str, type[Light]] = {  # by type
    "point": PointLight, "spot": SpotLight, "panel": PhotometricLight, "photometric": PhotometricLight,
    "directional": DirectionalLight, "sky": SkyLight,
}  # fmt: skip
PANEL = "position", "direction", "c0", "flux", "size"  # keys of a panel
# A surface of constant radiance: intensity falls with the cosine, linear between whole degrees within 4e-5.
GAMMAS, PLANES = np.arange(0.0, 91.0), np.array([0.0, 360.0])
COSINE = np.tile(np.append(np.cos(np.radians(GAMMAS[:-1])), 0.0), (2, 1))
LEFT_OUT: dict[str, dict[str, Any]] = {  # values of keys that a table leaves out, where they are not the record's
    "spot": {"inner_degrees": 0.0},
    "panel": {"c0": None, "gammas_degrees": GAMMAS, "planes_degrees": PLANES, "intensity": COSINE},
}


class Luminaires:
    """Photometric files of a scene, each read once, and facts of the scene that their lights need."""

    def __init__(self, folder: Path, boundary: Boundary, units: str, up: tuple[float, float, float]):
        self.files: dict[Path, PhotometryFile] = {}
        self.photometric, self.up = units == "photometric", np.array(up)
        self._folder, self._boundary = folder, boundary

    def read(self, name: str, where: str) -> PhotometryFile:
        path = self._folder / name
        if path not in self.files:
            self.files[path] = read_photometry(path, f"{where}: {name}", self._boundary)
        return self.files[path]


def read_light(values: dict, where: str, default_name: str, luminaires: Luminaires) -> Light:
    """Return the light of a table [[light]]. Raises SceneError."""
    kind = Table(values, where, None).value("type", word(tuple(LIGHTS)))
    record, of_file = LIGHTS[kind], ("file",) if kind == "photometric" else ()
    keys = keys_of(record)
    t = Table(values, where, keys, ("type", "name", *of_file))
    name = t.value("name", NAME, default_name)
    rest = _of_file(t, luminaires) if of_file else LEFT_OUT.get(kind, record._field_defaults)
    fields = rest | {key: t.value(key, FIELDS[record][key], rest.get(key, REQUIRED)) for key in keys}
    if "c0" in fields:
        fields["c0"] = fields["c0"] or c0_of(fields["direction"])
    light = record(name, **fields)
    check_fields(where, light)
    return light


def keys_of(record: type[Light]) -> Sequence[str]:
    """Return the keys of a light in a scene file, besides type, name and file."""
    return PANEL if record is PhotometricLight else tuple(FIELDS[record])


def changed_light(light: Light, table: Table) -> Light:
    """Return a light with the values that a table gives in place of its own. Raises SceneError for a wrong key."""
    t = Table(table.values, table.where, keys_of(type(light)))
    return light._replace(**{key: t.value(key, FIELDS[type(light)][key]) for key in t.values})


def _of_file(t: Table, luminaires: Luminaires) -> dict[str, Any]:
    """Return the fields that the photometric file of a light gives. Its table may have another flux and size."""
    name, flux = t.value("file", NAME), None
    file = luminaires.read(name, t.where)
    if "flux" not in t and luminaires.photometric:
        direction = np.array(t.value("direction", DIRECTION))
        axis = direction / np.sqrt((direction * direction).sum())
        tilt = math.degrees(math.acos(min(max(-float((axis * luminaires.up).sum()), -1.0), 1.0)))
        flux = (file.flux * (file.tilt.factor(tilt) if file.tilt else 1.0),) * 3
    elif "flux" not in t:
        raise SceneError(
            f"{t.where}: flux is missing; write flux = [r, g, b] in watts, or units = "
            f'"photometric" at the top of the file for the {file.flux:.0f} lm of {name}'
        )
    return {
        "c0": None, "gammas_degrees": file.gammas, "planes_degrees": file.planes, "intensity": file.intensity,
        "size": file.size, "flux": flux, "watts": file.watts,
    }  # fmt: skip


def c0_of(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the axis of coordinates, x, y or z, that is most perpendicular to a direction; the first of several."""
    axis = np.array(direction) / np.sqrt((np.array(direction) ** 2).sum())
    x, y, z = np.eye(3)[int(np.argmin(np.abs(axis)))].tolist()
    return x, y, z


UP = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
ROOT = (
    "title", "up", "units", "static", "shape", "mobile", "light", "materials", "camera", "probe", "defaults",
    "light_scenes", "daylight", "surface", "watts", "maintenance_factor", "hold",
)  # fmt: skip
NAMES = Rule(
    "a text in quotes, not empty, or a list of them",
    lambda value: NAME.holds(value) or (isinstance(value, list) and value != [] and all(map(NAME.holds, value))),
    lambda value: [value] if isinstance(value, str) else value,
    NAME.example,
)
STATIC = {"mesh": NAMES, "scale": LENGTH, "max_edge": LENGTH}
MOBILE = {"name": NAME, "mesh": NAME, "scale": LENGTH, "max_edge": LENGTH, "material": NAME, "position": PLACE}
LEFT_OUT_OF_MESH = {"scale": 1.0, "max_edge": None, "material": None, "position": None}
ROTATION = ("rotation", "axis", "angle", "path")  # keys of a mobile, besides
PLACED = {"mobile": FLAG, "position": PLACE}  # keys of a shape, besides
PATH = ("times", "positions", "rotations", "spin", "spin_axis")
TIMES = Rule("a list of finite numbers", lambda values: is_array(values, (None,)) and len(values) > 0, example="[0, 1]")
PROBE = {"name": NAME, **FIELDS[Probe]}
POINTS = Rule(
    f"2 whole numbers from 1 to {MOST_GRID_POINTS}",
    lambda values: is_array(values, (2,), 1, MOST_GRID_POINTS) and all(v == int(v) for v in values),
    lambda values: tuple(map(int, values)),
)
SURFACE = {
    "name": NAME, "on": TEXT, "position": numbers(2), "height": NUMBER, "tilt": number("from 0 to 180", 0, 180),
    "size": vector("2 numbers > 0", lambda values: is_array(values, (2,), TINIEST), 2), "turn": NUMBER,
    "margin": LEVEL, "points": POINTS, "quantity": word(QUANTITIES), "views": whole(1, 36),
}  # fmt: skip
CAMERA = {
    "position": PLACE, "target": PLACE, "fov": number("> 0 and < 180", TINIEST, math.nextafter(180, 0)),
}  # fmt: skip


def _is_date(value) -> bool:
    try:
        return 1901 <= datetime.date.fromisoformat(str(value)).year <= 2099
    except ValueError:
        return False


DAYLIGHT = {
    "place": Rule(
        "latitude from -90 to 90 and longitude from -180 to 180, north and east positive",
        lambda value: is_array(value, (2,)) and abs(value[0]) <= 90 and abs(value[1]) <= 180,
        lambda value: tuple(map(float, value)), "[40.4, -3.7]",
    ),
    "date": Rule("a day from 1901 to 2099 such as 2026-03-21", _is_date, str, "2026-03-21"),
    "hour": number(">= 0 and < 24", 0, math.nextafter(24, 0)), "utc_offset": number("from -12 to 15", -12, 15),
    "turbidity": number("from 1 to 10", 1, 10), "north": DIRECTION, "sky": whole(1, OVERCAST_SKY),
}  # fmt: skip
DEFAULTS = {
    **FIELDS[Defaults],
    "photons": whole(1, MAX_PHOTONS),
    "neighbours": whole(1, 100_000),
    "estimator": NAME,
}
Z_UP = (".ply", ".stl")  # mesh formats that are z up


class StaticEntry(NamedTuple):
    meshes: list[Path]
    scale: float
    max_edge: float | None  # [m], after scaling
    shapes: list[Shape]


class MobileEntry(NamedTuple):
    name: str
    where: str
    mesh: Path | Shape
    scale: float
    max_edge: float | None
    material: str | None
    pose: Pose | None  # None: resting on the floor, chosen by placement
    path: KeyFrames | None


class SceneFile(NamedTuple):
    """A scene file as written, checked; mesh paths are resolved, not read."""

    static: StaticEntry
    mobiles: list[MobileEntry]
    materials: dict[str, Table]
    photometry: dict[Path, PhotometryFile]  # files of luminaires
    daylight: Daylight | None
    scene: dict[str, Any]  # by field of Scene; up: None: the custom of the first mesh's format


def read_scene_file(path: Path, where: str, boundary: Boundary | None = None) -> SceneFile:
    """Read and check a scene file.

    Raises SceneError for anything that is missing, misspelt or out of range.
    """
    boundary = boundary or Boundary(path.parent, named=path)
    root = Table(read_toml(path, where, boundary), where, ROOT)
    up = up_of(root.values.get("up"), where)
    tables = [root.tables(key, key) for key in ("mobile", "light", "probe", "shape", "surface")]
    boundary.take(where, "objects", sum(map(len, tables)))
    of_static = [t for t in tables[3] if t.get("mobile") is not True]
    if "static" not in root and not of_static:
        raise SceneError(f'{where}: [static] is missing; write [static] and below it mesh = "room.glb"')
    left_out = LEFT_OUT_OF_MESH | ({"mesh": []} if of_static else {})
    meshes, *split = root.section("static", STATIC).fields(left_out).values()
    paths = [path.parent / mesh for mesh in meshes]
    convention = UP["z" if paths and paths[0].suffix.lower() in Z_UP else "y"]
    axis = int(np.argmax(np.abs(up or convention)))
    shapes = [_shape(t, i, where, up, axis, boundary) for i, t in enumerate(tables[3])]
    entry = StaticEntry(paths, *split, [shape for shape in shapes if isinstance(shape, Shape)])
    mobiles = [_mobile(path.parent, t, i, where, up, boundary) for i, t in enumerate(tables[0])]
    mobiles += [shape for shape in shapes if isinstance(shape, MobileEntry)]
    units = root.value("units", word(("radiometric", "photometric")), "radiometric")
    luminaires = Luminaires(path.parent, boundary, units, up or convention)
    lights = [
        read_light(t, _entry(where, "light", t, i), f"light {i + 1}", luminaires) for i, t in enumerate(tables[1])
    ]
    probes = [_probe(t, i, where) for i, t in enumerate(tables[2])]
    for what, named in (("mobile", mobiles), ("light", lights), ("probe", probes)):
        _check_names(what, [n.name for n in named], where)
    fields = {
        "name": root.value("title", NAME, utf8(path.stem)),
        "up": up,
        "units": units,
        "lights": tuple(lights),
        "camera": read_camera(root.section("camera", CAMERA)) if "camera" in root else None,
        "probes": tuple(probes),
        "defaults": Defaults(**root.section("defaults", DEFAULTS).fields(Defaults._field_defaults)),
        "light_scenes": tuple(read_light_scenes(root)),
        "surfaces": read_surfaces(root),
        "watts": read_watts(root),
        "maintenance_factor": root.value("maintenance_factor", number("> 0 and <= 1", TINIEST, 1), 1.0),
        "hold": root.value("hold", FLAG, False),
    }
    daylight = read_daylight(root.section("daylight", DAYLIGHT)) if "daylight" in root else None
    return SceneFile(entry, mobiles, read_materials(root), luminaires.files, daylight, fields)


def read_watts(root: Table) -> tuple[tuple[str, float], ...]:
    """Return the table [watts]: power by lamp. Raises SceneError."""
    table = root.section("watts")
    return tuple((name, table.value(name, LEVEL)) for name in table.values)


def read_surfaces(root: Table) -> tuple[CalculationSurface, ...]:
    """Return the tables [[surface]]. Raises SceneError."""
    tables, where = root.tables("surface", "surface"), root.where
    surfaces = tuple(read_surface(t, _entry(where, "surface", t, i)) for i, t in enumerate(tables))
    _check_names("surface", [s.name for s in surfaces], where)
    return surfaces


def read_surface(values: dict, where: str) -> CalculationSurface:
    """Return the surface of a table. Raises SceneError."""
    table = Table(values, where, SURFACE, ("targets",))
    if "on" in table:
        for key in ("position", "size", "tilt", "turn"):
            if key in table:
                raise SceneError(f"{where}: the surface has the {key} of the face it lies on; leave out {key}, or on")
    of_targets = table.section("targets", TARGETS)
    targets = tuple((name, of_targets.value(name, LENGTH)) for name in TARGETS if name in of_targets)
    return CalculationSurface(**table.fields(CalculationSurface._field_defaults), targets=targets)


def read_daylight(table: Table) -> Daylight:
    """Return the daylight of a table of the keys DAYLIGHT. Raises SceneError."""
    return Daylight(**table.fields(Daylight._field_defaults))


def _check_names(what: str, names: list[str], where: str) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            raise SceneError(f'{where}: {what} "{name}": names must differ, this one is used twice; rename one')


def read_light_scenes(root: Table) -> list[LightScene]:
    """Return the tables [light_scenes.NAME]. Raises SceneError."""
    out = []
    for name, values in root.section("light_scenes").values.items():
        table = Table(values, f'{root.where}: light scene "{name}"', None)
        out.append(LightScene(name, tuple(lamp_level(table, lamp) for lamp in table.values)))
    return out


def lamp_level(table: Table, lamp: str) -> LampLevel:
    """Return the state of a lamp: a number >= 0, three for red, green and blue, or a table. Raises SceneError."""
    value = table.values[lamp]
    if isinstance(value, dict):
        of = Table(value, f"{table.where}: lamp {shown(lamp)}", ("level", "colour", "on"))
        if "colour" not in of and isinstance(of.values.get("level"), list):
            return _coloured(lamp, of.value("level", STRENGTH))._replace(on=of.value("on", FLAG, True))
        colour = of.value("colour", STRENGTH, LampLevel("").colour)
        return LampLevel(lamp, of.value("level", LEVEL, 1.0), colour, of.value("on", FLAG, True))
    if isinstance(value, list):
        return _coloured(lamp, table.value(lamp, STRENGTH))
    if not is_number(value, 0):
        rule = "must be a number >= 0, three of them, or a table such as { level = 0.5, on = false }"
        raise SceneError(f"{table.where}: {lamp} {rule}, got {shown(value)}")
    return LampLevel(lamp, float(value))


def _coloured(lamp: str, rgb: tuple[float, float, float]) -> LampLevel:
    """Return a lamp at a level per channel."""
    return LampLevel(lamp, rgb[0]) if rgb[0] == rgb[1] == rgb[2] else LampLevel(lamp, 1.0, rgb)


def up_of(value, where: str) -> tuple[float, float, float] | None:
    """Return the unit vector of "x", "y", "z" or three numbers; None stays. Raises SceneError."""
    if value is None:
        return None
    if isinstance(value, str) and value in UP:
        return UP[value]
    if not is_direction(value):
        raise SceneError(f'{where}: up must be "x", "y", "z" or three numbers that are not all 0, got {shown(value)}')
    return _unit(value)


def _unit(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    v = np.array(direction)
    return three(v / np.sqrt((v * v).sum()))


def _entry(scene: str, kind: str, values: dict, i: int) -> str:
    """Return the place of entry i of a list: by its name, else by its number from 1."""
    return f"{scene}: {kind} " + (f'"{values["name"]}"' if "name" in values else str(i + 1))


def _mobile(folder, values, i, scene, up, boundary) -> MobileEntry:
    where = _entry(scene, "mobile", values, i)
    t = Table(values, where, MOBILE, ROTATION)
    fields = t.fields(LEFT_OUT_OF_MESH)
    pose, path = _place(t, fields.pop("position"), up, boundary)
    return MobileEntry(**fields | {"where": where, "mesh": folder / fields["mesh"], "pose": pose, "path": path})


def _shape(values, i, scene, up, axis: int, boundary) -> Shape | MobileEntry:
    """Return a shape of the static part, or the mobile that it is."""
    where = _entry(scene, "shape", values, i)
    shape = read_shape(values, where, i + 1, axis, (*PLACED, *ROTATION))
    t = Table(values, where, None)
    pose, path = _place(t, t.value("position", PLACE, None), up, boundary)
    if t.value("mobile", FLAG, False):
        return MobileEntry(shape.name, where, shape, 1.0, shape.max_edge, None, pose, path)
    if path is not None:
        raise SceneError(f"{where}: a path needs a mobile; write mobile = true")
    return shape._replace(pose=pose or Pose())


def _place(t: Table, position, up, boundary) -> tuple[Pose | None, KeyFrames | None]:
    """Return the start pose and the path of a table; None: it has none."""
    where, turn, path = t.where, _rotation(t), None
    if "path" in t:
        path = _path(Table(t.values["path"], f"{where}: path", PATH), turn or (1.0, 0.0, 0.0, 0.0), up, boundary)
    pose = None
    if position is not None or turn is not None or path is not None:
        at = position if position is not None else (path.positions[0] if path is not None else (0.0, 0.0, 0.0))
        first = tuple(path.quaternions[0]) if path is not None and turn is None else turn or (1.0, 0.0, 0.0, 0.0)
        pose = as_pose(Pose(tuple(at), first), where)
    return pose, path


def _rotation(t: Table):
    """Return a quaternion from `rotation`, or from `axis` and `angle` in degrees; None for neither."""
    if "rotation" in t:
        if "axis" in t or "angle" in t:
            raise SceneError(f"{t.where}: rotation and axis/angle exclude each other; keep one of them")
        return as_pose(Pose((0.0, 0.0, 0.0), t.value("rotation", numbers(4))), f"{t.where}: rotation").quaternion
    if "axis" in t or "angle" in t:
        return axis_angle(t.value("axis", DIRECTION), t.value("angle", NUMBER))
    return None


def _path(t: Table, rest, up, boundary) -> KeyFrames:
    times = np.array(t.value("times", TIMES), np.float64)
    boundary.take(t.where, "key frames", len(times))
    if (np.diff(times) <= 0).any():
        raise SceneError(f"{t.where}: times must increase, got {times.tolist()}")
    positions = np.array(t.value("positions", rows(len(times), 3)), np.float64)
    if "rotations" in t:
        if "spin" in t:
            raise SceneError(f"{t.where}: rotations and spin exclude each other; keep one of them")
        q = enumerate(t.value("rotations", rows(len(times), 4)))
        q = [as_pose(Pose(quaternion=tuple(r)), f"{t.where}: rotations[{i}]").quaternion for i, r in q]
        return KeyFrames(times, positions, np.array(q))
    spin = t.value("spin", NUMBER, 0.0)  # degrees a second
    axis = t.value("spin_axis", DIRECTION, up or UP["y"])
    if spin:
        spans = np.diff(times)
        # 90.0 degrees between keys at most: slerp takes the shorter way round, 180 would be ambiguous
        parts = np.maximum(np.ceil(np.abs(spin) * spans / 90.0), 1)
        boundary.take(f"{t.where}: spin", "key frames", int(min(parts.sum(), 1e15)))
        parts = parts.astype(int)
        dense = [a + d * np.arange(n) / n for a, d, n in zip(times, spans, parts, strict=False)]
        dense = np.concatenate([*dense, times[-1:]])
        positions = np.stack([np.interp(dense, times, positions[:, k]) for k in range(3)], axis=1)
        times = dense
    q = [multiply_quaternions(axis_angle(axis, spin * (s - times[0])), rest) for s in times]
    return KeyFrames(times, positions, np.array(q))


def _probe(values, i, scene) -> Probe:
    probe = Probe(**Table(values, _entry(scene, "probe", values, i), PROBE).fields({}))
    return probe._replace(normal=_unit(probe.normal))


def read_camera(t: Table) -> Camera:
    """Return the camera of a table of the keys CAMERA. Raises SceneError."""
    position, target, fov = t.fields({"fov": Camera._field_defaults["vertical_fov_degrees"]}).values()
    if position == target:
        raise SceneError(
            f"{t.where}: target must differ from position, got {list(target)} for both; write the centre of the picture"
        )
    return Camera(position, target, fov)

"""Scene files: TOML, read into descriptions with every value checked. Meshes are loaded by `load.py`.

`scenes/cornell.toml` shows every table with comments. A table [[light]] is read by its type, and changed key by key.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.materials_table import read_materials
from gi_core.files.formats.photometry_file import PhotometryFile, read_photometry
from gi_core.files.formats.shapes import Shape, read_shape
from gi_core.files.formats.toml_fields import REQUIRED, Table, of, read_toml, shown
from gi_core.scene.errors import SceneError, utf8
from gi_core.scene.pose import as_pose, axis_angle, multiply_quaternions, three
from gi_core.scene.rules import is_number
from gi_core.scene.types import (
    CLEAR_SKY,
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

PLACE = of("vector")
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
    kind = Table({k: v for k, v in values.items() if k == "type"}, where, ("type",)).text("type", choices=tuple(LIGHTS))
    record, of_file = LIGHTS[kind], ("file",) if kind == "photometric" else ()
    keys = keys_of(record)
    t = Table(values, where, keys, ("type", "name", *of_file))
    name = t.text("name", default_name)
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
    file, flux = luminaires.read(t.text("file"), t.where), None
    if "flux" not in t and luminaires.photometric:
        direction = np.array(t.direction("direction"))
        axis = direction / np.sqrt((direction * direction).sum())
        tilt = math.degrees(math.acos(min(max(-float((axis * luminaires.up).sum()), -1.0), 1.0)))
        flux = (file.flux * (file.tilt.factor(tilt) if file.tilt else 1.0),) * 3
    elif "flux" not in t:
        raise SceneError(
            f"{t.where}: flux is missing; write flux = [r, g, b] in watts, or units = "
            f'"photometric" at the top of the file for the {file.flux:.0f} lm of {t.text("file")}'
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
LENGTH, SCALE, NAME = of("number", default=None, above=0), of("number", default=1.0, above=0), of("text")
ROOT = (
    "title", "up", "units", "static", "shape", "mobile", "light", "materials", "camera", "probe", "defaults",
    "light_scenes", "daylight", "surface", "watts", "maintenance_factor", "hold",
)  # fmt: skip
STATIC = {"mesh": of("texts"), "scale": SCALE, "max_edge": LENGTH}
MOBILE = {
    "name": NAME, "mesh": NAME, "scale": SCALE, "max_edge": LENGTH, "material": of("text", default=None),
    "position": of("vector", default=None),
}  # fmt: skip
ROTATION = ("rotation", "axis", "angle", "path")  # keys of a mobile, besides
PLACED = {"mobile": of("flag", default=False), "position": of("vector", default=None)}  # keys of a shape, besides
PATH = ("times", "positions", "rotations", "spin", "spin_axis")
PROBE = {"name": NAME, "position": PLACE, "normal": of("direction")}
SURFACE = {
    "name": NAME, "on": of("text", default=""), "position": of("vector", n=2, default=None),
    "size": of("vector", n=2, default=None, above=0), "height": of("number", default=None),
    "tilt": of("number", default=0.0, least=0, below=math.nextafter(180, 181)), "turn": of("number", default=0.0),
    "margin": of("number", default=None, least=0),
    "points": of("counts", n=2, most=MOST_GRID_POINTS), "targets": of("numbers_by", keys=TARGETS),
    "quantity": of("text", default="illuminance", choices=QUANTITIES), "views": of("count", default=1, most=36),
}  # fmt: skip
CAMERA = {"position": PLACE, "target": PLACE, "fov": of("number", default=45.0, above=0, below=180)}
DAYLIGHT = {
    "place": of("place"), "date": of("date"), "hour": of("number", least=0, below=24),
    "utc_offset": of("number", least=-12, below=math.nextafter(15, 16)),
    "turbidity": of("number", default=3.0, least=1, below=math.nextafter(10, 11)),
    "north": of("direction", default=None), "sky": of("count", default=CLEAR_SKY, most=OVERCAST_SKY),
}  # fmt: skip
DEFAULTS = {
    "photons": of("count"), "radius": LENGTH, "neighbours": of("count"), "estimator": of("text", default=None),
    "exposure": of("number", default=None, above=-65, below=65), "scene_size": LENGTH,
}  # fmt: skip
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

    title: str
    up: tuple[float, float, float] | None  # None: the custom of the first mesh's format
    units: str
    static: StaticEntry
    mobiles: list[MobileEntry]
    lights: list[Light]
    materials: dict[str, Table]
    camera: Camera | None
    probes: list[Probe]
    defaults: Defaults
    light_scenes: list[LightScene]
    photometry: dict[Path, PhotometryFile]  # files of luminaires
    daylight: Daylight | None = None
    surfaces: tuple[CalculationSurface, ...] = ()
    watts: tuple[tuple[str, float], ...] = ()
    maintenance_factor: float = 1.0
    hold: bool = False


def read_scene_file(path: Path, where: str, boundary: Boundary | None = None) -> SceneFile:
    """Read and check a scene file.

    Raises SceneError for anything that is missing, misspelt or out of range.
    """
    boundary = boundary or Boundary(path.parent, named=path)
    root = Table(read_toml(path, where, boundary), where, ROOT)
    up = read_up(root)
    tables = [root.tables(key, key) for key in ("mobile", "light", "probe", "shape", "surface")]
    boundary.take(where, "objects", sum(map(len, tables)))
    of_static = [t for t in tables[3] if t.get("mobile") is not True]
    if "static" not in root and not of_static:
        raise SceneError(f'{where}: [static] is missing; write [static] and below it mesh = "room.glb"')
    keys = STATIC | {"mesh": of("texts", default=[])} if of_static else STATIC
    meshes, *split = root.section("static", keys).fields().values()
    paths = [path.parent / mesh for mesh in meshes]
    convention = UP["z" if paths and paths[0].suffix.lower() in Z_UP else "y"]
    axis = int(np.argmax(np.abs(up or convention)))
    shapes = [_shape(t, i, where, up, axis, boundary) for i, t in enumerate(tables[3])]
    entry = StaticEntry(paths, *split, [shape for shape in shapes if isinstance(shape, Shape)])
    mobiles = [_mobile(path.parent, t, i, where, up, boundary) for i, t in enumerate(tables[0])]
    mobiles += [shape for shape in shapes if isinstance(shape, MobileEntry)]
    units = root.text("units", "radiometric", ("radiometric", "photometric"))
    luminaires = Luminaires(path.parent, boundary, units, up or convention)
    lights = [
        read_light(t, _entry(where, "light", t, i), f"light {i + 1}", luminaires) for i, t in enumerate(tables[1])
    ]
    probes = [_probe(t, i, where) for i, t in enumerate(tables[2])]
    for what, named in (("mobile", mobiles), ("light", lights), ("probe", probes)):
        _check_names(what, [n.name for n in named], where)
    return SceneFile(
        root.text("title", utf8(path.stem)),
        up,
        units,
        entry,
        mobiles,
        lights,
        read_materials(root),
        read_camera(root.section("camera", CAMERA)) if "camera" in root else None,
        probes,
        Defaults(**root.section("defaults", DEFAULTS).fields()),
        read_light_scenes(root),
        luminaires.files,
        Daylight(**root.section("daylight", DAYLIGHT).fields()) if "daylight" in root else None,
        read_surfaces(root),
        read_watts(root),
        root.number("maintenance_factor", 1.0, above=0, below=math.nextafter(1, 2)),
        root.flag("hold", False),
    )


def read_watts(root: Table) -> tuple[tuple[str, float], ...]:
    """Return the table [watts]: power by lamp. Raises SceneError."""
    table = root.section("watts")
    return tuple((name, table.number(name, least=0)) for name in table.values)


def read_surfaces(root: Table) -> tuple[CalculationSurface, ...]:
    """Return the tables [[surface]]. Raises SceneError."""
    tables, where = root.tables("surface", "surface"), root.where
    surfaces = tuple(read_surface(t, _entry(where, "surface", t, i)) for i, t in enumerate(tables))
    _check_names("surface", [s.name for s in surfaces], where)
    return surfaces


def read_surface(values: dict, where: str) -> CalculationSurface:
    """Return the surface of a table. Raises SceneError."""
    table = Table(values, where, SURFACE)
    if "on" in table:
        for key in ("position", "size", "tilt", "turn"):
            if key in table:
                raise SceneError(f"{where}: the surface has the {key} of the face it lies on; leave out {key}, or on")
    return CalculationSurface(**table.fields())


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
            return _coloured(lamp, of.vector("level", least=0))._replace(on=of.flag("on", True))
        level = of.number("level", 1.0, least=0)
        return LampLevel(lamp, level, of.vector("colour", 3, LampLevel("").colour, least=0), of.flag("on", True))
    if isinstance(value, list):
        return _coloured(lamp, table.vector(lamp, least=0))
    if not is_number(value, 0):
        rule = "must be a number >= 0, three of them, or a table such as { level = 0.5, on = false }"
        raise SceneError(f"{table.where}: {lamp} {rule}, got {shown(value)}")
    return LampLevel(lamp, table.number(lamp, least=0))


def _coloured(lamp: str, rgb: tuple[float, float, float]) -> LampLevel:
    """Return a lamp at a level per channel."""
    return LampLevel(lamp, rgb[0]) if rgb[0] == rgb[1] == rgb[2] else LampLevel(lamp, 1.0, rgb)


def read_up(root: Table) -> tuple[float, float, float] | None:
    """Return the unit up vector, None if the file does not say."""
    value = root.values.get("up")
    if value is None:
        return None
    if isinstance(value, str) and value in UP:
        return UP[value]
    if not isinstance(value, list):
        raise SceneError(f'{root.where}: up must be "x", "y", "z" or three numbers in brackets, got {shown(value)}')
    return _unit(root.direction("up"))


def _unit(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    v = np.array(direction)
    return three(v / np.sqrt((v * v).sum()))


def _entry(scene: str, kind: str, values: dict, i: int) -> str:
    """Return the place of entry i of a list: by its name, else by its number from 1."""
    return f"{scene}: {kind} " + (f'"{values["name"]}"' if "name" in values else str(i + 1))


def _mobile(folder, values, i, scene, up, boundary) -> MobileEntry:
    where = _entry(scene, "mobile", values, i)
    t = Table(values, where, MOBILE, ROTATION)
    fields = t.fields()
    pose, path = _place(t, fields.pop("position"), up, boundary)
    return MobileEntry(**fields | {"where": where, "mesh": folder / fields["mesh"], "pose": pose, "path": path})


def _shape(values, i, scene, up, axis: int, boundary) -> Shape | MobileEntry:
    """Return a shape of the static part, or the mobile that it is."""
    where = _entry(scene, "shape", values, i)
    shape = read_shape(values, where, i + 1, axis, (*PLACED, *ROTATION))
    mobile, position = Table({k: v for k, v in values.items() if k in PLACED}, where, PLACED).fields().values()
    pose, path = _place(Table(values, where, None), position, up, boundary)
    if mobile:
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
        return as_pose(Pose((0.0, 0.0, 0.0), t.vector("rotation", 4)), f"{t.where}: rotation").quaternion
    if "axis" in t or "angle" in t:
        return axis_angle(t.direction("axis"), t.number("angle"))
    return None


def _path(t: Table, rest, up, boundary) -> KeyFrames:
    times = np.array(t.numbers("times"))
    boundary.take(t.where, "key frames", len(times))
    if (np.diff(times) <= 0).any():
        raise SceneError(f"{t.where}: times must increase, got {times.tolist()}")
    positions = np.array(t.vectors("positions", 3, len(times)))
    if "rotations" in t:
        if "spin" in t:
            raise SceneError(f"{t.where}: rotations and spin exclude each other; keep one of them")
        q = t.vectors("rotations", 4, len(times))
        q = [as_pose(Pose(quaternion=r), f"{t.where}: rotations[{i}]").quaternion for i, r in enumerate(q)]
        return KeyFrames(times, positions, np.array(q))
    spin = t.number("spin", 0.0)  # degrees a second
    axis = t.direction("spin_axis", up or UP["y"])
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
    probe = Probe(**Table(values, _entry(scene, "probe", values, i), PROBE).fields())
    return probe._replace(normal=_unit(probe.normal))


def read_camera(t: Table) -> Camera:
    """Return the camera of a table of the keys CAMERA. Raises SceneError."""
    position, target, fov = t.fields().values()
    if position == target:
        raise SceneError(
            f"{t.where}: target must differ from position, got {list(target)} for both; write the centre of the picture"
        )
    return Camera(position, target, fov)

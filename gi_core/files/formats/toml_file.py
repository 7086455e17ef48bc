"""Scene files: TOML, read into descriptions with every value checked. Meshes are loaded by `load.py`.

`scenes/cornell.toml` shows every table with comments.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.lights_table import Luminaires, read_light
from gi_core.files.formats.materials_table import read_materials
from gi_core.files.formats.photometry_file import PhotometryFile
from gi_core.files.formats.toml_fields import Table, read_toml, shown
from gi_core.scene.errors import SceneError, utf8
from gi_core.scene.pose import as_pose, axis_angle, multiply_quaternions
from gi_core.scene.rules import is_number
from gi_core.scene.types import (
    Camera,
    Defaults,
    KeyFrames,
    LampLevel,
    Light,
    LightScene,
    Pose,
    Probe,
)

UP = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
ROOT = (
    "title",
    "up",
    "units",
    "static",
    "mobile",
    "light",
    "materials",
    "camera",
    "probe",
    "defaults",
    "light_scenes",
)
Z_UP = (".ply", ".stl")  # mesh formats that are z up


class StaticEntry(NamedTuple):
    meshes: list[Path]
    scale: float
    max_edge: float | None  # [m], after scaling


class MobileEntry(NamedTuple):
    name: str
    where: str
    mesh: Path
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


def read_scene_file(path: Path, where: str, boundary: Boundary | None = None) -> SceneFile:
    """Read and check a scene file.

    Raises SceneError for anything that is missing, misspelt or out of range.
    """
    boundary = boundary or Boundary(path.parent)
    root = Table(read_toml(path, where, boundary), where, ROOT)
    up = read_up(root)
    if "static" not in root:
        raise SceneError(f'{where}: [static] is missing; write [static] and below it mesh = "room.glb"')
    static = Table(root.values["static"], f"{where}: [static]", ("mesh", "scale", "max_edge"))
    entry = StaticEntry(
        [path.parent / m for m in static.texts("mesh")],
        static.number("scale", 1.0, above=0),
        static.number("max_edge", None, above=0),
    )
    tables = [root.tables(key, key) for key in ("mobile", "light", "probe")]
    boundary.take(where, "objects", sum(map(len, tables)))
    mobiles = [_mobile(path.parent, t, i, where, up, boundary) for i, t in enumerate(tables[0])]
    units = root.text("units", "radiometric", ("radiometric", "photometric"))
    convention = UP["z" if entry.meshes[0].suffix.lower() in Z_UP else "y"]
    luminaires = Luminaires(path.parent, boundary, units, up or convention)
    lights = [read_light(t, _entry(where, "light", t, i), f"light {i}", luminaires) for i, t in enumerate(tables[1])]
    probes = [_probe(t, i, where) for i, t in enumerate(tables[2])]
    for what, named in (("mobile", mobiles), ("light", lights), ("probe", probes)):
        names = [n.name for n in named]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise SceneError(f'{where}: {what} "{name}": names must differ, this one is used twice; rename one')
    return SceneFile(
        root.text("title", utf8(path.stem)),
        up,
        units,
        entry,
        mobiles,
        lights,
        read_materials(root),
        _camera(root, where),
        probes,
        _defaults(root, where),
        read_light_scenes(root),
        luminaires.files,
    )


def read_light_scenes(root: Table) -> list[LightScene]:
    """Return the tables [light_scenes.NAME]. Raises SceneError."""
    out = []
    tables = Table(root.values.get("light_scenes", {}), f"{root.where}: [light_scenes]", None)
    for name, values in tables.values.items():
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
    v = np.array(root.direction("up"))
    return tuple(float(x) for x in v / np.sqrt((v * v).sum()))


def _entry(scene: str, kind: str, values: dict, i: int) -> str:
    """Return the place of entry i of a list: by its name, else by its number from 1."""
    return f"{scene}: {kind} " + (f'"{values["name"]}"' if "name" in values else str(i + 1))


def _mobile(folder, values, i, scene, up, boundary) -> MobileEntry:
    keys = ("name", "mesh", "scale", "max_edge", "material", "position", "rotation", "axis", "angle", "path")
    where = _entry(scene, "mobile", values, i)
    t = Table(values, where, keys)
    position = t.vector("position", 3, None)
    turn = _rotation(t)
    path = None
    if "path" in t:
        path = _path(Table(t.values["path"], f"{where}: path", PATH), turn or (1.0, 0.0, 0.0, 0.0), up, boundary)
    pose = None
    if position is not None or turn is not None or path is not None:
        at = position if position is not None else (path.positions[0] if path is not None else (0.0, 0.0, 0.0))
        first = tuple(path.quaternions[0]) if path is not None and turn is None else turn or (1.0, 0.0, 0.0, 0.0)
        pose = as_pose(Pose(tuple(at), first), where)
    return MobileEntry(
        t.text("name"),
        where,
        folder / t.text("mesh"),
        t.number("scale", 1.0, above=0),
        t.number("max_edge", None, above=0),
        t.text("material", None),
        pose,
        path,
    )


PATH = ("times", "positions", "rotations", "spin", "spin_axis")


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
    t = Table(values, _entry(scene, "probe", values, i), ("name", "position", "normal"))
    n = np.array(t.direction("normal"))
    return Probe(t.text("name"), t.vector("position"), tuple(float(x) for x in n / np.sqrt((n * n).sum())))


def _camera(root: Table, where: str) -> Camera | None:
    if "camera" not in root:
        return None
    t = Table(root.values["camera"], f"{where}: [camera]", ("position", "target", "fov"))
    position, target = t.vector("position"), t.vector("target")
    if position == target:
        raise SceneError(f"{where}: [camera]: target must differ from position, got {list(target)} for both")
    return Camera(position, target, t.number("fov", 45.0, above=0, below=180))


def _defaults(root: Table, where: str) -> Defaults:
    keys = ("photons", "radius", "neighbours", "estimator", "exposure", "scene_size")
    t = Table(root.values.get("defaults", {}), f"{where}: [defaults]", keys)
    return Defaults(
        t.count("photons"),
        t.number("radius", None, above=0),
        t.count("neighbours"),
        t.text("estimator", None),
        t.number("exposure", None, above=-65, below=65),
        t.number("scene_size", None, above=0),
    )

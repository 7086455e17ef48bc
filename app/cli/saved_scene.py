"""Saved scenes: a TOML file that names a scene and holds its poses, camera and settings; the same as a command line.

A saved scene leaves the files of the scene as they are. Every field of Settings with an option is saved, if it differs
from its default. Numbers keep all digits, so that a saved scene opens with the same bits.
"""

from __future__ import annotations

import argparse
import filecmp
import itertools
import os
import shlex
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.writable import remove_parts, replacing, write_whole
from app.settings import OPTIONS, TABLE, TOGETHER, LampLevel, Pin, Settings, flag_of, open_scene
from gi_core.files.find import shipped_scenes
from gi_core.scene import Camera, Pose
from gi_core.scene.errors import SceneError, shown, utf8
from gi_core.scene.types import CalculationSurface

if TYPE_CHECKING:
    from gi_core.files.edits import Edit

HEADER = "# A scene with its poses, camera and settings, saved by gi-viewer.\n"
KEYS = tuple(dict.fromkeys(row.kept for row in TABLE.values() if row.kept))
SAVED = tuple(name for name, row in TABLE.items() if row.kept == TOGETHER)
VALUES = "material", "light", "shape"  # fields of edits that are tables of a scene file


def with_view(settings: Settings, poses: Mapping[str, Pose], camera: Camera) -> Settings:
    """Return settings that open a scene with mobiles at these poses and this camera."""
    numbers = tuple((name, (*pose.position, *pose.quaternion)) for name, pose in poses.items())
    return replace(settings, poses=numbers, camera=camera)


def command_line(settings: Settings) -> str:
    """Return the command that opens the scene with these settings."""
    words = ["gi-viewer", settings.scene]
    for field, row in OPTIONS.items():
        value = getattr(settings, field)
        if value == getattr(Settings, field):
            continue
        if isinstance(value, bool):
            words.append(flag_of(field))
        else:
            several = value if row.flag else [value]
            several = settings.levels(()).items() if field == "lamps" else several
            written = [(flag_of(field), _word(field, v)) for v in several]
            words += [w for flag, v in written for w in ([f"{flag}={v}"] if v.startswith("-") else [flag, v])]
    return shlex.join(words)


def _word(field: str, value: Any) -> str:
    """Return a value as its option takes it."""
    if field in ("poses", "lamps", "watts"):
        return f"{value[0]}={_word('', value[1])}"
    if field == "surfaces":
        return ", ".join(f"{key} = {_inline(v)}" for key, v in _surface_table(value).items())
    if field == "size":
        return f"{value[0]}x{value[1]}"
    if field == "camera":
        value = (*value.position, *value.target, value.vertical_fov_degrees)
    return ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)


# Files ------------------------------------------------------------------------------------------------


def opened(settings: Settings, allow_outside: bool = False) -> Settings:
    """Return the settings of the saved scene that `settings` name, else `settings`. Raises SceneError.

    The loader reads any other file, and gives the reason if it is no TOML.
    """
    path = settings.scene
    if Path(path).suffix.lower() != ".toml" or not os.path.isfile(path):
        return settings
    try:
        values = _toml_of(path)
    except SceneError:
        return settings
    return _settings_of(values, path, allow_outside) if "scene" in values else settings


def read(path: str, allow_outside: bool = False) -> Settings:
    """Return the settings of a saved scene. Raises SceneError: file, rule, value found."""
    return _settings_of(_toml_of(path), path, allow_outside)


def _toml_of(path: str) -> dict[str, Any]:
    """Return the tables of a file. Raises SceneError."""
    from gi_core.files.formats.boundary import Boundary
    from gi_core.files.formats.toml_fields import read_toml

    return read_toml(Path(path), path, Boundary(Path(path).parent, named=Path(path)))


def _settings_of(tables: dict[str, Any], path: str, allow_outside: bool) -> Settings:
    """Return the settings of the tables of a saved scene. Raises SceneError."""
    from gi_core.files.formats import toml_file
    from gi_core.files.formats.boundary import Boundary
    from gi_core.files.formats.toml_fields import Table
    from gi_core.scene.rules import NAME, TEXT, numbers

    file = Path(os.path.realpath(path))  # of a link: files are named relative to its target
    boundary = Boundary(file.parent, allow_outside)
    root, pin = Table(tables, path, KEYS), toml_file.PROBE | {"object": TEXT}
    mobiles = root.value("mobiles", toml_file.NAMES) if root.values.get("mobiles") else []
    table = root.section(TOGETHER, SAVED)
    values = {field: _checked(field, value, table.where) for field, value in table.values.items()}
    places = root.section("poses")
    poses = tuple((name, places.value(name, numbers(7))) for name in places.values)
    levels = root.section("lamps")
    lamps = tuple(toml_file.lamp_level(levels, name) for name in levels.values)
    scenes = tuple(toml_file.read_light_scenes(root))
    camera = toml_file.read_camera(root.section("camera", toml_file.CAMERA)) if "camera" in root else None
    views = root.section("cameras").values.items()
    cameras = tuple(
        (name, toml_file.read_camera(Table(view, f"{path}: [cameras.{name}]", toml_file.CAMERA)))
        for name, view in views
    )
    edits = tuple(_edit(t, k, file, boundary, path) for k, t in enumerate(root.tables("edits", "scene edit")))
    entries = enumerate(root.tables("pins", "read-out"), 1)
    pins = tuple(
        Pin(**Table(values, f"{path}: [[pins]] {k}", pin).fields(Pin._field_defaults)) for k, values in entries
    )
    scene, *more = (_found(name, file, boundary, path) for name in (root.value("scene", NAME), *mobiles))
    return Settings(
        document=path,
        scene=scene,
        mobiles=tuple(more),
        edits=edits,
        poses=poses,
        camera=camera,
        lamps=lamps,
        watts=toml_file.read_watts(root),
        light_scenes=scenes,
        pins=pins,
        cameras=cameras,
        surfaces=toml_file.read_surfaces(root) if "surface" in root else None,
        **values,
    )


def _inline(value: Any) -> str:
    """Return a value of a table of a surface, as TOML on one line."""
    import tomli_w

    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_inline(v)}' for key, v in value.items())} }}"
    return tomli_w.dumps({"k": value}).removeprefix("k = ").strip() if isinstance(value, str) else repr(value)


def _surface_table(surface: CalculationSurface) -> dict[str, Any]:
    """Return a surface as a table of a scene file, without keys at their defaults."""
    changed = {key: v for key, v in surface._asdict().items() if v != surface._field_defaults.get(key)}
    return {key: dict(v) if key == "targets" else list(v) if isinstance(v, tuple) else v for key, v in changed.items()}


def write(path: Path, settings: Settings, files: Iterable[tuple[str, ...]] | None = None) -> list[Path]:
    """Save settings, as of with_view(), and beside them new copies of files outside their folder; return the copies.

    files: as of Scene, those that the scene was read from; None: it is read to find out. Raises OSError; the copies of
    a scene that cannot be saved are removed.
    """
    made: list[Path] = []
    try:
        names = _names_of_files(Path(os.path.realpath(path)), settings, files, made)
        remove_parts(Path(os.path.realpath(path)).parent)
        write_whole(path, _text_of(settings, names))
        return [copy for copy in made if copy.is_file()]
    except BaseException:
        for copy in reversed(made):
            with suppress(OSError):
                copy.rmdir() if copy.is_dir() else copy.unlink()
        raise


def _text_of(settings: Settings, names: Mapping[str, str]) -> str:
    """Return a saved scene; names: how it names the files of the settings."""
    import tomli_w

    scene, *mobiles = (names[name] for name in (settings.scene, *settings.mobiles))
    saved = {field: getattr(settings, field) for field in SAVED}
    changed = {field: v for field, v in saved.items() if v != getattr(Settings, field)}
    document: dict[str, Any] = {"scene": scene, "mobiles": mobiles} if mobiles else {"scene": scene}
    document[TOGETHER] = {field: list(v) if isinstance(v, tuple) else v for field, v in changed.items()}
    if settings.edits:
        document["edits"] = [_table_of(edit, names) for edit in settings.edits]
    if settings.watts:
        document["watts"] = dict(settings.watts)
    if settings.camera is not None:
        document["camera"] = _camera_table(settings.camera)
    if settings.poses:
        document["poses"] = {name: list(numbers) for name, numbers in settings.poses}
    if settings.cameras:
        document["cameras"] = {name: _camera_table(camera) for name, camera in settings.cameras}
    if settings.pins:
        document["pins"] = [{key: v for key, v in pin._asdict().items() if v != ""} for pin in settings.pins]
    if settings.surfaces is not None:
        document["surface"] = [_surface_table(surface) for surface in settings.surfaces]
    lamps = _lamps_table("lamps", settings.lamps) if settings.lamps else ""
    scenes = "".join(_lamps_table(f"light_scenes.{_key(name)}", kept) for name, kept in settings.light_scenes)
    return HEADER + tomli_w.dumps(document) + lamps + scenes


def _lamps_table(header: str, lamps: tuple[LampLevel, ...]) -> str:
    """Return a table of lamps, a line per lamp; a lamp that is off keeps its level and colour."""
    lines = [f"{_key(name)} = {_lamp_value(lamp)}" for name, lamp in {lamp.name: lamp for lamp in lamps}.items()]
    return "\n".join(["", f"[{header}]", *lines, ""])


def _lamp_value(lamp: LampLevel) -> str:
    """Return the state of a lamp in its shortest spelling."""
    level, colour = repr(float(lamp.level)), repr([float(c) for c in lamp.colour])
    white = lamp.colour == (1, 1, 1)
    if lamp.on and white:
        return level
    if lamp.on and lamp.level == 1:
        return colour
    keys = [f"level = {level}"] + [f"colour = {colour}"] * (not white) + ["on = false"] * (not lamp.on)
    return f"{{ {', '.join(keys)} }}"


def _key(name: str) -> str:
    """Return a name as a key of TOML, in quotes where it needs them."""
    import tomli_w

    return tomli_w.dumps({name: 0}).removesuffix(" = 0\n")


def _table_of(edit: Edit, names: Mapping[str, str]) -> dict[str, Any]:
    """Return an edit of the scene as a table of a saved scene."""
    from gi_core.files.formats.toml_fields import as_table

    table: dict[str, Any] = {"kind": type(edit).__name__.lower()}
    for field, value in edit._asdict().items():
        if field in edit._field_defaults and value == edit._field_defaults[field]:
            continue
        if field == "file":
            table[field] = names[value]
        elif field in VALUES:
            table[field] = as_table(value)
        elif field == "pose" and value is not None:
            table[field] = [*value.position, *value.quaternion]
        else:
            table[field] = list(value) if isinstance(value, tuple) else value
    return table


def _frozen(value: Any) -> Any:
    """Return a value of a table as edits have it: tuples in place of lists, pairs in place of tables."""
    if isinstance(value, dict):
        return tuple((key, _frozen(v)) for key, v in value.items())
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _edit(values: dict, number: int, file: Path, boundary, where: str) -> Edit:
    """Return the edit of a table of a saved scene. Raises SceneError."""
    from gi_core.files.edits import KINDS, Insert
    from gi_core.files.formats.toml_fields import Table
    from gi_core.scene.rules import NAME, PLACE, TABLE, numbers, whole, word

    of = f"{where}: edit {number + 1}"
    kind = KINDS[Table(values, of, None).value("kind", word(tuple(KINDS)))]
    table, fields = Table(values, of, ("kind", *kind._fields)), {}
    if kind is Insert and ("file" in table) == ("shape" in table):
        raise SceneError(f'{of}: an object has a file or a shape; write one of them, such as file = "chair.glb"')
    for field in (name for name in kind._fields if name in table or name not in kind._field_defaults):
        if field == "point":
            fields[field] = table.value(field, PLACE)
        elif field == "pose":
            fields[field] = Pose((v := table.value(field, numbers(7)))[:3], v[3:])
        elif field in VALUES:
            fields[field] = _frozen(table.value(field, TABLE))
        elif field == "number":
            fields[field] = table.value(field, whole(1, 1000))
        elif field == "file":
            fields[field] = _found(table.value(field, NAME), file, boundary, of)
        else:
            fields[field] = table.value(field, NAME)
    return kind(**fields)


def _camera_table(camera: Camera) -> dict[str, Any]:
    return {"position": list(camera.position), "target": list(camera.target), "fov": camera.vertical_fov_degrees}


def _checked(field: str, value: Any, where: str) -> Any:
    """Return a value of [settings] as its option gives it. Raises SceneError."""
    option = OPTIONS[field].option
    if option.get("action") in ("store_true", "store_false"):
        if not isinstance(value, bool):
            raise SceneError(f"{where}: {field} must be true or false, got {shown(value)}")
        return value
    if (choices := option.get("choices")) and value not in choices:
        raise SceneError(f"{where}: {field} must be one of {', '.join(choices)}, got {shown(value)}")
    if not (convert := option.get("type")):
        if not isinstance(value, str):
            raise SceneError(f"{where}: {field} must be a text in quotes, got {shown(value)}")
        return value
    parts = value if isinstance(value, list | tuple) else [value]
    if not all(isinstance(part, int | float) and not isinstance(part, bool) for part in parts):
        raise SceneError(f"{where}: {field} must be a number, or a list of them, got {shown(value)}")
    try:
        return convert(",".join(map(repr, parts)))
    except (argparse.ArgumentTypeError, ValueError) as problem:
        raise SceneError(f"{where}: {field} {problem}") from None


def _found(name: str, file: Path, boundary, where: str) -> str:
    """Return the path of a file that a saved scene names, or the name of a shipped scene."""
    path = file.parent / name
    if not os.path.isfile(path) and name in shipped_scenes():
        return name
    if not boundary.holds(path):
        raise SceneError(f"{where}: {name} lies outside the folder of the saved scene; give --allow-outside")
    return os.path.normpath(path)


def _names_of_files(
    document: Path, settings: Settings, files: Iterable[tuple[str, ...]] | None, made: list[Path]
) -> dict[str, str]:
    """Return how a saved scene names the files of its settings, relative to its folder; copy those outside it.

    made: receives the folders and files that are new. Raises OSError.
    """
    from gi_core.files.edits import files_of_edits

    named = dict.fromkeys((settings.scene, *settings.mobiles, *files_of_edits(settings.edits)))
    places, outside = {name: name for name in named}, []
    for name in named:
        if not os.path.isfile(name) and name in shipped_scenes():
            continue
        real = Path(os.path.realpath(name))
        place = _relative(real, document.parent)
        if (settings.allow_outside or real.is_relative_to(document.parent)) and place == utf8(place):
            places[name] = place
        else:
            outside.append(name)
    if outside and files is None:
        files = ()
        with suppress(SceneError):  # the files that are named are copied all the same
            files = open_scene(settings).files
    parts = {of[0]: of for of in files or ()}
    for name in outside:
        file = os.path.abspath(name)
        copy = _copied(Path(file), parts.get(file, (file,)), document, made)
        places[name] = _relative(copy, document.parent)
    return places


def _copied(file: Path, parts: tuple[str, ...], document: Path, made: list[Path]) -> Path:
    """Copy a file and the parts that it names beside a saved scene; return the copy of the file.

    It lies in NAME-files/FOLDER, with a number where other files are: those of the scene saved before stay whole.
    """
    beside = document.with_name(f"{utf8(document.stem)[:60]}-files")  # names have at most 255 bytes
    beneath = [Path(part).relative_to(file.parent) for part in parts if Path(part).is_relative_to(file.parent)]
    for k in itertools.count(1):
        folder = beside / f"{utf8(file.parent.name) or 'files'}{f'-{k}' if k > 1 else ''}"
        pairs = {file.parent / part: folder / part for part in beneath} | {file: folder / utf8(file.name)}
        if all(_may_copy(source, copy) for source, copy in pairs.items()):
            break
    for source, copy in pairs.items():
        if os.path.lexists(copy) or not source.is_file():
            continue
        for parent in reversed(copy.parents):
            if parent.is_relative_to(beside) and not parent.exists():
                parent.mkdir()
                made.append(parent)
        with replacing(copy) as part:
            shutil.copyfile(source, part)
        made.append(copy)
    return pairs[file]


def _may_copy(source: Path, copy: Path) -> bool:
    """Return whether a file may be copied: there is no copy, or this one, or its original has gone."""
    if not os.path.lexists(copy):
        return True
    return copy.is_file() and (not source.is_file() or filecmp.cmp(source, copy, shallow=False))


def _relative(real: Path, folder: Path) -> str:
    """Return the path of a file relative to a folder."""
    try:
        return Path(os.path.relpath(real, folder)).as_posix()
    except ValueError:  # another drive
        return str(real)

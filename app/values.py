"""Values of settings: records, and functions that read the text of an option or raise ArgumentTypeError with its range.

Nothing that imports numpy is imported, so that `--help` stays instant.
"""

from __future__ import annotations

import argparse
import datetime
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gi_core.scene.errors import SceneError
from gi_core.scene.types import CalculationSurface, Camera, LampLevel

if TYPE_CHECKING:
    from gi_core.files.edits import Daylight

LONGEST_SIDE = 16384  # per side of a picture
SCENE_SUFFIXES = (".toml", ".glb", ".gltf", ".obj", ".ply", ".stl")
MOST_ISOLINES = 16  # as in surface.frag
TINIEST, BIGGEST = 1e-15, 1e15  # of other numbers, as in scene files (`gi_core.scene.rules`)


class Pin(NamedTuple):
    """A read-out pinned to a point of a surface."""

    name: str
    position: tuple[float, float, float]  # [m], in the scene, or in the space of `object`
    normal: tuple[float, float, float]  # of the side that is read
    object: str = ""  # a mobile; "": the static part


def _require(holds: object, rule: str, text: str) -> None:
    if not holds:
        raise argparse.ArgumentTypeError(f"must be {rule}, got {text}")


def finite(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a number, got {text}") from None
    _require(abs(value) <= BIGGEST, f"a number of at most {BIGGEST:g}", text)
    return value


def day(text: str) -> int:
    """Return the ordinal of a date."""
    try:
        date = datetime.date.fromisoformat(text)
    except ValueError:
        date = datetime.date.min
    _require(1901 <= date.year <= 2099, "a day from 1901 to 2099 such as 2026-03-21", text)  # the sun's formulas hold
    return date.toordinal()


def _number(rule: str, holds: Callable[[float], bool]) -> Callable[[str], float]:
    """Return the reader of a number that holds to a rule."""

    def read(text: str) -> float:
        value = finite(text)
        _require(holds(value), rule, text)
        return value

    return read


exposure = _number("-64 .. 64 stops", lambda value: abs(value) <= 64)  # beyond, every picture is black or white
positive = _number(f"over 0, from {TINIEST:g} to {BIGGEST:g}", lambda value: value >= TINIEST)
not_negative = _number(f"0, or from {TINIEST:g} to {BIGGEST:g}", lambda value: value == 0 or value >= TINIEST)
percent = _number("in 0.01 .. 100 %", lambda value: 0.01 <= value <= 100)  # paths for less error would take days
maintenance = _number("over 0, at most 1", lambda value: 0 < value <= 1)


def _numbers(text: str, read: Callable[[str], float] = finite) -> tuple[float, ...]:
    """Return numbers with commas between them; () if one is none, or out of range."""
    try:
        return tuple(read(part) for part in text.split(","))
    except argparse.ArgumentTypeError:
        return ()


def whole(most: int, least: int = 1) -> Callable[[str], int]:
    """Return the reader of a whole number, which may be written as 1e5."""

    def read(text: str) -> int:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        _require(least <= value <= most and value == int(value), f"a whole number in {least} .. {most}", text)
        return int(value)

    return read


photons = whole(1 << 27)  # whose sums `gi_core.base.fixed_point` holds
pixel_paths = whole(1 << 16)
neighbours = whole(100_000)
frames = whole(100_000)  # over an hour of film
rate = whole(1000)  # pictures per second: films count milliseconds or more
points = whole(1_000_000)  # receivers at which errors are measured
scale = whole(LONGEST_SIDE)
light_map = whole(LONGEST_SIDE // 2, 16)  # 2 GB at 4,096 texels per side


def seed(text: str) -> int:
    value = int(text)
    _require(0 <= value < 2**63, "in 0 .. 2^63 - 1", text)
    return value


def png(text: str) -> Path:
    fits = Path(text).suffix.lower() == ".png" and Path(text).resolve().parent.is_dir()
    _require(fits, "a .png file in a folder that exists", text)
    return Path(text)


def size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    fits = cross and width.isdecimal() and height.isdecimal() and 0 < int(width) <= LONGEST_SIDE >= int(height) > 0
    _require(fits, f"WIDTHxHEIGHT in pixels, each 1 .. {LONGEST_SIDE}", text)
    return int(width), int(height)


def value_range(text: str) -> tuple[float, float]:
    values = _numbers(text, not_negative)
    _require(len(values) == 2 and values[0] < values[1], f"LOW,HIGH with 0 <= LOW < HIGH, 0 or from {TINIEST:g}", text)
    return values[0], values[1]


def isolines(text: str) -> tuple[float, ...]:
    """Return values of isolines; (): the program chooses them."""
    if text in ("auto", ""):
        return ()
    values = _numbers(text, positive)
    _require(0 < len(values) <= MOST_ISOLINES, f"auto, or up to {MOST_ISOLINES} numbers over 0: E1,E2,...", text)
    return values


def lamp(text: str) -> LampLevel:
    most_level = 1000.0  # level of a lamp, as in `gi_core.lights.lamps`
    name, equals, numbers = text.rpartition("=")
    values = _numbers(numbers, not_negative)
    fits = name and equals and len(values) in (1, 3) and max(values) <= most_level
    _require(fits, f"NAME=LEVEL or NAME=r,g,b, numbers from 0 to {most_level:g}", text)
    return LampLevel(name, values[0]) if len(values) == 1 else LampLevel(name, 1.0, values)  # type: ignore[arg-type]


def watts(text: str) -> tuple[str, float]:
    name, _, number = text.rpartition("=")
    values = _numbers(number, not_negative)
    _require(len(values) == 1, "NAME=W, a power of 0 or more", text)
    return name, values[0]


def pose(text: str) -> tuple[str, tuple[float, ...]]:
    name, equals, numbers = text.rpartition("=")
    values = _numbers(numbers)
    _require(name and equals and len(values) in (3, 7), "NAME=x,y,z or NAME=x,y,z,qw,qx,qy,qz", text)
    return name, values


def _keys(text: str, table: str, example: str, read: Callable[[dict], Any]) -> Any:
    """Return the value that `read` makes of the keys of a table of a scene file, with commas between them."""
    import tomllib

    try:
        return read(tomllib.loads(f"keys = {{{text}}}")["keys"])
    except SceneError as problem:
        raise argparse.ArgumentTypeError(str(problem).removeprefix(f"{table.strip('[]')}: ")) from None
    except tomllib.TOMLDecodeError as problem:
        where = str(problem).partition(" (at ")[0]
        raise argparse.ArgumentTypeError(f"must be keys of {table} such as '{example}', got {text}: {where}") from None


def surface(text: str) -> CalculationSurface:
    """Return the calculation surface of keys of a table [[surface]]."""
    from gi_core.files.formats.toml_file import read_surface

    return _keys(text, "[[surface]]", 'name = "desk", height = 0.75', lambda keys: read_surface(keys, "surface"))


def daylight(text: str) -> Daylight:
    """Return the edit that keys of the table [daylight] make."""
    from gi_core.files.edits import Daylight
    from gi_core.files.formats.toml_fields import Table
    from gi_core.files.formats.toml_file import DAYLIGHT

    def read(keys: dict) -> Daylight:
        _require(keys.keys() <= DAYLIGHT.keys(), f"keys of [daylight], {', '.join(DAYLIGHT)}", text)
        Table(keys, "daylight", {key: DAYLIGHT[key] for key in keys}).fields({})
        return Daylight(tuple((key, tuple(v) if isinstance(v, list) else v) for key, v in keys.items()))

    return _keys(text, "[daylight]", "date = 2026-03-21, hour = 9", read)


def camera(text: str) -> Camera:
    n = _numbers(text)
    fits = len(n) == 7 and n[:3] != n[3:6] and 0 < n[6] < 180
    _require(fits, "x,y,z,tx,ty,tz,fov: eye, another point as target, 0 < fov < 180", text)
    return Camera((n[0], n[1], n[2]), (n[3], n[4], n[5]), n[6])

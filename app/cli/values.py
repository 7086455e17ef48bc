"""Value types of options: each function returns a value or raises ArgumentTypeError with the valid range."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

SCENE_SUFFIXES = (".toml", ".glb", ".gltf", ".obj", ".ply", ".stl")
LEAST_EXPOSURE, MOST_EXPOSURE = -64.0, 64.0  # EV; beyond, every picture is black or white


def finite(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a number, got {text}") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"must be a finite number, got {text}")
    return value


def exposure(text: str) -> float:
    value = finite(text)
    if not LEAST_EXPOSURE <= value <= MOST_EXPOSURE:
        raise argparse.ArgumentTypeError(f"must be {LEAST_EXPOSURE:g} .. {MOST_EXPOSURE:g} stops, got {text}")
    return value


def positive(text: str) -> float:
    value = finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"must be over 0, got {text}")
    return value


def not_negative(text: str) -> float:
    value = finite(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"must be 0 or more, got {text}")
    return value


def positive_int(text: str) -> int:
    value = positive(text)
    if value != int(value):
        raise argparse.ArgumentTypeError(f"must be a whole number, got {text}")
    return int(value)


def seed(text: str) -> int:
    value = int(text)
    if not 0 <= value < 2**63:
        raise argparse.ArgumentTypeError(f"must be in 0 .. 2^63 - 1, got {text}")
    return value


def png(text: str) -> Path:
    if Path(text).suffix.lower() != ".png" or not Path(text).resolve().parent.is_dir():
        raise argparse.ArgumentTypeError(f"must be a .png file in a folder that exists, got {text}")
    return Path(text)


def size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal() and 0 < int(width) <= 16384 >= int(height) > 0):
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT in pixels, each 1 .. 16384, got {text}")
    return int(width), int(height)


def pose(text: str) -> tuple[str, tuple[float, ...]]:
    name, equals, numbers = text.rpartition("=")
    try:
        values = tuple(finite(n) for n in numbers.split(","))
    except argparse.ArgumentTypeError:
        values = ()
    if not (name and equals and len(values) in (3, 7)):
        raise argparse.ArgumentTypeError(f"must be NAME=x,y,z or NAME=x,y,z,qw,qx,qy,qz, got {text}")
    return name, values

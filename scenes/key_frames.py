"""Key frames of the shipped scenes: curves run through at constant speed, and how they get into a scene file."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np


class Loop(NamedTuple):
    """A closed path, its first key again at the end."""

    times: np.ndarray  # (K,) [s]
    positions: np.ndarray  # (K, 3) [m]
    spin: float  # degrees a second


def loop(curve: Callable, keys: int, speed: float, turns: float, decimals: int = 4) -> Loop:
    """Return `keys` steps of equal length along a closed curve.

    curve: angle (n,) [rad] -> points (n, 3), once round in 2 pi; speed [m/s]; turns about `spin_axis` a round.
    """
    fine = curve(2 * np.pi * np.arange(FINE + 1) / FINE)
    length = np.concatenate([[0.0], np.cumsum(_lengths(fine))])
    at = np.interp(np.arange(keys + 1) / keys * length[-1], length, np.arange(FINE + 1))
    positions = np.round(curve(2 * np.pi * at / FINE), decimals) + 0.0
    times = np.concatenate([[0.0], np.cumsum(_lengths(positions))]) / speed
    return Loop(np.round(times, 4), positions, round(360 * turns / float(times[-1]), 6))


def there_and_back(stops, parts: int, speed: float, decimals: int = 4) -> Loop:
    """Return a path through stops (n, 3) to the last of them and back the same way, `parts` keys from stop to stop.

    A uniform Catmull-Rom curve: smooth, through every stop, straight on at both ends. speed [m/s].
    """
    p = np.asarray(stops, np.float64)
    p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    a, b, c, d = (p[k : len(p) - 3 + k, None] for k in range(4))
    u = (np.arange(parts) / parts)[:, None]
    cubic = 2 * b + (c - a) * u + (2 * a - 5 * b + 4 * c - d) * u**2 + (3 * b - a - 3 * c + d) * u**3
    way = np.concatenate([cubic.reshape(-1, 3) / 2, p[-2:-1]])
    way = np.concatenate([way, way[-2::-1]])
    times = np.concatenate([[0.0], np.cumsum(_lengths(way))]) / speed
    return Loop(np.round(times, 3), np.round(way, decimals) + 0.0, 0.0)


FINE = 20_000  # points that the length of a curve is measured with


def _lengths(points):
    d = np.diff(points, axis=0)
    return np.sqrt((d * d).sum(axis=1))


def written(text: str, path: Loop, decimals: int = 4, a_row: int = 4) -> str:
    """Return a scene file's text with times, positions and spin of its last path replaced."""
    start = text.rindex("[mobile.path]")
    head, tail = text[:start], text[start:]
    times = [f"{t:.4f}" for t in path.times]
    rows = [f"[{', '.join(f'{x:.{decimals}f}' for x in p)}]" for p in path.positions]
    tail, n = re.subn(r"(?ms)^times = \[.*?^\]$", f"times = {_listed(times, 12)}", tail, count=1)
    tail, m = re.subn(r"(?ms)^positions = \[.*?^\]$", f"positions = {_listed(rows, a_row)}", tail, count=1)
    tail, k = re.subn(r"(?m)^spin = \S+", f"spin = {path.spin:.6f}", tail, count=1)
    if (n, m, k) != (1, 1, 1):
        raise ValueError("the last path of the scene file needs times, positions and spin to write into")
    return head + tail


def _listed(items: list[str], a_row: int) -> str:
    rows = [", ".join(items[k : k + a_row]) for k in range(0, len(items), a_row)]
    return "[\n" + "".join(f"    {row},\n" for row in rows) + "]"


def write_paths(folder: Path, paths: dict[str, Loop]) -> None:
    """Write paths into the scene files that they are named after."""
    for name, path in paths.items():
        file = folder / name
        file.write_text(written(file.read_text(), path))
        print(f"{file}: {len(path.times)} keys, {path.times[-1]:g} s")

"""Luminaires for tests: an uneven distribution, and writers of IES and EULUMDAT files."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gi_core.lights.photometric import axes, flux_of
from gi_core.scene.types import PhotometricLight

GAMMAS = np.array([0.0, 7.0, 20.0, 31.0, 45.0, 60.0, 90.0, 120.0, 180.0])
PLANES = np.array([0.0, 30.0, 75.0, 120.0, 180.0, 250.0, 300.0, 360.0])


def uneven(seed: int = 1) -> np.ndarray:
    """Return a candela table (P, T) without symmetry, with dark cells; the same for all planes at gamma 0 and 180."""
    values = np.random.default_rng(seed).random((len(PLANES), len(GAMMAS))) * 1000
    values[2:4, 5:7] = 0  # a dark cell
    values[-1], values[:, 0], values[:, -1] = values[0], 500.0, 20.0
    return values


def luminaire(name="luminaire", position=(0.0, 0.0, 0.0), flux=(1.0, 2.0, 0.5), **changes) -> PhotometricLight:
    """Return a luminaire with the uneven table, tilted and turned."""
    light = PhotometricLight(name, position, (0.2, -0.1, -1.0), (1.0, 0.4, 0.0), flux, GAMMAS, PLANES, uneven())
    return light._replace(**changes)


def table_flux(light: PhotometricLight) -> float:
    return flux_of(light.gammas_degrees, light.planes_degrees, light.intensity)


def candela(light: PhotometricLight, directions: np.ndarray) -> np.ndarray:
    """Return candela (n,) in unit directions (n, 3) by bilinear interpolation, written without the kernels."""
    axis, c0 = axes(light)
    x, y, z = directions @ c0, directions @ np.cross(c0, axis), directions @ axis
    gamma, plane = np.degrees(np.arccos(np.clip(z, -1, 1))), np.degrees(np.arctan2(y, x)) % 360
    columns = np.stack([np.interp(gamma, light.gammas_degrees, row, 0, 0) for row in light.intensity])
    j = np.clip(np.searchsorted(light.planes_degrees, plane, "right") - 1, 0, len(light.planes_degrees) - 2)
    w = (plane - light.planes_degrees[j]) / np.diff(light.planes_degrees)[j]
    at = np.arange(len(plane))
    return (1 - w) * columns[j, at] + w * columns[j + 1, at]


def write_ies(
    path: Path, gammas: Sequence[float], planes: Sequence[float], candela: np.ndarray, first="IESNA:LM-63-2002",
    tilt="TILT=NONE", numbers="1 -1 1.0", kind=1, factors="1.0 1.0 50", opening="2 0 0 0",
) -> Path:  # fmt: skip
    """Write an IES file of a table (P, T) [cd]; opening: unit, width, length and height."""
    head = f"{numbers} {len(gammas)} {len(planes)} {kind} {opening}"
    rows = [" ".join(f"{v:.6g}" for v in values) for values in (gammas, planes, *candela)]
    path.write_text("\r\n".join([first, "[TEST] a test", tilt, head, factors, *rows, ""]))
    return path


def write_ldt(
    path: Path, symmetry: int, gammas: Sequence[float], planes: Sequence[float], table: np.ndarray, lumens=2000.0,
    ratio=50.0, factor=1.0, sets=1, opening=(0, 0, 0, 0, 0, 0),
) -> Path:  # fmt: skip
    """Write a EULUMDAT file; planes: all; table (stored planes, T) [cd/klm]; opening: length, width, heights [mm]."""
    head = ["maker", 1, symmetry, len(planes), 0, len(gammas), 0, "report", "name", "number", "file", "date"]
    sizes = [600, 300, 50, *opening, 100, ratio, factor, 0]
    lamps = [1, "LED", lumens, "3000", "80", 40] * sets
    lines = [*head, *sizes, sets, *lamps, *[0.5] * 10, *planes, *gammas, *np.ravel(table)]
    path.write_text("\r\n".join(map(str, lines)) + "\r\n", encoding="latin-1")
    return path

"""Sky lights: domes of luminance by ISO 15469 / CIE S 011. Rays that leave the scene meet the sum of all.

A dome is divided into patches of equal solid angle and of constant radiance each, from which photons, paths, fixed
points and pictures take their light alike. The text of the standard was not at hand: parameters and formulas are
those of S. Darula, R. Kittler, CIE general sky standard defining luminance distributions, eSim 2002.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import dot
from gi_core.base.vectors import unit
from gi_core.geometry.error import luminance
from gi_core.lights.photometric import TABLE
from gi_core.scene.types import OVERCAST_SKY, SUNLESS_SKIES, UNIFORM_SKY, Scene, SkyLight

RECORD = SkyLight
ALTITUDE_OFFSET = 0.3
PATCHES_UP, PATCHES_ROUND = 90, 360  # patches from the horizon up, and around
GRADATIONS = (4.0, -0.70), (1.1, -0.80), (0.0, -1.0), (-1.0, -0.55), (-1.0, -0.32), (-1.0, -0.15)  # a, b
INDICATRICES = (0, -1, 0), (2, -1.5, 0.15), (5, -2.5, 0.30), (10, -3.0, 0.45), (16, -3.0, 0.30), (24, -2.8, 0.15)
TYPES = "11 12 21 22 31 32 33 34 42 43 44 54 55 65 66".split()  # gradation and indicatrix of types 1 to 15


class Sky(NamedTuple):
    """The sum of all sky lights."""

    up: np.ndarray  # (3,) float64 unit
    radiance: np.ndarray  # (3,) float64 [W/m2/sr]; a horizontal plane in the open gets pi times it
    lamp: int
    east: np.ndarray  # (3,) float64 unit, where columns begin
    north: np.ndarray  # (3,) float64 unit, a quarter further
    shape: np.ndarray  # (rows, columns, 3) float64: radiance of each patch over `radiance`

    def seen(self, directions: np.ndarray) -> np.ndarray:
        """Return the radiance (n, 3) in unit directions (n, 3); 0 below the horizon."""
        z = directions @ self.up
        rows, columns = self.shape.shape[:2]
        turn = np.arctan2(directions @ self.north, directions @ self.east) % (2 * math.pi) / (2 * math.pi)
        row = np.clip((z * rows).astype(int), 0, rows - 1)
        light = self.radiance * self.shape[row, np.minimum((turn * columns).astype(int), columns - 1)]
        return np.where((z > 0)[:, None], light, 0.0)


def relative_luminance(cie: int, z: np.ndarray, chi: np.ndarray) -> np.ndarray:
    """Return the luminance (n,) of a sky type in any unit; z: sine of the altitude, chi [rad]: angle from the sun."""
    if cie == OVERCAST_SKY:
        return (1 + 2 * z) / 3
    (a, b), (c, d, e) = (group[int(k) - 1] for group, k in zip((GRADATIONS, INDICATRICES), TYPES[cie - 1], strict=True))
    return (1 + a * np.exp(b / z)) * (1 + c * (np.exp(d * chi) - math.exp(d * math.pi / 2)) + e * np.cos(chi) ** 2)


def patches(light: SkyLight, up: np.ndarray) -> np.ndarray:
    """Return the radiance of each patch (rows, columns) over that of a uniform sky of the same horizontal light."""
    if light.cie == UNIFORM_SKY:
        return np.ones((1, 1))
    east, north = _axes(up)
    z, turn = (np.arange(PATCHES_UP) + 0.5) / PATCHES_UP, 2 * math.pi * (np.arange(PATCHES_ROUND) + 0.5) / PATCHES_ROUND
    if light.cie in SUNLESS_SKIES:
        L = relative_luminance(light.cie, z, np.zeros(PATCHES_UP))[:, None]
    else:
        sun, across = unit(light.sun), np.sqrt(1 - z * z)[:, None]
        level = np.cos(turn) * (sun @ east) + np.sin(turn) * (sun @ north)
        chi = np.arccos(np.clip(z[:, None] * (sun @ up) + across * level, -1, 1))
        L = np.maximum(relative_luminance(light.cie, z[:, None], chi), 0.0)
    return L / (2 * (L.mean(axis=1) * z).mean())


def sky_of(scene: Scene, lamp: int = 0) -> Sky:
    """Return the sum of the sky lights of a scene; radiance 0 without any."""
    return _sum([light for light in scene.lights if isinstance(light, SkyLight)], unit(scene.up), lamp)


def overcast(up: np.ndarray) -> Sky:
    """Return the overcast sky of CIE, type 16, that brings 1 to a horizontal plane in the open; up (3,): unit."""
    return _sum([SkyLight("overcast", (1 / math.pi,) * 3, OVERCAST_SKY)], up, 0)


def _sum(lights: list[SkyLight], up: np.ndarray, lamp: int) -> Sky:
    parts = [(np.array(light.radiance, float), patches(light, up)) for light in lights]
    radiance = sum((L for L, _ in parts), np.zeros(3))
    shape = np.ones((1, 1, 3))
    if any(light.cie != UNIFORM_SKY for light in lights):
        whole = sum(np.broadcast_to(part[:, :, None] * L, (PATCHES_UP, PATCHES_ROUND, 3)) for L, part in parts)
        shape = np.divide(whole, radiance, out=np.ones((PATCHES_UP, PATCHES_ROUND, 3)), where=radiance > 0)
    return Sky(up, radiance, lamp, *_axes(up), shape)


def _axes(up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the axes of `random_numbers.from_frame` beside `up`."""
    basis = np.array(random_numbers.basis(*up))
    return basis[:3], basis[3:]


@inlined
def patch(sky, d, z):
    """Return the row and the column of a unit direction d above the horizon; z: its part along `up`."""
    rows, columns = sky.shape.shape[0], sky.shape.shape[1]
    row, column = min(int(z * rows), rows - 1), 0
    if columns > 1:
        turn = math.atan2(dot(d, sky.north), dot(d, sky.east)) / (2.0 * math.pi)
        column = min(int((turn + 1.0 if turn < 0.0 else turn) * columns), columns - 1)
    return row, column


# Sampling -----------------------------------------------------------------------------------------------------


def table_of(weights: np.ndarray) -> np.ndarray:
    """Return a table (n,) for drawn(), of patches in proportion to weights (rows, columns)."""
    across = np.cumsum(weights, axis=1)
    along = np.cumsum(across[:, -1])
    across = across / np.maximum(across[:, -1:], 1e-300)
    across[:, -1], along = 1.0, along / along[-1]
    return np.concatenate([weights.shape, along, across.ravel()])


@kernel
def drawn(tables, start, s, t):
    """Return sine of the altitude, turn [radians], row and column of a direction; s, t in [0, 1)."""
    rows, columns = int(tables[start]), int(tables[start + 1])
    along = tables[start + 2 : start + 2 + rows]
    row = random_numbers.picked(along, s)
    below = along[row - 1] if row > 0 else 0.0
    across = tables[start + 2 + rows + row * columns : start + 2 + rows + (row + 1) * columns]
    column = random_numbers.picked(across, t)
    before = across[column - 1] if column > 0 else 0.0
    z = (row + min((s - below) / (along[row] - below), 1.0)) / rows
    turn = (column + min((t - before) / (across[column] - before), 1.0)) / columns
    return z, 2.0 * math.pi * turn, row, column


def directions(sky: Sky, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (n, 3) by the sky's luminance, of pairs (n, 2) in [0, 1), and the light of each, (n, 3)."""
    weights = luminance(sky.radiance * sky.shape)
    table, out, light = table_of(weights), [], []
    for s, t in pairs:
        z, turn, row, column = drawn(table, 0, s, t)
        r = math.sqrt(max(1 - z * z, 0.0))
        out.append(random_numbers.from_frame(r * math.cos(turn), r * math.sin(turn), z, *sky.up))
        light.append(sky.radiance * sky.shape[row, column] * (2 * math.pi * weights.mean() / weights[row, column]))
    return np.array(out), np.array(light) / len(pairs)


def low_directions(sky: Sky, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return directions() by the altitude alone, most of them low: the same for any sky, as a window may show any part.

    Their density is in proportion to 1 / (ALTITUDE_OFFSET + sine of the altitude).
    """
    z, turn = ALTITUDE_OFFSET * ((1 + 1 / ALTITUDE_OFFSET) ** pairs[:, 0] - 1), 2 * math.pi * pairs[:, 1]
    r = np.sqrt(1 - z * z)
    local = zip(r * np.cos(turn), r * np.sin(turn), z, strict=True)
    out = np.array([random_numbers.from_frame(*d, *sky.up) for d in local])
    return out, sky.seen(out) * (2 * math.pi * math.log(1 + 1 / ALTITUDE_OFFSET) * (ALTITUDE_OFFSET + z) / len(z))[
        :, None
    ]


def parameters(light: SkyLight, around, table: int) -> list:
    """Return centre (3), up (3), radius [m] of discs around the centre where photons start, type, sun (3), table."""
    return [around.centre, around.up, [around.radius, light.cie], light.sun or (0.0,) * 3, [table]]


def flux(light: SkyLight, around) -> np.ndarray:
    whole = np.array(light.radiance, float) * 2 * math.pi * math.pi * around.radius * around.radius
    return whole * patches(light, around.up).mean()


def value(_light: SkyLight) -> None:
    """Return None: it is no delta light."""


@kernel
def emit(p, tables, u, v, s, t):
    if p[TABLE] < 0.0:
        x, y, z = random_numbers.cone(s, t, 0.0)
    else:
        z, turn, _, _ = drawn(tables, int(p[TABLE]), s, t)
        r = math.sqrt(max(1.0 - z * z, 0.0))
        x, y = r * math.cos(turn), r * math.sin(turn)
    dx, dy, dz = random_numbers.from_frame(-x, -y, -z, p[3], p[4], p[5])
    x, y = random_numbers.disc(u, v)
    ax, ay, az = random_numbers.from_frame(x * p[6], y * p[6], 0.0, dx, dy, dz)
    return (p[0] - dx * p[6] + ax, p[1] - dy * p[6] + ay, p[2] - dz * p[6] + az), (dx, dy, dz)

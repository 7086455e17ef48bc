"""Sky lights: a dome of constant radiance, the overcast sky. Rays that leave the scene meet the sum of all."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.vectors import unit
from gi_core.scene.types import Scene, SkyLight

RECORD = SkyLight


class Sky(NamedTuple):
    """The sum of all sky lights."""

    up: np.ndarray  # (3,) float64 unit
    radiance: np.ndarray  # (3,) float64 [W/m2/sr]
    lamp: int


def sky_of(scene: Scene, lamp: int = 0) -> Sky:
    """Return the sum of the sky lights of a scene; radiance 0 without any."""
    radiance = sum((np.array(s.radiance, float) for s in scene.lights if isinstance(s, SkyLight)), np.zeros(3))
    return Sky(unit(scene.up), radiance, lamp)


def parameters(_light: SkyLight, around, _table: int) -> list:
    """Return centre (3), up (3) and radius [m]: photons start on discs of that size around the centre."""
    return [around.centre, around.up, [around.radius]]


def flux(light: SkyLight, around) -> np.ndarray:
    return np.array(light.radiance, float) * 2 * math.pi * math.pi * around.radius * around.radius


def value(_light: SkyLight) -> None:
    """Return None: it is no delta light."""


@kernel
def emit(p, _tables, u, v, s, t):
    x, y, z = random_numbers.cone(s, t, 0.0)
    dx, dy, dz = random_numbers.from_frame(-x, -y, -z, p[3], p[4], p[5])
    x, y = random_numbers.disc(u, v)
    ax, ay, az = random_numbers.from_frame(x * p[6], y * p[6], 0.0, dx, dy, dz)
    return (p[0] - dx * p[6] + ax, p[1] - dy * p[6] + ay, p[2] - dz * p[6] + az), (dx, dy, dz)

"""Directional lights: parallel light, emitted from a disc that covers what it can reach."""

from __future__ import annotations

import math

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.vec import dot
from gi_core.base.vectors import unit
from gi_core.scene.types import DirectionalLight

RECORD = DirectionalLight


def parameters(light: DirectionalLight, around, _table: int) -> list:
    """Return the disc's centre (3), the direction (3) and the disc's radius [m]."""
    d = unit(light.direction)
    return [around.centre - d * around.radius, d, [around.radius]]


def flux(light: DirectionalLight, around) -> np.ndarray:
    return np.array(light.irradiance, float) * math.pi * around.radius * around.radius


def value(light: DirectionalLight) -> np.ndarray:
    """Return the irradiance on a facing plane (3,) [W/m2]."""
    return np.array(light.irradiance, float)


@kernel
def emit(p, _tables, u, v, _s, _t):
    x, y = random_numbers.disc(u, v)
    ax, ay, az = random_numbers.from_frame(x * p[6], y * p[6], 0.0, p[3], p[4], p[5])
    return (p[0] + ax, p[1] + ay, p[2] + az), (p[3], p[4], p[5])


@kernel
def arrive(p, _tables, _position, normal, far):
    x, y, z = -p[3], -p[4], -p[5]
    return max(0.0, dot((x, y, z), normal)), x, y, z, far

"""Point lights: the same intensity in all directions."""

from __future__ import annotations

import math

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.vec import difference, dot
from gi_core.scene.types import PointLight

RECORD = PointLight


def parameters(light: PointLight, _around, _table: int) -> list:
    """Return position (3)."""
    return [light.position]


def flux(light: PointLight, _around) -> np.ndarray:
    return np.array(light.flux, float)


def value(light: PointLight) -> np.ndarray:
    """Return the intensity (3,) [W/sr]."""
    return np.array(light.flux, float) / (4 * math.pi)


@kernel
def emit(p, _tables, _u, _v, s, t):
    return (p[0], p[1], p[2]), random_numbers.cone(s, t, -1.0)


@kernel
def arrive(p, _tables, position, normal, _far):
    """Return the irradiance per intensity, 1 / d^2 times the cosine, the way to the light and its distance."""
    x, y, z = difference(p, position)
    d2 = dot((x, y, z), (x, y, z))
    if d2 <= 0.0:
        return 0.0, 0.0, 0.0, 1.0, 0.0
    d = math.sqrt(d2)
    x, y, z = x / d, y / d, z / d
    return max(0.0, dot((x, y, z), normal)) / d2, x, y, z, d

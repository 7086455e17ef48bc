"""Spot lights: full intensity inside a cone, a smooth ramp around it."""

from __future__ import annotations

import math

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.vec import dot
from gi_core.base.vectors import unit
from gi_core.lights import point
from gi_core.scene.types import SpotLight

RECORD = SpotLight


def parameters(light: SpotLight, _around, _table: int) -> list:
    """Return position (3), axis (3), cosines of the inner and the outer angle."""
    return [light.position, unit(light.direction), _cosines(light)]


def flux(light: SpotLight, _around) -> np.ndarray:
    return np.array(light.intensity, float) * solid_angle(*_cosines(light))


def value(light: SpotLight) -> np.ndarray:
    """Return the intensity on the axis (3,) [W/sr]."""
    return np.array(light.intensity, float)


def _cosines(light: SpotLight) -> list[float]:
    return [math.cos(math.radians(a)) for a in (light.inner_degrees, light.outer_degrees)]


def solid_angle(cos_inner: float, cos_outer: float) -> float:
    """Return the integral of a spot's falloff over directions [sr]: 2 pi (1 - ci + (ci - co) / 3)."""
    return 2 * math.pi * ((1 - cos_inner) + (cos_inner - cos_outer) / 3)


@kernel
def emit(p, _tables, _u, _v, s, t):
    # The flux inside `inner` is 1 - ci, in the ramp (ci - co) / 3; there cos has density ~ ramp^2.
    inner, ramp = 1.0 - p[6], (p[6] - p[7]) / 3.0
    outwards = s * (inner + ramp)  # flux nearer the axis
    z = 1.0 - outwards
    if outwards > inner:
        z = p[7] + (p[6] - p[7]) * max(0.0, 1.0 - (outwards - inner) / ramp) ** (1.0 / 3.0)
    r = math.sqrt(max(0.0, 1.0 - z * z))
    x, y = r * math.cos(2.0 * math.pi * t), r * math.sin(2.0 * math.pi * t)
    return (p[0], p[1], p[2]), random_numbers.from_frame(x, y, z, p[3], p[4], p[5])


@kernel
def arrive(p, tables, position, normal, far):
    strength, x, y, z, d = point.arrive(p, tables, position, normal, far)
    cosine = -dot((x, y, z), p[3:6])
    ramp = (cosine - p[7]) / max(p[6] - p[7], 1e-12)
    ramp = min(1.0, max(0.0, ramp))
    return strength * (ramp * ramp), x, y, z, d

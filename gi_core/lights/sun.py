"""Directional lights: a distant disc of even radiance. Photons start on a disc that covers the lit part."""

from __future__ import annotations

import math

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import dot
from gi_core.base.vectors import unit
from gi_core.scene.types import DirectionalLight

RECORD = DirectionalLight


def parameters(light: DirectionalLight, around, _table: int) -> list:
    """Return the centre (3) and radius [m] of discs where photons start, the direction (3), and a cosine.

    The cosine is that of half the angle of the light's disc.
    """
    return [around.centre, unit(light.direction), [around.radius, _cosine(light)]]


def _cosine(light: DirectionalLight) -> float:
    return math.cos(math.radians(light.disc_degrees / 2))


def flux(light: DirectionalLight, around) -> np.ndarray:
    return value(light) * math.pi * around.radius * around.radius


def value(light: DirectionalLight) -> np.ndarray:
    """Return the irradiance (3,) [W/m2] of all directions of the disc, each on a plane that faces it."""
    return np.array(light.irradiance, float) / (0.5 + 0.5 * _cosine(light))


@kernel
def towards(p, s, t):
    """Return the unit direction to a point of the disc; s, t in [0, 1)."""
    x, y, z = random_numbers.cone(s, t, p[7])
    return random_numbers.from_frame(x, y, z, -p[3], -p[4], -p[5])


def points(p: np.ndarray, count: int, turn: float) -> np.ndarray:
    """Return unit directions (count, 3) to points of the disc, which lie opposite each other; count 1: to its middle.

    p: parameters of the light; turn: of all points, in [0, 1).
    """
    half = count // 2
    # Along a spiral (Vogel 1979) of half the golden angle, and opposite, so that their mean is the middle.
    spiral = [((k + 0.5) / half, 0.3090169943749474 * k + turn + other) for k in range(half) for other in (0.0, 0.5)]
    return np.array([towards(p, s, t % 1.0) for s, t in spiral or [(0.0, 0.0)]])


@kernel
def emit(p, _tables, u, v, s, t):
    x, y, z = towards(p, s, t)
    dx, dy, dz = -x, -y, -z
    x, y = random_numbers.disc(u, v)
    ax, ay, az = random_numbers.from_frame(x * p[6], y * p[6], 0.0, dx, dy, dz)
    return (p[0] - dx * p[6] + ax, p[1] - dy * p[6] + ay, p[2] - dz * p[6] + az), (dx, dy, dz)


@inlined
def arrive_from(way, normal, far):
    """Return the numbers of arrive(), of a unit direction to the disc."""
    return max(0.0, dot(way, normal)), way[0], way[1], way[2], far


@kernel
def arrive(p, _tables, _position, normal, far):
    return arrive_from((-p[3], -p[4], -p[5]), normal, far)

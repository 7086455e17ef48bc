"""Random numbers as a pure function, and the warps that turn them into points and directions.

No generator state anywhere: photon i bends the same way whatever was traced before it.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.jit import kernel

# Dimensions at emission (bounce 0) ...
POSITION_U, POSITION_V, DIRECTION_U, DIRECTION_V, CHOICE = 1, 2, 3, 4, 5
# ... and at a surface (bounce >= 1).
SURVIVAL, SCATTER_U, SCATTER_V = 0, 1, 2

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio: the best 1-D low-discrepancy step
_A = np.uint64(0xBF58476D1CE4E5B9)
_B = np.uint64(0x94D049BB133111EB)
_C = np.uint64(0xD6E8FEB86659FD93)
_TO_UNIT = 2.0**-53


@kernel
def _mix(z):
    """Finaliser of splitmix64 (Steele, Lea, Flood 2014)."""
    z = (z ^ (z >> np.uint64(30))) * _A
    z = (z ^ (z >> np.uint64(27))) * _B
    return z ^ (z >> np.uint64(31))


@kernel
def uniform(seed, photon, bounce, dimension):
    """Return a float64 in [0, 1) that depends on its four integer arguments only."""
    z = _mix(np.uint64(photon) * _GOLDEN + _mix(np.uint64(seed) + _C))
    z = _mix(z ^ (np.uint64(bounce) * _C + np.uint64(dimension) * _A + _GOLDEN))
    return float(z >> np.uint64(11)) * _TO_UNIT


@kernel
def low_discrepancy(seed, photon):
    """Return frac(shift(seed) + photon / golden ratio): any run of photons covers [0, 1) evenly."""
    z = np.uint64(photon) * _GOLDEN + _mix(np.uint64(seed) + _B)
    return float(z >> np.uint64(11)) * _TO_UNIT


@kernel
def basis(nx, ny, nz):
    """Return two unit vectors that complete a unit normal (Duff et al. 2017)."""
    sign = math.copysign(1.0, nz)
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@kernel
def from_frame(x, y, z, nx, ny, nz):
    """Carry (x, y, z) from the frame whose third axis is the normal to the world."""
    ax, ay, az, bx, by, bz = basis(nx, ny, nz)
    return x * ax + y * bx + z * nx, x * ay + y * by + z * ny, x * az + y * bz + z * nz


@kernel
def disc(u, v):
    """Return a point uniform on the unit disc; pdf 1 / pi."""
    r = math.sqrt(u)
    angle = 2.0 * math.pi * v
    return r * math.cos(angle), r * math.sin(angle)


@kernel
def cosine_hemisphere(u, v):
    """Return a direction about +z with pdf cos(theta) / pi."""
    x, y = disc(u, v)
    return x, y, math.sqrt(max(0.0, 1.0 - u))


@kernel
def cone(u, v, cos_limit):
    """Return a direction about +z, uniform over cos(theta) in [cos_limit, 1]; pdf 1 / (2 pi (1 - cos_limit))."""
    z = 1.0 - u * (1.0 - cos_limit)
    r = math.sqrt(max(0.0, 1.0 - z * z))
    angle = 2.0 * math.pi * v
    return r * math.cos(angle), r * math.sin(angle), z


@kernel
def triangle(u, v):
    """Return barycentric weights of two corners for a point uniform on a triangle; pdf 1 / area."""
    s = math.sqrt(u)
    return s * (1.0 - v), s * v

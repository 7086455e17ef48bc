"""Random numbers as pure functions of integers, and warps to points and directions.

There is no generator state, so photon i does not depend on the photons traced before it. Emission and first bounce of
photon i are point i of an Owen-scrambled Sobol sequence in six dimensions. Later bounces are hashes: stratifying them
was measured to gain next to nothing (docs/decisions/photon-subsets.md).

The paths of a receiver come in sets of 2^m, see stratified(). Within a set, each pair of dimensions is a padded
Owen-scrambled (0, 2)-net (owen_sobol.py). Sets are independent of each other, and so are pairs of dimensions. Each
number is uniform, so means are unbiased. Means of sets are independent, so their variance gives the error.
"""

from __future__ import annotations

import enum
import math

import numpy as np

from gi_core.base import owen_sobol
from gi_core.base.jit import kernel
from gi_core.base.vec import weighted

# Sobol dimensions, two each; the first two are the best stratified pair.
_DIRECTION, _POSITION, _FIRST_BOUNCE = range(0, 6, 2)

_A = np.uint64(0xBF58476D1CE4E5B9)
_B = np.uint64(0x94D049BB133111EB)
_C = np.uint64(0xD6E8FEB86659FD93)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


class Stream(enum.IntEnum):
    """Random numbers independent of those of photons, and of each other, at the same seed; see seed_of()."""

    LIGHT_POINTS = 0x5D17 << 40
    REFERENCE = 0x9E1E << 40
    PILOT = 0x9107 << 24  # of the reference
    ERROR_SAMPLE = 0x5A3B << 40  # of static light
    RADIOSITY = 0x51D3 << 40
    POSES = 0x70E5 << 40
    MOBILES = 0x3B11 << 40
    BRIGHT_FACES = 1 << 39  # of paths from mobiles
    GLOSS = 0x6105 << 40
    PIXELS = 0x917E << 40


def seed_of(stream: int, seed: int) -> int:
    """Return the seed (63 bits) of a stream; stream 0 is that of the seed itself."""
    return (int(seed) ^ stream) & (2**63 - 1)


@kernel
def _mix(z):
    """Finaliser of splitmix64 (Steele, Lea, Flood 2014)."""
    z = (z ^ (z >> np.uint64(30))) * _A
    z = (z ^ (z >> np.uint64(27))) * _B
    return z ^ (z >> np.uint64(31))


@kernel
def hashed(seed, photon, bounce, dimension):
    """Return 64 bits that depend on four integers."""
    z = _mix(np.uint64(photon) * _GOLDEN + _mix(np.uint64(seed) + _C))
    return _mix(z ^ (np.uint64(bounce) * _C + np.uint64(dimension) * _A + _GOLDEN))


@kernel
def independent(seed, photon, bounce, dimension):
    """Return a float64 in [0, 1) that is independent of every other number."""
    return float(hashed(seed, photon, bounce, dimension) >> np.uint64(11)) * (2.0**-53)


@kernel
def _even(seed, photon, dimension):
    """Return two float64 in [0, 1): Sobol dimensions `dimension` and the next of point `photon` < 2^32."""
    key, i = _mix(np.uint64(seed) + _B), np.uint64(photon)
    u = owen_sobol.unit(owen_sobol.coordinate(i, dimension), _mix(key + np.uint64(dimension) * _GOLDEN))
    v = owen_sobol.unit(owen_sobol.coordinate(i, dimension + 1), _mix(key + np.uint64(dimension + 1) * _GOLDEN))
    return u, v


@kernel
def position_numbers(seed, photon):
    """Return the two float64 in [0, 1) that choose a photon's light and its position on the light."""
    return _even(seed, photon, _POSITION)


@kernel
def direction_numbers(seed, photon):
    """Return the two float64 in [0, 1) that choose the direction in which a photon leaves its light."""
    return _even(seed, photon, _DIRECTION)


@kernel
def bounce_numbers(seed, photon, bounce):
    """Return the two float64 in [0, 1) that choose survival and direction at bounce 1, 2, ... of a photon."""
    if bounce == 1:
        return _even(seed, photon, _FIRST_BOUNCE)
    return independent(seed, photon, bounce, 0), independent(seed, photon, bounce, 1)


@kernel
def picked(cdf, u):
    """Return the first index whose cumulative probability, ascending to 1, exceeds u in [0, 1)."""
    low, high = 0, len(cdf) - 1
    while low < high:
        middle = (low + high) >> 1
        if cdf[middle] > u:
            high = middle
        else:
            low = middle + 1
    return low


@kernel
def interval(table, a, b, w, count, x):
    """Return the k of 0 .. count - 2 where x lies between entries k and k + 1 of an ascending table.

    An entry is (1 - w) table[a + k] + w table[b + k].
    """
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if (1.0 - w) * table[a + middle] + w * table[b + middle] <= x:
            low = middle
        else:
            high = middle
    return low


@kernel
def basis(nx, ny, nz):
    """Return two unit vectors that complete a unit normal (Duff et al. 2017)."""
    sign = math.copysign(1.0, nz)
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@kernel
def from_frame(x, y, z, nx, ny, nz):
    """Transform (x, y, z) to the world from the frame whose third axis is the normal."""
    ax, ay, az, bx, by, bz = basis(nx, ny, nz)
    return weighted((x, y, z), (ax, ay, az), (bx, by, bz), (nx, ny, nz))


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


LARGEST_SET = 12  # m of the largest set


@kernel
def stratified(seed, path, vertex, dimension, m):
    """Return a float64 in [0, 1): number `dimension` of a path at one of its vertices.

    Path p belongs to set p >> m. Dimensions 2 j and 2 j + 1 are a pair. m = 0: independent numbers.
    """
    if m == 0:
        return independent(seed, path, vertex, dimension)
    shuffle = hashed(seed, path >> m, vertex, dimension >> 1)
    own = hashed(seed, path >> m, vertex, dimension + (1 << 16))  # apart from all shuffling keys
    # Each pair is shuffled by its own key, so that pairs are independent; then each number is scrambled.
    i = owen_sobol.shuffled(np.uint64(path & ((1 << m) - 1)), shuffle)
    return owen_sobol.unit(owen_sobol.coordinate(i, dimension & 1), own)

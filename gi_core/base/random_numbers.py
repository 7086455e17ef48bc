"""Random numbers as pure functions of integers, and warps to points and directions.

There is no generator state, so photon i does not depend on the photons traced before it. Emission and first bounce of
photon i are point i of an Owen-scrambled Sobol sequence in six dimensions. Later bounces are hashes: stratifying them
was measured to gain next to nothing (docs/decisions/photon-subsets.md).

The paths of a receiver come in sets of 2^m, see stratified(). Within a set, each pair of dimensions is a padded
Owen-scrambled (0, 2)-net. Sets are independent of each other, and so are pairs of dimensions. Each
number is uniform, so means are unbiased. Means of sets are independent, so their variance gives the error.

Each aligned run of 2^m points of the sequence is a stratified set. Direction numbers are those of Joe and Kuo (2008).
Scrambling and shuffling are hashes (Laine and Karras 2011, constants of Vegdahl 2021), so every coordinate of every
point is computed directly (Burley 2020). Coordinates are 32-bit integers with reversed bits, the order that the hash
needs; scrambled() returns floats.
"""

from __future__ import annotations

import enum
import math

import numpy as np

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


DIMENSIONS = 6
MASK = np.uint64(0xFFFFFFFF)
WORD_BITS = 32
_ONE = np.uint64(1)
# Degree of the primitive polynomial, its inner coefficients, first direction numbers: dimensions 2, 3, 4, 5.
_JOE_KUO = ((2, 1, (1, 3)), (3, 1, (1, 3, 1)), (3, 2, (1, 1, 1)), (4, 1, (1, 1, 3, 3)))


def _columns(degree: int, inner: int, first: tuple[int, ...]) -> np.ndarray:
    """Return the generator matrix of one dimension, (32,) uint32: a column per bit of the index, bits reversed."""
    m = list(first)
    for k in range(degree, WORD_BITS):
        m.append(m[k - degree] ^ (m[k - degree] << degree))
        for j in range(1, degree):
            if inner >> (degree - 1 - j) & 1:
                m[k] ^= m[k - j] << j
    return np.array([int(f"{v << (WORD_BITS - 1 - k):032b}"[::-1], 2) for k, v in enumerate(m)], np.uint32)


def _table() -> np.ndarray:
    """Return (4, 8, 16) uint32: the XOR term of each value of each 4-bit group of an index."""
    bits = np.arange(16)[:, None] >> np.arange(4) & 1
    columns = np.array([_columns(*polynomial) for polynomial in _JOE_KUO]).reshape(len(_JOE_KUO), 8, 1, 4)
    return np.bitwise_xor.reduce(np.where(bits, columns, np.uint32(0)), axis=-1).astype(np.uint32)


_ADDED = _table()


@kernel
def sobol(i, dimension):
    """Return coordinate `dimension` of point i, bits reversed; i uint64 < 2^32, dimension < 6."""
    if dimension == 0:
        return i
    if dimension == 1:  # Pascal's triangle modulo 2
        i ^= (i & np.uint64(0xAAAAAAAA)) >> np.uint64(1)
        i ^= (i & np.uint64(0xCCCCCCCC)) >> np.uint64(2)
        i ^= (i & np.uint64(0xF0F0F0F0)) >> np.uint64(4)
        i ^= (i & np.uint64(0xFF00FF00)) >> np.uint64(8)
        return i ^ ((i & np.uint64(0xFFFF0000)) >> np.uint64(16))
    x, four = np.uint64(0), 0
    while i:
        x ^= np.uint64(_ADDED[dimension - 2, four, i & np.uint64(15)])
        i >>= np.uint64(4)
        four += 1
    return x


@kernel
def scrambled(x, key):
    """Return the float64 in [0, 1) of a coordinate with bits reversed, scrambled by a key of 64 random bits."""
    return float(_reversed(_hashed_upwards(x, key & MASK)) ^ (key >> np.uint64(WORD_BITS))) * (2.0**-32)


@kernel
def shuffled(i, key):
    """Return index i < 2^32 permuted by a key; each aligned range of 2^m indices maps to an aligned range."""
    return _reversed(_hashed_upwards(_reversed(i), key & MASK))


@kernel
def _hashed_upwards(x, seed):
    """Flip each of 32 bits by a hash of the lower bits: Owen's permutation tree on reversed bits."""
    x ^= (x * np.uint64(0x3D20ADEA)) & MASK
    x = (x + seed) & MASK
    x = (x * ((seed >> np.uint64(16)) | _ONE)) & MASK
    x ^= (x * np.uint64(0x05526C56)) & MASK
    return x ^ ((x * np.uint64(0x53A22864)) & MASK)


@kernel
def _reversed(x):
    """Return 32 bits in reverse."""
    x = ((x >> np.uint64(1)) & np.uint64(0x55555555)) | ((x & np.uint64(0x55555555)) << np.uint64(1))
    x = ((x >> np.uint64(2)) & np.uint64(0x33333333)) | ((x & np.uint64(0x33333333)) << np.uint64(2))
    x = ((x >> np.uint64(4)) & np.uint64(0x0F0F0F0F)) | ((x & np.uint64(0x0F0F0F0F)) << np.uint64(4))
    x = ((x >> np.uint64(8)) & np.uint64(0x00FF00FF)) | ((x & np.uint64(0x00FF00FF)) << np.uint64(8))
    return ((x >> np.uint64(16)) | (x << np.uint64(16))) & MASK


@kernel
def _even(seed, photon, dimension):
    """Return two float64 in [0, 1): Sobol dimensions `dimension` and the next of point `photon` < 2^32."""
    key, i = _mix(np.uint64(seed) + _B), np.uint64(photon)
    u = scrambled(sobol(i, dimension), _mix(key + np.uint64(dimension) * _GOLDEN))
    v = scrambled(sobol(i, dimension + 1), _mix(key + np.uint64(dimension + 1) * _GOLDEN))
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
    """Return two float64 in [0, 1) that choose survival and direction at bounce 1, 2, ... of a photon."""
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
    i = shuffled(np.uint64(path & ((1 << m) - 1)), shuffle)
    return scrambled(sobol(i, dimension & 1), own)

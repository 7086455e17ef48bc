"""Owen-scrambled Sobol sequence in six dimensions: each aligned run of 2^m points is a stratified set.

Direction numbers are those of Joe and Kuo (2008). Scrambling and shuffling are hashes (Laine and Karras 2011, constants
of Vegdahl 2021), so every coordinate of every point is computed directly (Burley 2020). Coordinates are 32-bit integers
with reversed bits, the order that the hash needs; `unit` returns floats.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel

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
def coordinate(i, dimension):
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
def unit(x, key):
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

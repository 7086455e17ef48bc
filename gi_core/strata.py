"""Even random numbers for the paths of one point: they share the hemisphere and the lamps out between them.

The paths of a point come in sets of 2^m. Within a set each pair of dimensions is a (0, 2)-net under Owen's
scrambling (Owen 1995; by hashing: Burley 2020); sets, and pairs of dimensions, are independent of each other. Every
single number is uniform, so means have no bias; means of sets are independent, so their scatter is the error.
"""

from __future__ import annotations

import numpy as np

from gi_core import sampling
from gi_core.jit import kernel

LARGEST = 12  # m of the largest set
BITS = np.uint64(32)  # of a number: more than a direction needs
PAIRS_APART = 1 << 16  # of dimensions: keeps the scrambling of a number apart from the shuffling of a pair
_MASK = np.uint64(0xFFFFFFFF)
_ONE = np.uint64(1)
_TO_UNIT = 2.0**-32


@kernel
def uniform(seed, path, vertex, dimension, m):
    """Return a float64 in [0, 1): number `dimension` of a path at one of its vertices.

    Path p belongs to set p >> m. Dimensions 2 j and 2 j + 1 are a pair. m = 0: independent numbers.
    """
    if m == 0:
        return sampling.independent(seed, path, vertex, dimension)
    shuffle = sampling.hashed(seed, path >> m, vertex, dimension >> 1)
    own = sampling.hashed(seed, path >> m, vertex, dimension + PAIRS_APART)
    # Shuffled anew for every pair, so that pairs know nothing of each other; then each number is scrambled.
    i = _shuffled(np.uint64(path & ((1 << m) - 1)), np.uint64(m), shuffle)
    x = _second(i) if dimension & 1 else _reversed(i)
    return float(_scrambled(x, own & _MASK) ^ (own >> BITS)) * _TO_UNIT


@kernel
def _shuffled(i, m, seed):
    """Permute 0 .. 2^m - 1: the last bits, which say in which half a number is, by a hash of all the others."""
    return _scrambled(i << (BITS - m), seed & _MASK) >> (BITS - m)


@kernel
def _scrambled(x, seed):
    """Flip each of 32 bits or not, as a hash of the bits above it says: Owen's tree.

    The hash is Laine and Karras's (2011) with the constants of Vegdahl (2021).
    """
    x = _reversed(x)
    x ^= (x * np.uint64(0x3D20ADEA)) & _MASK
    x = (x + seed) & _MASK
    x = (x * ((seed >> np.uint64(16)) | _ONE)) & _MASK
    x ^= (x * np.uint64(0x05526C56)) & _MASK
    x ^= (x * np.uint64(0x53A22864)) & _MASK
    return _reversed(x)


@kernel
def _reversed(x):
    """Return 32 bits in reverse."""
    x = ((x >> np.uint64(1)) & np.uint64(0x55555555)) | ((x & np.uint64(0x55555555)) << np.uint64(1))
    x = ((x >> np.uint64(2)) & np.uint64(0x33333333)) | ((x & np.uint64(0x33333333)) << np.uint64(2))
    x = ((x >> np.uint64(4)) & np.uint64(0x0F0F0F0F)) | ((x & np.uint64(0x0F0F0F0F)) << np.uint64(4))
    x = ((x >> np.uint64(8)) & np.uint64(0x00FF00FF)) | ((x & np.uint64(0x00FF00FF)) << np.uint64(8))
    return ((x >> np.uint64(16)) | (x << np.uint64(16))) & _MASK


@kernel
def _second(i):
    """Return the second number of point i of Sobol's (0, 2)-sequence, in units of 2^-32; the first is _reversed(i)."""
    x, v = np.uint64(0), np.uint64(1 << 31)
    while i:
        if i & _ONE:
            x ^= v
        i >>= _ONE
        v ^= v >> _ONE
    return x

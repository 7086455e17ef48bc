"""Even random numbers for the paths of one point: they share the hemisphere and the lamps out between them.

The paths of a point come in sets of 2^m. Within a set each pair of dimensions is a (0, 2)-net, an Owen-scrambled one
(owen_sobol.py); sets, and pairs of dimensions, are independent of each other. Every single number is uniform, so
means have no bias; means of sets are independent, so their scatter is the error.
"""

from __future__ import annotations

import numpy as np

from gi_core.base import owen_sobol, random_numbers
from gi_core.base.jit import kernel

LARGEST = 12  # m of the largest set
PAIRS_APART = 1 << 16  # of dimensions: keeps the scrambling of a number apart from the shuffling of a pair


@kernel
def uniform(seed, path, vertex, dimension, m):
    """Return a float64 in [0, 1): number `dimension` of a path at one of its vertices.

    Path p belongs to set p >> m. Dimensions 2 j and 2 j + 1 are a pair. m = 0: independent numbers.
    """
    if m == 0:
        return random_numbers.independent(seed, path, vertex, dimension)
    shuffle = random_numbers.hashed(seed, path >> m, vertex, dimension >> 1)
    own = random_numbers.hashed(seed, path >> m, vertex, dimension + PAIRS_APART)
    # Each pair has its own shuffle, so that pairs are independent; then each number is scrambled.
    i = owen_sobol.shuffled(np.uint64(path & ((1 << m) - 1)), shuffle)
    return owen_sobol.unit(owen_sobol.coordinate(i, dimension & 1), own)

"""Stratified random numbers for the paths of one point: padded Owen-scrambled (0, 2)-nets.

The paths of a point come in sets of 2^m. Within a set, each pair of dimensions is an Owen-scrambled (0, 2)-net
(owen_sobol.py). Sets are independent of each other, and so are pairs of dimensions. Each number is uniform, so means
are unbiased. Means of sets are independent, so their variance gives the error.
"""

from __future__ import annotations

import numpy as np

from gi_core.base import owen_sobol, random_numbers
from gi_core.base.jit import kernel

LARGEST_SET = 12  # m of the largest set
PAIRS_APART = 1 << 16  # offset of dimensions that separates the scrambling keys from the shuffling keys


@kernel
def uniform(seed, path, vertex, dimension, m):
    """Return a float64 in [0, 1): number `dimension` of a path at one of its vertices.

    Path p belongs to set p >> m. Dimensions 2 j and 2 j + 1 are a pair. m = 0: independent numbers.
    """
    if m == 0:
        return random_numbers.independent(seed, path, vertex, dimension)
    shuffle = random_numbers.hashed(seed, path >> m, vertex, dimension >> 1)
    own = random_numbers.hashed(seed, path >> m, vertex, dimension + PAIRS_APART)
    # Each pair is shuffled by its own key, so that pairs are independent; then each number is scrambled.
    i = owen_sobol.shuffled(np.uint64(path & ((1 << m) - 1)), shuffle)
    return owen_sobol.unit(owen_sobol.coordinate(i, dimension & 1), own)

"""Bits of a mask: the place of the lowest one, whatever lies above it."""

from __future__ import annotations

import numpy as np

from gi_core.base.bits import lowest_bit


def test_the_lowest_bit_is_found_below_any_others():
    above = np.random.default_rng(0).integers(0, 1 << 32, 32, dtype=np.uint64)
    for k in range(32):
        for bits in (1 << k, (int(above[k]) | 1) << k & 0xFFFFFFFF):
            assert lowest_bit(np.uint32(bits)) == k

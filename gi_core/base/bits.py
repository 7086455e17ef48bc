"""Bits of a mask in kernels."""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined

_DE_BRUIJN = np.uint64(0x077CB531)
_PLACE = np.zeros(32, np.int64)
_PLACE[[(0x077CB531 << k & 0xFFFFFFFF) >> 27 for k in range(32)]] = np.arange(32)


@inlined
def lowest_bit(bits):
    """Return the index of the lowest bit set in a uint32 that is not 0 (Leiserson et al. 1998)."""
    lowest = np.uint64(bits ^ (bits & (bits - np.uint32(1))))
    return _PLACE[(np.uint32(lowest * _DE_BRUIJN)) >> np.uint32(27)]

"""Lists of lines in blocks, each block in one piece of memory, filtered by spheres (report 2.6).

A block holds the x of LANES origins, then their y, ... then low and high, so vector instructions test 16 lines against
one sphere or disc. Lists are padded with fillers: lines that cross nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.bits import lowest_bit
from gi_core.base.jit import allocating, inlined, kernel
from gi_core.base.vec import difference, dot
from gi_core.discs.search.predicate import LANES, LINE_FIELDS, offset, three

_BLOCK = LINE_FIELDS * LANES


class LineLists(NamedTuple):
    """A stack of lists of lines: list h holds count[h] lines from block start[h] on."""

    data: np.ndarray  # (blocks * 128,) float32, in blocks
    number: np.ndarray  # (blocks * LANES,) int32, number of each line
    start: np.ndarray  # (depths,) int64
    count: np.ndarray  # (depths,) int64


@kernel
def load(lines, first, last, lists):
    """Write lines first .. last - 1 into the first blocks; return the largest distance of an origin from 0 [m]."""
    far, data = np.float32(0.0), lists.data
    for k in range(first, last):
        e = k - first
        j = (e // LANES) * _BLOCK + e % LANES
        for c in range(3):
            data[j + c * LANES] = lines.origin[k, c]
            data[j + (3 + c) * LANES] = lines.direction[k, c]
            far = max(far, abs(lines.origin[k, c]))
        data[j + 6 * LANES], data[j + 7 * LANES] = lines.low[k], lines.high[k]
        lists.number[e] = k
    fill_up(data, 0, last - first)
    return far


@kernel
def fill_up(data, block, count):
    """Pad the last block of a list of `count` lines, which begins at `block`, with fillers."""
    for e in range(count, (count + LANES - 1) // LANES * LANES):
        j = (block + e // LANES) * _BLOCK + e % LANES
        for field in range(6):
            data[j + field * LANES] = np.float32(0.0)
        data[j + 6 * LANES], data[j + 7 * LANES] = np.float32(np.inf), np.float32(-np.inf)


@inlined
def _lines_inside(data, block, centre, r2):
    """Return the lines of a block that pass through a sphere, one bit per lane. By nearest points, without branches."""
    base = np.uint64(block) * np.uint64(_BLOCK)
    bits = np.uint32(0)
    for lane in range(np.uint64(LANES)):
        j = base + lane
        a, direction = difference(centre, three(data, j)), three(data, j + np.uint64(3 * LANES))
        t = min(max(dot(a, direction), data[j + np.uint64(6 * LANES)]), data[j + np.uint64(7 * LANES)])
        p = offset(a, t, direction)
        yes = dot(p, p) <= r2
        bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits


@allocating
def push(lists, height, centre, r2):
    """Write the lines of list `height` that pass through a sphere to list height + 1, behind it in the same memory.

    Returns the lists, reallocated if memory was too small. A filler is infinitely far away: the clamp
    leaves t = -inf.
    """
    data, number, start, count = lists
    first, blocks = start[height], (count[height] + LANES - 1) // LANES
    onto, n = first + blocks, 0
    if (onto + blocks) * LANES > len(number):
        data, number = _grown(data, 2 * (onto + blocks) * _BLOCK), _grown(number, 2 * (onto + blocks) * LANES)
    for b in range(first, onto):
        bits = _lines_inside(data, b, centre, r2)
        while bits != 0:
            lane = lowest_bit(bits)
            bits &= bits - np.uint32(1)
            i, j = b * _BLOCK + lane, (onto + n // LANES) * _BLOCK + n % LANES
            for field in range(LINE_FIELDS):
                data[j + field * LANES] = data[i + field * LANES]
            number[onto * LANES + n] = number[b * LANES + lane]
            n += 1
    fill_up(data, onto, n)
    start[height + 1], count[height + 1] = onto, n
    return LineLists(data, number, start, count)


@allocating
def _grown(array, n):
    out = np.empty(n, array.dtype)
    out[: len(array)] = array
    return out

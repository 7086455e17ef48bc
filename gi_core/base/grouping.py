"""What belongs together: rows of integers that are equal, nodes that are linked.

numpy sorts whole numbers twenty times as fast as rows or several keys, so rows are packed into one number each
where they fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gi_core.base.jit import allocating

MOST_BITS = 62  # of a packed row: int64, and one to spare


def order_of(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return the rows (n,) int64 in ascending order of integer columns (n,), the first of most weight; stable."""
    n = len(columns[0])
    packed = _packed(columns, n)
    if packed is None:
        return np.lexsort(tuple(columns)[::-1])
    packed.sort()
    return packed & ((1 << n.bit_length()) - 1)


def group_of(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return for each row (n,) int64 the number of its value among the different rows in ascending order."""
    n = len(columns[0])
    order = order_of(columns)
    fresh = np.zeros(n, bool)
    for column in columns:
        ordered = column[order]
        fresh[1:] |= ordered[1:] != ordered[:-1]
    group = np.empty(n, np.int64)
    group[order] = np.cumsum(fresh)
    return group


def components(pairs: np.ndarray, n: int) -> np.ndarray:
    """Return for each of n nodes (n,) int64 the number of its component, in the order of their first nodes.

    pairs: (m, 2) integers, the nodes that are linked.
    """
    return _components(np.ascontiguousarray(pairs, np.int64), n)


def _packed(columns: Sequence[np.ndarray], n: int) -> np.ndarray | None:
    """Return each row and, in its last bits, its place; None where that is too much for a number."""
    if not n:
        return np.zeros(0, np.int64)
    lows = [int(c.min()) for c in columns]
    bits = [(int(c.max()) - low).bit_length() for c, low in zip(columns, lows, strict=True)]
    if sum(bits) + n.bit_length() > MOST_BITS:
        return None
    packed = np.zeros(n, np.int64)
    for column, low, width in zip(columns, lows, bits, strict=True):
        packed = (packed << width) | (column.astype(np.int64) - low)
    return (packed << n.bit_length()) | np.arange(n)


@allocating
def _components(pairs, n):
    above = np.arange(n)  # a node of the same component with a smaller number, or the node itself
    for k in range(len(pairs)):
        a, b = pairs[k, 0], pairs[k, 1]
        while above[a] != a:
            above[a] = above[above[a]]
            a = above[a]
        while above[b] != b:
            above[b] = above[above[b]]
            b = above[b]
        if a < b:
            above[b] = a
        else:
            above[a] = b
    label = np.empty(n, np.int64)
    count = 0
    for i in range(n):  # what is above a node has its label already
        if above[i] == i:
            label[i] = count
            count += 1
        else:
            label[i] = label[above[i]]
    return label

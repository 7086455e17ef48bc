"""Groups of equal integer rows, and connected components of a graph.

numpy sorts integers twenty times as fast as rows or several keys. Rows are packed into one int64 each where they fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gi_core.base.jit import allocating


def order_of(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return the indices (n,) int64 that sort rows of integer columns (n,); the first column is the primary key.

    The sort is stable.
    """
    n = len(columns[0])
    packed = _packed(columns, n)
    if packed is None:
        return np.lexsort(tuple(columns)[::-1])
    packed.sort()
    return packed & ((1 << n.bit_length()) - 1)


def group_of(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return the rank (n,) int64 of each row among the distinct rows in ascending order; equal rows share a rank."""
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
    """Return the component label (n,) int64 of each of n nodes; labels ascend with the first node of a component.

    pairs: (m, 2) integers, the edges.
    """
    return _components(np.ascontiguousarray(pairs, np.int64), n)


def _packed(columns: Sequence[np.ndarray], n: int) -> np.ndarray | None:
    """Return rows (n,) int64 packed with their index in the low bits; None if a row needs over 62 (one to spare)."""
    if not n:
        return np.zeros(0, np.int64)
    lows = [int(c.min()) for c in columns]
    bits = [(int(c.max()) - low).bit_length() for c, low in zip(columns, lows, strict=True)]
    if sum(bits) + n.bit_length() > 62:
        return None
    packed = np.zeros(n, np.int64)
    for column, low, width in zip(columns, lows, bits, strict=True):
        packed = (packed << width) | (column.astype(np.int64) - low)
    return (packed << n.bit_length()) | np.arange(n)


@allocating
def _components(pairs, n):
    above = np.empty(n, np.int64)  # parent: a smaller node of the same component, or the node itself
    for i in range(n):  # np.arange would take as long to compile as all of this
        above[i] = i
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
    for i in range(n):  # a parent is labelled before its children
        if above[i] == i:
            label[i] = count
            count += 1
        else:
            label[i] = label[above[i]]
    return label

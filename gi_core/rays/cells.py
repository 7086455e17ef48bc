"""Cells that list triangles: the part that grid, octree and binary trees share.

A triangle is listed in every cell that it touches, grown by its padding. The mailbox of a ray keeps it from being
tested twice (Amanatides and Woo 1987), for the last 64 triangles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, inlined, kernel
from gi_core.rays.triangles import (
    CELLS,
    MAILBOX,
    MAILBOX_SIZE,
    TESTS,
    Meshes,
    Triangles,
    nearer,
    touches,
    triangles_of,
)

MOST_LISTED = 64  # entries of all cells per triangle: no node is divided after that
LEVELS = 20  # of binary nodes beside 1.3 log2 of the triangles; Havran 2000 has 8, for cuts by surface area
REPEATED = 1.8  # entries of a node's children per entry of the node: with more of them it is not divided
MIDDLE, MEDIAN = 0, 1  # where a binary node is divided: its middle, or the median of the centres of its triangles


class Cells(NamedTuple):
    """Triangles by cell, of all objects."""

    triangles: Triangles
    first: np.ndarray  # (cells + 1,) int64
    listed: np.ndarray  # (entries,) int32, rows of triangles.corners
    low: np.ndarray  # (objects, 3) float64, box of all cells of an object [m]
    high: np.ndarray  # (objects, 3) float64


class Tree(NamedTuple):
    """Cells as leaves of a tree. The children of a node follow each other."""

    cells: Cells
    child: np.ndarray  # (nodes,) int32, first child; ~cell for a leaf
    axis: np.ndarray  # (nodes,) int32, of the plane that divides a binary node
    plane: np.ndarray  # (nodes,) float64
    root: np.ndarray  # (objects,) int64


def boxes_of(triangles: Triangles) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners low and high (objects, 3) float64 of boxes that hold the padded triangles of each object."""
    low, high = np.zeros((2, len(triangles.padding), 3))
    for o, (a, b) in enumerate(zip(triangles.first[:-1], triangles.first[1:], strict=True)):
        if a < b:
            points = triangles.corners[a:b].reshape(-1, 3)
            low[o] = points.min(axis=0) - 2 * triangles.padding[o]
            high[o] = points.max(axis=0) + 2 * triangles.padding[o]
    return low, high


@inlined
def start(ray):
    """Empty the mailbox of a ray."""
    words = ray.view(np.int32)
    for k in range(MAILBOX_SIZE):
        words[MAILBOX + k] = -1


@inlined
def visit(cells, o, cell, ray, r, best, found):
    """Return distance and face of the nearest hit in a cell, or of the best found yet."""
    words = ray.view(np.int32)
    words[CELLS] += 1
    for i in range(cells.first[cell], cells.first[cell + 1]):
        k = cells.listed[i]
        if words[MAILBOX + (k & (MAILBOX_SIZE - 1))] != k:
            words[MAILBOX + (k & (MAILBOX_SIZE - 1))] = k
            words[TESTS] += 1
            best, found = nearer(cells.triangles.corners, k, k - cells.triangles.first[o], r, best, found)
    return best, found


@inlined
def clip(cells, o, x, y, z, ix, iy, iz):
    """Return the distances where a line, given with inverse directions, enters and leaves the box of object o."""
    low, high = cells.low, cells.high
    ax, bx = (low[o, 0] - x) * ix, (high[o, 0] - x) * ix
    ay, by = (low[o, 1] - y) * iy, (high[o, 1] - y) * iy
    az, bz = (low[o, 2] - z) * iz, (high[o, 2] - z) * iz
    return max(min(ax, bx), max(min(ay, by), min(az, bz))), min(max(ax, bx), min(max(ay, by), max(az, bz)))


def build_tree(meshes: Meshes, leaf: float, ways: int, rule: int = MIDDLE) -> Tree:
    """Return the tree of all objects; nodes of more than `leaf` triangles are divided into `ways` (2 or 8) children."""
    triangles = triangles_of(meshes)
    low, high = boxes_of(triangles)
    parts, roots, nodes, cells, entries = [], [], 0, 0, 0
    for o, (a, b) in enumerate(zip(triangles.first[:-1], triangles.first[1:], strict=True)):
        deepest = 1 + (LEVELS + 1.3 * math.log2(max(b - a, 1))) / math.log2(ways)
        child, axis, plane, first, listed = _divide(
            triangles.corners, a, b, triangles.padding[o], low[o], high[o], leaf, int(deepest), ways, rule
        )
        parts.append((np.where(child >= 0, child + nodes, child - cells), axis, plane, first[:-1] + entries, listed))
        roots.append(nodes)
        nodes, cells, entries = nodes + len(child), cells + len(first) - 1, entries + len(listed)
    child, axis, plane, first, listed = (np.concatenate(p) for p in zip(*parts, strict=True))
    every = Cells(triangles, np.append(first, entries), listed, low, high)
    return Tree(every, child.astype(np.int32), axis, plane, np.array(roots))


@inlined
def _child_box(low, high, ways, axis, plane, c, box):
    """Write the box of child c of a node, low and high (6,). Bits 4, 2, 1 of an octree's c are x, y, z."""
    for k in range(3):
        box[k], box[3 + k] = low[k], high[k]
        if ways == 8:
            upper, at, cut = c >> (2 - k) & 1, 0.5 * (low[k] + high[k]), True
        else:
            upper, at, cut = c, plane, k == axis
        if cut and upper == 1:
            box[k] = at
        elif cut:
            box[3 + k] = at


@kernel
def _median(corners, items, axis, values):
    """Return the median of the centres of triangles along an axis; values: buffer."""
    for i in range(len(items)):
        k = items[i]
        values[i] = (
            min(corners[k, axis], min(corners[k, 3 + axis], corners[k, 6 + axis]))
            + max(corners[k, axis], max(corners[k, 3 + axis], corners[k, 6 + axis]))
        ) * 0.5
    a, b, middle = 0, len(items) - 1, len(items) // 2
    while a < b:  # Hoare's selection
        pivot, i, j = values[(a + b) // 2], a, b
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if middle <= j:
            b = j
        elif middle >= i:
            a = i
        else:
            break
    return np.float64(values[middle])


@inlined
def _room(a, size):
    """Return an array of at least `size` rows that begins like a."""
    b = a
    if size > len(a):
        b = np.empty((max(2 * len(a), size), *a.shape[1:]), a.dtype)
        b[: len(a)] = a
    return b


@allocating
def _divide(corners, a, b, padding, low, high, leaf, deepest, ways, rule):
    """Return child, axis, plane, first and listed of a tree over triangles a .. b - 1 in the box low .. high.

    The root of an octree is always divided.
    """
    count, nodes, cells, entries, top = b - a, 1, 0, 0, 1
    pool, values = np.arange(a, b).astype(np.int32), np.empty(count, np.float32)
    child, axes, planes = np.empty(64, np.int32), np.zeros(64, np.int32), np.zeros(64)
    first, listed = np.empty(64, np.int64), np.empty(64, np.int32)
    work, boxes = np.empty((ways * (deepest + 1), 4), np.int64), np.empty((ways * (deepest + 1), 6))
    box, own, ends = np.empty(6), np.empty(6), np.empty(ways + 1, np.int64)
    work[0] = np.array([0, count, 0, 0])
    boxes[0, :3], boxes[0, 3:] = low, high
    while top:
        top -= 1
        begin, end, depth, node = work[top, 0], work[top, 1], work[top, 2], work[top, 3]
        own[:] = boxes[top]
        n, divided, axis, plane = end - begin, False, 0, 0.0
        if (n > leaf and depth < deepest and entries < MOST_LISTED * count) or (ways == 8 and depth == 0):
            for k in range(1, 3):
                if own[3 + k] - own[k] > own[3 + axis] - own[axis]:
                    axis = k
            plane = 0.5 * (own[axis] + own[3 + axis])
            if rule == MEDIAN:
                median = _median(corners, pool[begin:end], axis, values)
                if own[axis] < median < own[3 + axis]:
                    plane = median
            ends[0] = end
            for c in range(ways):
                _child_box(own[:3], own[3:], ways, axis, plane, c, box)
                tail = ends[c]
                pool = _room(pool, tail + n)
                for i in range(begin, end):
                    if touches(corners, pool[i], padding, box[0], box[1], box[2], box[3], box[4], box[5]):
                        pool[tail] = pool[i]
                        tail += 1
                ends[c + 1] = tail
            divided = ends[ways] - end <= REPEATED ** math.log2(ways) * n or (ways == 8 and depth == 0)
        if not divided:
            first, listed = _room(first, cells + 2), _room(listed, entries + n)
            first[cells] = entries
            listed[entries : entries + n] = pool[begin:end]
            child[node] = ~cells
            cells, entries = cells + 1, entries + n
            continue
        pool[begin : begin + ends[ways] - end] = pool[end : ends[ways]].copy()
        child, axes, planes = _room(child, nodes + ways), _room(axes, nodes + ways), _room(planes, nodes + ways)
        child[node], axes[node], planes[node] = nodes, axis, plane
        for c in range(ways):
            work[top, 0], work[top, 1] = begin + ends[c] - end, begin + ends[c + 1] - end
            work[top, 2], work[top, 3] = depth + 1, nodes + c
            _child_box(own[:3], own[3:], ways, axis, plane, c, boxes[top])
            top += 1
        nodes += ways
    first[cells] = entries
    return child[:nodes], axes[:nodes], planes[:nodes], first[: cells + 1], listed[:entries]

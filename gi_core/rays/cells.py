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
    test_ray,
    touches,
    triangles_of,
)

MOST_LISTED = 16  # entries per triangle of all cells and undivided nodes: nothing is divided after that
BINS = 16  # of a node, per axis, between planes whose costs are compared
HALVED, BY_COST = range(2)  # the plane of a binary node: the middle of its longest axis, or that of the least cost


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
def enter_box(cells, o, ray, ox, oy, oz, dx, dy, dz, limit):
    """Return the TestRay of a ray, where it enters and leaves the box of object o, and best and found of no hit.

    Empties the mailbox of the ray. It enters behind where it leaves if it misses the box within the limit.
    """
    r, best = test_ray(cells.triangles, o, ox, oy, oz, dx, dy, dz), np.float64(limit)
    low, high, words = cells.low, cells.high, ray.view(np.int32)
    ax, bx = (low[o, 0] - r.x) * r.ix, (high[o, 0] - r.x) * r.ix
    ay, by = (low[o, 1] - r.y) * r.iy, (high[o, 1] - r.y) * r.iy
    az, bz = (low[o, 2] - r.z) * r.iz, (high[o, 2] - r.z) * r.iz
    enter = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), 0.0))
    leave = min(min(max(ax, bx), max(ay, by)), min(max(az, bz), best))
    for k in range(MAILBOX_SIZE):
        words[MAILBOX + k] = -1
    return r, enter, leave, best, -1


@inlined
def visit(cells, o, cell, ray, r, best, best_face):
    """Return distance and face of the nearest hit in a cell, or of the best found yet."""
    words = ray.view(np.int32)
    words[CELLS] += 1
    for i in range(cells.first[cell], cells.first[cell + 1]):
        k = cells.listed[i]
        if words[MAILBOX + (k & (MAILBOX_SIZE - 1))] != k:
            words[MAILBOX + (k & (MAILBOX_SIZE - 1))] = k
            words[TESTS] += 1
            best, best_face = nearer(cells.triangles.corners, k, k - cells.triangles.first[o], r, best, best_face)
    return best, best_face


def build_tree(meshes: Meshes, leaf: float, ways: int, rule: int = HALVED) -> Tree:
    """Return the tree of all objects; nodes of more than `leaf` triangles are divided into `ways` (2 or 8) children."""
    triangles = triangles_of(meshes)
    low, high = boxes_of(triangles)
    parts, roots, nodes, cells, entries = [], [], 0, 0, 0
    for o, (a, b) in enumerate(zip(triangles.first[:-1], triangles.first[1:], strict=True)):
        # 20 levels of binary nodes beside 1.3 log2 of the triangles; Havran 2000 has 8, for cuts by surface area
        deepest = 1 + (20 + 1.3 * math.log2(max(b - a, 1))) / math.log2(ways)
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


@inlined
def _longest(own):
    """Return the longest axis of a box."""
    axis = 0
    for k in range(1, 3):
        if own[3 + k] - own[k] > own[3 + axis] - own[axis]:
            axis = k
    return axis


@inlined
def _bin(off, width):
    return np.int64(min(max(BINS * off / width, 0.0), BINS - 1.0))


@kernel
def _cheapest(corners, items, own, begun, ended):
    """Return axis and position of the plane of least cost by surface area, of BINS - 1 per axis of the box `own`.

    MacDonald and Booth 1990, "Heuristics for ray tracing using space subdivision". begun, ended: buffers (BINS,).
    """
    least, axis = np.inf, _longest(own)
    plane = 0.5 * (own[axis] + own[3 + axis])
    for k in range(3):
        low, width = own[k], own[3 + k] - own[k]
        x, y = own[3 + (k + 1) % 3] - own[(k + 1) % 3], own[3 + (k + 2) % 3] - own[(k + 2) % 3]
        if not width > 0.0:
            continue
        begun[:] = 0
        ended[:] = 0
        for i in range(len(items)):
            p, q, r = corners[items[i], k], corners[items[i], 3 + k], corners[items[i], 6 + k]
            begun[_bin(min(p, min(q, r)) - low, width)] += 1
            ended[_bin(max(p, max(q, r)) - low, width)] += 1
        below, above = 0, len(items)
        for j in range(1, BINS):
            below, above, depth = below + begun[j - 1], above - ended[j - 1], width * j / BINS
            cost = below * (x * y + depth * (x + y)) + above * (x * y + (width - depth) * (x + y))
            if cost < least:
                axis, plane, least = k, low + depth, cost
    return axis, plane


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

    Nodes are divided level by level: a limit of entries ends all of them at one depth. The root of an octree is always
    divided.
    """
    count, nodes, cells, entries = b - a, 1, 0, 0
    child, axes, planes = np.empty(64, np.int32), np.zeros(64, np.int32), np.zeros(64)
    first, listed, bins = np.empty(64, np.int64), np.empty(64, np.int32), np.empty((2, BINS), np.int64)
    # Of the nodes of a level: triangles, where those of a node end, boxes.
    items, ends, boxes = np.arange(a, b).astype(np.int32), np.array([count]), np.empty((1, 6))
    boxes[0, :3], boxes[0, 3:] = low, high
    node, depth = 0, 0
    while len(boxes):
        below, below_ends = np.empty(2 * len(items), np.int32), np.empty(ways * len(boxes), np.int64)
        below_boxes, begin, tail, children = np.empty((ways * len(boxes), 6)), 0, 0, 0
        goes_on = depth < deepest and entries + len(items) < MOST_LISTED * count
        for m in range(len(boxes)):
            own, end, start, divided, axis, plane = boxes[m], ends[m], tail, False, 0, 0.0
            n, always = end - begin, ways == 8 and depth == 0
            if (n > leaf and goes_on) or always:
                if ways == 2:
                    axis = _longest(own)
                    plane = 0.5 * (own[axis] + own[3 + axis])
                    if rule == BY_COST:
                        axis, plane = _cheapest(corners, items[begin:end], own, bins[0], bins[1])
                below = _room(below, start + ways * n)
                for c in range(ways):
                    box = below_boxes[children + c]
                    _child_box(own[:3], own[3:], ways, axis, plane, c, box)
                    for i in range(begin, end):
                        if touches(corners, items[i], padding, box[0], box[1], box[2], box[3], box[4], box[5]):
                            below[tail] = items[i]
                            tail += 1
                    below_ends[children + c] = tail
                # Children hold at most 1.8 times the entries of a node that is divided.
                divided = always or tail - start <= 1.8 ** math.log2(ways) * n
            if divided:
                child, axes, planes = _room(child, nodes + ways), _room(axes, nodes + ways), _room(planes, nodes + ways)
                child[node], axes[node], planes[node] = nodes, axis, plane
                nodes, children = nodes + ways, children + ways
            else:
                tail = start
                first, listed = _room(first, cells + 2), _room(listed, entries + n)
                first[cells] = entries
                listed[entries : entries + n] = items[begin:end]
                child[node] = ~cells
                cells, entries = cells + 1, entries + n
            node, begin = node + 1, end
        items, ends, boxes, depth = below[:tail], below_ends[:children], below_boxes[:children], depth + 1
    first[cells] = entries
    return child[:nodes], axes[:nodes], planes[:nodes], first[: cells + 1], listed[:entries]

"""Bounding volume hierarchy of four children per node, built by the binned surface area heuristic (Wald 2007).

The program's own structure where Embree cannot be had. Boxes are float32; their intervals are widened by the bound of
Ize 2013 ("Robust BVH ray traversal"), so that none is missed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.rays.triangles import CELLS, STACK, TESTS, Meshes, Triangles, nearer, test_ray, triangles_of

BINS = 16
DEEPEST = 40  # nodes below this depth are halved by count: 24 levels more hold 16 million leaves
WIDER = np.float32(1 + 1e-6)  # twice the bound of 3 float32 roundings, 3.6e-7
CHILD = 24  # int32 words of a node from here on: its children


class Bvh(NamedTuple):
    """Nodes of all objects; triangles in the order of leaves.

    A node has the low x of its four children, then their low y, low z, high x, high y, high z. Int32 words follow: the
    row of a child, or ~(16 first triangle + triangles) of a leaf.
    """

    triangles: Triangles
    face: np.ndarray  # (T,) int32, of the object
    nodes: np.ndarray  # (n, 28) float32
    root: np.ndarray  # (objects,) int64


def build(meshes: Meshes, leaf: int = 4) -> Bvh:
    """Return the structure of all objects, with at most `leaf` triangles per leaf: 1 to 15, its word has 4 bits."""
    triangles = triangles_of(meshes)
    order, nodes, root, rows = np.empty(len(triangles.corners), np.int64), [], [], 0
    for o, (a, b) in enumerate(zip(triangles.first[:-1], triangles.first[1:], strict=True)):
        corners, pad = triangles.corners[a:b].reshape(-1, 3, 3), np.float32(triangles.padding[o])
        boxes = np.concatenate([corners.min(axis=1) - pad, corners.max(axis=1) + pad], axis=1)
        order[a:b] = np.arange(b - a)
        own, work = np.empty((b - a + 1, CHILD + 4), np.float32), np.empty((3 * (DEEPEST + 32), 5), np.int64)
        parts, around = np.empty((4, 4), np.int64), np.empty((4, 6), np.float32)
        bins = np.empty((3, BINS, 7), np.float32)
        count = _build(boxes, order[a:b], a, own, own.view(np.int32), rows, leaf, work, parts, around, bins)
        nodes.append(own[:count])
        root.append(rows)
        rows += count
    corners = triangles.corners[order + np.repeat(triangles.first[:-1], np.diff(triangles.first))]
    return Bvh(triangles._replace(corners=corners), order.astype(np.int32), np.concatenate(nodes), np.array(root))


@inlined
def _empty(box):
    box[0] = box[1] = box[2] = np.float32(np.inf)
    box[3] = box[4] = box[5] = np.float32(-np.inf)


@inlined
def _grow(box, other):
    for k in range(3):
        box[k], box[3 + k] = min(box[k], other[k]), max(box[3 + k], other[3 + k])


@inlined
def _half_area(box):
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x if x >= 0.0 else np.float32(0.0)


@inlined
def _enclose(box, boxes, order, a, b):
    """Write the box around the triangles order[a:b]."""
    _empty(box)
    for k in range(a, b):
        _grow(box, boxes[order[k]])


@kernel
def _build(boxes, order, first, nodes, words, rows, leaf, work, parts, around, bins):
    """Fill the nodes of one object, whose triangles begin at `first` and nodes at `rows`; return their number.

    Sorts `order`. work: stack of (begin, end, depth, parent, child); parts, around: ranges and boxes of a node's
    children; bins: of _split().
    """
    work[0, 0], work[0, 1], work[0, 2], work[0, 3] = 0, len(order), 0, -1
    top, count = 1, 0
    while top:
        top -= 1
        if work[top, 3] >= 0:
            words[work[top, 3], CHILD + work[top, 4]] = rows + count
        parts[0, 0], parts[0, 1], parts[0, 2], parts[0, 3] = work[top, 0], work[top, 1], work[top, 2], 0
        _enclose(around[0], boxes, order, parts[0, 0], parts[0, 1])
        n = 1
        while n < 4:  # split the part of the largest area that can be split
            p = -1
            for k in range(n):
                if parts[k, 3] == 0 and (p < 0 or _half_area(around[k]) > _half_area(around[p])):
                    p = k
            if p < 0:
                break
            middle = _split(boxes, order, parts[p, 0], parts[p, 1], parts[p, 2], leaf, bins)
            parts[p, 3] = middle < 0
            if middle >= 0:
                parts[p, 2] += 1
                parts[n, 0], parts[n, 1], parts[n, 2], parts[n, 3] = middle, parts[p, 1], parts[p, 2], 0
                parts[p, 1] = middle
                _enclose(around[p], boxes, order, parts[p, 0], middle)
                _enclose(around[n], boxes, order, middle, parts[n, 1])
                n += 1
        for k in range(n, 4):
            _empty(around[k])
            words[count, CHILD + k] = -1
        for k in range(n):
            a, b = parts[k, 0], parts[k, 1]
            if parts[k, 3] or b - a <= 1:
                words[count, CHILD + k] = ~(16 * (first + a) + b - a)
            else:
                work[top, 0], work[top, 1], work[top, 2], work[top, 3], work[top, 4] = a, b, parts[k, 2], count, k
                top += 1
        for k in range(4):
            for i in range(6):
                nodes[count, 4 * i + k] = around[k, i]
        count += 1
    return count


@inlined
def _centre(box, axis):
    return np.float32(0.5) * (box[axis] + box[axis + 3])


@inlined
def _bin(box, axis, centres):
    """Return the bin of a box, which divides the extent of all centres along an axis."""
    scale = np.float32(BINS * (1 - 1e-6)) / (centres[3 + axis] - centres[axis])
    return min(np.int64((_centre(box, axis) - centres[axis]) * scale), BINS - 1)


@kernel
def _split(boxes, order, a, b, depth, leaf, bins):
    """Sort order[a:b] into two parts and return where the second begins; -1: a leaf. bins: (3, BINS, 7), a buffer."""
    if b - a <= 1:
        return -1
    left, right, centres = bins[0], bins[1], bins[2, 0]
    _empty(centres)
    for k in range(a, b):
        for i in range(3):
            c = _centre(boxes[order[k]], i)
            centres[i], centres[3 + i] = min(centres[i], c), max(centres[3 + i], c)
    best, axis, cut, area = np.float32(np.inf), -1, -1, np.float32(0.0)
    for x in range(3):
        if not (centres[3 + x] - centres[x] > 1e-30 and depth < DEEPEST):  # its inverse is finite
            continue
        for i in range(BINS):
            _empty(left[i])
            left[i, 6] = 0
        for k in range(a, b):
            box = boxes[order[k]]
            i = _bin(box, x, centres)
            _grow(left[i], box)
            left[i, 6] += np.float32(1)
        for i in range(BINS - 1, 0, -1):  # right[i]: all bins from i on
            _empty(right[i])
            _grow(right[i], left[i])
            right[i, 6] = left[i, 6]
            if i < BINS - 1:
                _grow(right[i], right[i + 1])
                right[i, 6] += right[i + 1, 6]
        for i in range(1, BINS):  # left[i]: all bins up to i
            n = left[i - 1, 6], right[i, 6]
            if n[0] > 0 and n[1] > 0:
                cost = n[0] * _half_area(left[i - 1]) + n[1] * _half_area(right[i])
                if cost < best:
                    best, axis, cut = cost, x, i
            _grow(left[i], left[i - 1])
            left[i, 6] += left[i - 1, 6]
        area = _half_area(left[BINS - 1])
    if axis < 0:
        return -1 if b - a <= leaf else a + (b - a) // 2
    if b - a <= leaf and (b - a - 1.0) * area <= best:  # entering a node costs one triangle test
        return -1
    i, j = a, b - 1
    while i <= j:
        if _bin(boxes[order[i]], axis, centres) < cut:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i


@kernel
def _entries(nodes, row, near, origin, inverse, far, ray):
    """Write the distances where a ray enters the four boxes of a node, and return the bits of those that it does.

    near: first words of the near planes; origin, inverse: three float32 each; far: float32; ray: of the ray, 4 float32
    at STACK - 4. Without a branch, so that LLVM vectorises it: by hand it is 1.12 to 1.18 times as fast.
    """
    hits, (x, y, z), (ox, oy, oz), (ix, iy, iz) = np.int32(0), near, origin, inverse
    for k in range(np.uint64(4)):
        ex, lx = (nodes[row, np.uint64(x) + k] - ox) * ix, (nodes[row, np.uint64(12 - x) + k] - ox) * ix * WIDER
        ey, ly = (nodes[row, np.uint64(y) + k] - oy) * iy, (nodes[row, np.uint64(20 - y) + k] - oy) * iy * WIDER
        ez, lz = (nodes[row, np.uint64(z) + k] - oz) * iz, (nodes[row, np.uint64(28 - z) + k] - oz) * iz * WIDER
        enter = ex if ex > np.float32(0.0) else np.float32(0.0)
        enter = ey if ey > enter else enter
        enter = ez if ez > enter else enter
        leave = lx if lx < far else far
        leave = ly if ly < leave else leave
        leave = lz if lz < leave else leave
        ray[np.uint64(STACK - 4) + k] = enter
        hits = np.int32(hits | (np.int32(enter <= leave) << np.int32(k)))
    return hits


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    nodes, corners, face = s.nodes, s.triangles.corners, s.face
    children, words, stack = nodes.view(np.int32), ray.view(np.int32), ray.view(np.int64)
    r, origin = test_ray(s.triangles, o, ox, oy, oz, dx, dy, dz), (np.float32(ox), np.float32(oy), np.float32(oz))
    ix, iy, iz = np.float32(r.ix), np.float32(r.iy), np.float32(r.iz)
    near = (0 if ix > 0 else 12, 4 if iy > 0 else 16, 8 if iz > 0 else 20)
    best, best_face, node = np.float64(limit), -1, s.root[o]
    far = np.float32(limit) * WIDER
    bottom = STACK // 2
    top = bottom
    entered = tested = 0
    while True:
        if node >= 0:
            entered += 1
            hits = _entries(nodes, node, near, origin, (ix, iy, iz), far, ray)
            if any_hit:
                for k in range(4):
                    stack[top] = children[node, CHILD + k]
                    top += hits >> k & 1
            else:
                begin = top
                k = 0
                while hits:
                    if hits & 1:
                        entry = np.int64(words[STACK - 4 + k]) << 32 | np.int64(children[node, CHILD + k]) & 0xFFFFFFFF
                        j = top
                        while j > begin and stack[j - 1] < entry:
                            stack[j] = stack[j - 1]
                            j -= 1
                        stack[j] = entry
                        top += 1
                    hits >>= 1
                    k += 1
        else:
            first = ~node >> 4
            for k in range(first, first + (~node & 15)):
                tested += 1
                best, best_face = nearer(corners, k, face[k], r, best, best_face)
            far = np.float32(best) * WIDER
            if any_hit and best_face >= 0:
                break
        while top > bottom:
            top -= 1
            if any_hit or ray[2 * top + 1] <= far:
                break
        else:
            break
        node = np.int64(words[2 * top])
    words[CELLS] += entered
    words[TESTS] += tested
    return np.float32(best), np.int32(best_face)

"""Octree with the parametric traversal of Revelles, Urena and Lastra 2000, "An efficient parametric algorithm".

Departures: a stack replaces recursion; directions of 0 count as 1e-20; the first child of a node is the one that holds
the origin, if it lies in the node.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.rays.cells import Tree, build_tree, enter_box, visit
from gi_core.rays.triangles import STACK, Meshes

NODE_FIELDS = 8  # float64 of a node on the stack: three distances in, three out, node, next child
ENDED = 8.0  # after the last child


class Octree(Tree):
    """Eight children per node; the bits of their numbers are x, y, z: 4, 2, 1."""


def build(meshes: Meshes, leaf: float = 8) -> Octree:
    """Return the structure of all objects; cells of more than `leaf` triangles are divided."""
    return Octree(*build_tree(meshes, leaf, 8))


@inlined
def _push(stack, at, x0, y0, z0, x1, y1, z1, node):
    """Put a node with its distances on the stack, and the first of its children that the ray enters."""
    stack[at], stack[at + 1], stack[at + 2], stack[at + 3], stack[at + 4], stack[at + 5] = x0, y0, z0, x1, y1, z1
    enter = max(max(x0, y0), max(z0, 0.0))
    first = 0
    if 0.5 * (x0 + x1) < enter:
        first |= 4
    if 0.5 * (y0 + y1) < enter:
        first |= 2
    if 0.5 * (z0 + z1) < enter:
        first |= 1
    stack[at + 6], stack[at + 7] = node, first


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    r, enter, leave, best, best_face = enter_box(s.cells, o, ray, ox, oy, oz, dx, dy, dz, limit)
    low, high, stack = s.cells.low, s.cells.high, ray.view(np.float64)
    # A ray of negative components is mirrored; `mirror` turns the numbers of children back.
    mirror = 0
    x0, x1 = (low[o, 0] - r.x) * r.ix, (high[o, 0] - r.x) * r.ix
    y0, y1 = (low[o, 1] - r.y) * r.iy, (high[o, 1] - r.y) * r.iy
    z0, z1 = (low[o, 2] - r.z) * r.iz, (high[o, 2] - r.z) * r.iz
    if r.ix < 0.0:
        mirror, x0, x1 = mirror | 4, x1, x0
    if r.iy < 0.0:
        mirror, y0, y1 = mirror | 2, y1, y0
    if r.iz < 0.0:
        mirror, z0, z1 = mirror | 1, z1, z0
    bottom = STACK // 2
    top = bottom - NODE_FIELDS
    if enter <= leave:
        top = bottom
        _push(stack, top, x0, y0, z0, x1, y1, z1, s.root[o])
    while top >= bottom:
        if stack[top + 7] == ENDED:
            top -= NODE_FIELDS
            continue
        x0, y0, z0, x1, y1, z1 = (
            stack[top], stack[top + 1], stack[top + 2], stack[top + 3], stack[top + 4], stack[top + 5]
        )  # fmt: skip
        node, own = np.int64(stack[top + 6]), np.int64(stack[top + 7])
        xm, ym, zm = 0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1)
        if own & 4:
            x0 = xm
        else:
            x1 = xm
        if own & 2:
            y0 = ym
        else:
            y1 = ym
        if own & 1:
            z0 = zm
        else:
            z1 = zm
        leave = min(x1, min(y1, z1))
        bit = 4 if x1 == leave else (2 if y1 == leave else 1)
        stack[top + 7] = ENDED if own & bit else own | bit
        if max(x0, max(y0, z0)) > best:
            break
        if leave < 0.0:
            continue
        node = np.int64(s.child[node]) + (own ^ mirror)
        if s.child[node] >= 0:
            top += NODE_FIELDS
            _push(stack, top, x0, y0, z0, x1, y1, z1, node)
            continue
        best, best_face = visit(s.cells, o, ~s.child[node], ray, r, best, best_face)
        if any_hit and best_face >= 0:
            break
    return np.float32(best), np.int32(best_face)

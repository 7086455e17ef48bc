"""Binary tree of halved nodes with the traversal of Havran, Kopal, Bittner and Zara 1997.

"Fast robust BSP tree traversal algorithm for ray tracing": children are chosen by the coordinates of the points where a
ray enters and leaves a node, not by distances. A node is halved along its longest axis. Departure: the point of entry
is kept apart from the stack of exits, so that entries need no links.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel
from gi_core.rays.cells import HALVED, Tree, build_tree, enter_box, visit
from gi_core.rays.triangles import STACK, Meshes

POINT = 5  # float64 of a point on the stack: x, y, z, distance, node behind it


class BinaryTree(Tree):
    """Two children per node."""


def build(meshes: Meshes, leaf: float = 8) -> BinaryTree:
    """Return the structure of all objects; cells of more than `leaf` triangles are divided."""
    return BinaryTree(*build_tree(meshes, leaf, 2, HALVED))


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    r, enter, leave, best, best_face = enter_box(s.cells, o, ray, ox, oy, oz, dx, dy, dz, limit)
    if enter > leave:
        return np.float32(best), np.int32(best_face)
    stack, node, entry = ray.view(np.float64), s.root[o], STACK // 2
    bottom = entry + POINT
    last = bottom  # the point where the ray leaves the node
    stack[entry], stack[entry + 1], stack[entry + 2] = r.x + enter * r.dx, r.y + enter * r.dy, r.z + enter * r.dz
    stack[last], stack[last + 1], stack[last + 2] = r.x + leave * r.dx, r.y + leave * r.dy, r.z + leave * r.dz
    while True:
        while s.child[node] >= 0:
            axis, plane, child = s.axis[node], s.plane[node], np.int64(s.child[node])
            if stack[entry + axis] <= plane:
                if stack[last + axis] <= plane:
                    node = child
                    continue
                node, behind = child, child + 1
            else:
                if stack[last + axis] > plane:
                    node = child + 1
                    continue
                node, behind = child + 1, child
            t = (plane - r.x) * r.ix if axis == 0 else (plane - r.y) * r.iy if axis == 1 else (plane - r.z) * r.iz
            last += POINT
            stack[last], stack[last + 1], stack[last + 2] = r.x + t * r.dx, r.y + t * r.dy, r.z + t * r.dz
            stack[last + axis] = plane
            stack[last + 3], stack[last + 4] = t, behind
        best, best_face = visit(s.cells, o, ~s.child[node], ray, r, best, best_face)
        if last == bottom or stack[last + 3] > best or (any_hit and best_face >= 0):
            break
        stack[entry], stack[entry + 1], stack[entry + 2] = stack[last], stack[last + 1], stack[last + 2]
        node = np.int64(stack[last + 4])
        last -= POINT
    return np.float32(best), np.int32(best_face)

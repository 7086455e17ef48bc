"""BSP tree with the traversal of Sung and Shirley 1992 (Graphics Gems III): intervals of distance on a stack.

Departure: they halve each node, along the axes in turn; here the plane of the least cost divides it.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel
from gi_core.rays.cells import BY_COST, Tree, build_tree, enter_box, visit
from gi_core.rays.triangles import STACK, Meshes


class Bsp(Tree):
    """Two children per node."""


def build(meshes: Meshes, leaf: float = 8) -> Bsp:
    """Return the structure of all objects; cells of more than `leaf` triangles are divided."""
    return Bsp(*build_tree(meshes, leaf, 2, BY_COST))


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    r, enter, leave, best, best_face = enter_box(s.cells, o, ray, ox, oy, oz, dx, dy, dz, limit)
    stack, node, bottom = ray.view(np.float64), s.root[o], STACK // 2
    top = bottom  # entries of three: distance in, distance out, node
    while enter <= leave:
        while s.child[node] >= 0:
            axis, plane, child = s.axis[node], s.plane[node], np.int64(s.child[node])
            if axis == 0:
                t, below = (plane - r.x) * r.ix, r.x < plane or (r.x == plane and r.ix > 0.0)
            elif axis == 1:
                t, below = (plane - r.y) * r.iy, r.y < plane or (r.y == plane and r.iy > 0.0)
            else:
                t, below = (plane - r.z) * r.iz, r.z < plane or (r.z == plane and r.iz > 0.0)
            near = child if below else child + 1
            if t > leave or t < 0.0:
                node = near
            elif t < enter:
                node = 2 * child + 1 - near
            else:
                stack[top], stack[top + 1], stack[top + 2] = t, leave, 2 * child + 1 - near
                top += 3
                node, leave = near, t
        best, best_face = visit(s.cells, o, ~s.child[node], ray, r, best, best_face)
        if top == bottom or (any_hit and best_face >= 0):
            break
        top -= 3
        enter, leave, node = stack[top], stack[top + 1], np.int64(stack[top + 2])
        if enter > best:
            break
    return np.float32(best), np.int32(best_face)

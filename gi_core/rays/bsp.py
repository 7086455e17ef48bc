"""BSP tree with the traversal of Sung and Shirley 1992 (Graphics Gems III): intervals of distance on a stack.

Its planes are normal to the longest axis of their nodes, at the median of the centres of triangles. Departure: they
halve each node there, along the axes in turn.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel
from gi_core.rays.cells import MEDIAN, Tree, build_tree, clip, start, visit
from gi_core.rays.triangles import STACK, Meshes, inverse, test_ray

LEAF = 8  # triangles that may share a cell


class Bsp(Tree):
    """Two children per node."""


def build(meshes: Meshes, leaf: float = LEAF) -> Bsp:
    """Return the structure of all objects."""
    return Bsp(*build_tree(meshes, leaf, 2, MEDIAN))


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    r, best, found = test_ray(s.cells.triangles, o, ox, oy, oz, dx, dy, dz), np.float64(limit), -1
    ix, iy, iz = inverse(r.dx), inverse(r.dy), inverse(r.dz)
    enter, leave = clip(s.cells, o, r.x, r.y, r.z, ix, iy, iz)
    enter, leave = max(enter, 0.0), min(leave, best)
    stack, node, bottom = ray.view(np.float64), s.root[o], STACK // 2
    start(ray)
    top = bottom  # entries of three: distance in, distance out, node
    while enter <= leave:
        while s.child[node] >= 0:
            axis, plane, child = s.axis[node], s.plane[node], np.int64(s.child[node])
            if axis == 0:
                t, below = (plane - r.x) * ix, r.x < plane or (r.x == plane and ix > 0.0)
            elif axis == 1:
                t, below = (plane - r.y) * iy, r.y < plane or (r.y == plane and iy > 0.0)
            else:
                t, below = (plane - r.z) * iz, r.z < plane or (r.z == plane and iz > 0.0)
            near = child if below else child + 1
            if t > leave or t < 0.0:
                node = near
            elif t < enter:
                node = 2 * child + 1 - near
            else:
                stack[top], stack[top + 1], stack[top + 2] = t, leave, 2 * child + 1 - near
                top += 3
                node, leave = near, t
        best, found = visit(s.cells, o, ~s.child[node], ray, r, best, found)
        if top == bottom or (any_hit and found >= 0):
            break
        top -= 3
        enter, leave, node = stack[top], stack[top + 1], np.int64(stack[top + 2])
        if enter > best:
            break
    return np.float32(best), np.int32(found)

"""No structure: every ray is tested against every triangle. The other structures are compared with this one."""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel
from gi_core.rays.triangles import TESTS, Meshes, Triangles, nearer, test_ray, triangles_of

LEAF = 1  # has no meaning here


class None_(Triangles):
    """Triangles alone."""


def build(meshes: Meshes, leaf: float = LEAF) -> Triangles:
    """Return the triangles of all objects."""
    return None_(*triangles_of(meshes))


@kernel
def trace(s, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance float32 and face of the nearest hit, or of any; limit and -1 for none."""
    r, best, found, k = test_ray(s, o, ox, oy, oz, dx, dy, dz), np.float64(limit), -1, s.first[o]
    while k < s.first[o + 1] and not (any_hit and found >= 0):
        best, found = nearer(s.corners, k, k - s.first[o], r, best, found)
        k += 1
    ray.view(np.int32)[TESTS] += k - s.first[o]
    return np.float32(best), np.int32(found)

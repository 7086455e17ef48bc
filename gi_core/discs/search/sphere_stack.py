"""Sphere stack of the ray cache (report 2.6): nested spheres of decreasing radius around receivers in a given order.

A sphere is pushed around the first receiver inside its parent. It is popped at the first receiver whose disc is not
entirely inside. Receivers do not move in object space, so pushes and pops are computed once per object. Each sphere is
then shrunk to its discs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating
from gi_core.base.vec import difference, dot

SHRINK = 0.5  # radius of a sphere over its parent's, see docs/decisions/disc-searches.md
LEAST_RADII = 2.0  # disc radii: radius of the smallest sphere


class Spheres(NamedTuple):
    """Spheres in the order of pushes. The spheres inside sphere k are k + 1 .. behind[k] - 1."""

    first: np.ndarray  # (K,) int32, receivers first .. last - 1 of the order are inside
    last: np.ndarray  # (K,) int32
    behind: np.ndarray  # (K,) int32
    parent: np.ndarray  # (K,) int32, -1 of the root
    depth: np.ndarray  # (K,) int32, 0 of the root
    centre: np.ndarray  # (K, 3) float32 [m]
    radius: np.ndarray  # (K,) float32 [m]


def stack_spheres(points: np.ndarray, reach: float) -> Spheres:
    """Return the spheres over discs of radius `reach` [m] around points (n, 3), in the given order."""
    points = np.ascontiguousarray(points, np.float64)
    whole = 0.5 * float(np.sqrt((np.ptp(points, axis=0) ** 2).sum())) + 2 * reach if len(points) else 0.0
    count = max(0, int(np.ceil(np.log(max(whole / (LEAST_RADII * reach), 1.0)) / -np.log(SHRINK))))
    radii = LEAST_RADII * reach * SHRINK ** -np.arange(count - 1.0, -1.0, -1.0)
    room = len(points) * (count + 1) + 1
    first, last, parent = (np.empty(room, np.int32) for _ in range(3))
    n = _push_and_pop(points, reach, radii, first, last, parent)
    first, last, parent = first[:n].copy(), last[:n].copy(), parent[:n].copy()
    behind, depth = np.empty(n, np.int32), np.zeros(n, np.int32)
    centre, radius = np.empty((n, 3), np.float32), np.empty(n, np.float32)
    _tighten(points, reach, first, last, parent, behind, depth, centre, radius)
    return Spheres(first, last, behind, parent, depth, centre, radius)


@allocating
def _push_and_pop(points, reach, radii, first, last, parent):
    """Write the spheres in the order of pushes; return their number.

    Spheres with the same receivers as their parent, or with few receivers, are left out.
    """
    n, depth = len(points), 0
    begun, centre = np.zeros(len(radii), np.int64), np.zeros((len(radii), 3))
    if n == 0:
        return 0
    first[0], last[0], parent[0] = 0, n, -1
    spheres = 1
    # The last receiver of a sphere is known only at its pop, hence two passes.
    ends = np.zeros((len(radii), n), np.int32)
    for i in range(n + 1):
        keep = 0
        while i < n and keep < depth:
            off, room = difference(points[i], centre[keep]), radii[keep] - reach
            if dot(off, off) > room * room:
                break
            keep += 1
        for level in range(keep, depth):
            ends[level, begun[level]] = i
        for level in range(keep, len(radii)):
            if i < n:
                begun[level] = i
                centre[level, 0], centre[level, 1], centre[level, 2] = points[i, 0], points[i, 1], points[i, 2]
        depth = len(radii)
    on_stack = np.zeros(len(radii) + 1, np.int64)
    height = 1
    for i in range(n):
        while last[on_stack[height - 1]] <= i:
            height -= 1
        for level in range(len(radii)):
            end = ends[level, i]
            above = on_stack[height - 1]
            # a sphere of fewer than 4 receivers costs more than it saves
            if end - i < 4 or (first[above] == i and last[above] == end):
                continue
            first[spheres], last[spheres], parent[spheres] = i, end, above
            on_stack[height] = spheres
            height += 1
            spheres += 1
    return spheres


@allocating
def _tighten(points, reach, first, last, parent, behind, depth, centre, radius):
    for k in range(len(first)):
        if parent[k] >= 0:
            depth[k] = depth[parent[k]] + 1
        low, high = points[first[k]].copy(), points[first[k]].copy()
        for i in range(first[k], last[k]):
            for c in range(3):
                low[c], high[c] = min(low[c], points[i, c]), max(high[c], points[i, c])
        most = 0.0
        middle = 0.5 * (low + high)
        for i in range(first[k], last[k]):
            off = difference(points[i], middle)
            most = max(most, dot(off, off))
        for c in range(3):
            centre[k, c] = middle[c]
        radius[k] = (np.sqrt(most) + reach) * (1.0 + 1e-3)  # 1e-3 of a sphere's radius covers rounding
    # In push order, a sphere ends where the next sphere of its depth or above begins.
    for k in range(len(first) - 1, -1, -1):
        j = k + 1
        while j < len(first) and depth[j] > depth[k]:
            j = behind[j]
        behind[k] = j

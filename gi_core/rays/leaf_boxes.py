"""Boxes of the leaf cells of a structure, and those that a ray visits: how a structure divides a scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.rays.bvh import CHILD, Bvh
from gi_core.rays.cells import Tree
from gi_core.rays.grid3d import Grid3d
from gi_core.rays.octree import Octree


class LeafBoxes(NamedTuple):
    """Leaf cells of one object, in its space. Those of a bvh may overlap; the others fill its box."""

    low: np.ndarray  # (n, 3) float64 [m]
    high: np.ndarray  # (n, 3) float64 [m]
    triangles: np.ndarray  # (n,) int64, listed in each cell


def leaf_boxes(scenes, o: int) -> LeafBoxes | None:
    """Return the leaf cells of object o; None for a structure without cells of its own (Embree, none)."""
    if isinstance(scenes, Bvh):
        return _of_bvh(scenes, o)
    if isinstance(scenes, Grid3d):
        return _of_grid(scenes, o)
    return _of_tree(scenes, o) if isinstance(scenes, Tree) else None


def visited(boxes: LeafBoxes, origin, direction, distance: float) -> np.ndarray:
    """Return (n,) bool: the ray touches the cell within the distance [m]."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = 1.0 / np.asarray(direction, np.float64)
        a, b = (boxes.low - origin) * inverse, (boxes.high - origin) * inverse
    enter = np.fmax.reduce(np.fmin(a, b), axis=1)  # fmax and fmin leave out 0 / 0
    leave = np.fmin.reduce(np.fmax(a, b), axis=1)
    return np.maximum(enter, 0.0) <= np.minimum(leave, distance)


def _of_bvh(s: Bvh, o: int) -> LeafBoxes:
    end = s.root[o + 1] if o + 1 < len(s.root) else len(s.nodes)
    nodes = s.nodes[s.root[o] : end]
    child = np.ascontiguousarray(nodes).view(np.int32)[:, CHILD:].reshape(-1)
    box = nodes[:, :CHILD].reshape(-1, 6, 4).transpose(0, 2, 1).reshape(-1, 6).astype(np.float64)
    count = np.where(child < 0, ~child & 15, 0)
    return LeafBoxes(box[count > 0, :3], box[count > 0, 3:], count[count > 0].astype(np.int64))


def _of_grid(s: Grid3d, o: int) -> LeafBoxes:
    nx, ny, nz = s.count[o]
    z, y, x = (k.reshape(-1) for k in np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij"))
    low = s.cells.low[o] + np.stack([x, y, z], axis=1) * s.step[o]
    first = s.start[o]
    return LeafBoxes(low, low + s.step[o], np.diff(s.cells.first[first : first + len(low) + 1]))


def _of_tree(s: Tree, o: int) -> LeafBoxes:
    """Descend level by level: the children of a node follow each other."""
    node, low, high = np.array([s.root[o]]), s.cells.low[o][None], s.cells.high[o][None]
    ways = 8 if isinstance(s, Octree) else 2
    leaves = []
    while len(node):
        leaf = s.child[node] < 0
        cell = ~s.child[node[leaf]]
        leaves.append((low[leaf], high[leaf], s.cells.first[cell + 1] - s.cells.first[cell]))
        node, low, high = node[~leaf], low[~leaf], high[~leaf]
        parts = []
        for c in range(ways):
            a, b = low.copy(), high.copy()
            for axis in range(3):
                at = 0.5 * (low[:, axis] + high[:, axis]) if ways == 8 else s.plane[node]
                cut = np.full(len(node), True) if ways == 8 else s.axis[node] == axis
                upper = (c >> (2 - axis) & 1) if ways == 8 else c
                (a if upper else b)[cut, axis] = at[cut]
            parts.append((s.child[node] + c, a, b))
        node, low, high = (np.concatenate(p) for p in zip(*parts, strict=True))
    low, high, count = (np.concatenate(p) for p in zip(*leaves, strict=True))
    return LeafBoxes(low, high, count)

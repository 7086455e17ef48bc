"""A bare mesh refined to a budget of receivers: finest where light lands and the camera looks."""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import allocating
from gi_core.base.vectors import length
from gi_core.files.completion.camera_view import in_frame, unit
from gi_core.files.completion.pilot import Box, Rays
from gi_core.geometry.receivers import count_receivers
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.tessellation import tessellate
from gi_core.scene.types import Mesh, Scene

FINEST = 0.02  # of the scene's size, under the default radius: shadows blur over twice that
UNSEEN_FACTOR, DIM_FACTOR = 1.6, 2.0  # factor of edges out of sight, and in dim light; without light DIM_FACTOR^2
GROWTH = 4.0  # outside the useful box an edge may be as long as its distance from it over this
COARSEST = 1 / 12  # of the longest side: the first try; and the edges of a mobile that no scene file describes
BUDGET_USED = 0.75  # share of the budget that will do


def refined(scene: Scene, rays: Rays, box: Box, budget: int) -> tuple[Mesh, float]:
    """Return the static mesh, split, and the longest edge in the light and in view [m].

    budget: of receivers, both sides of two-sided faces counted.
    """
    mesh = scene.static
    grain = Grain(scene, rays, box)
    sided = 1 + np.array([m.two_sided for m in scene.materials])
    before = float(sided[mesh.face_material].sum())
    receivers = count_receivers(mesh, face_normals(mesh)[0], sided[mesh.face_material] == 2)
    # 1 / 3 of the budget is for large faces where the file has used it up with small ones
    room = max(budget - receivers, (1 / 3) * budget)

    def cut(edge: float) -> Mesh:
        # faces thinner than 1 / 8 of the longest edge are left to their neighbours
        return tessellate(mesh, edge, grain.longest(edge), edge * (1 / 8))

    # The number goes with the inverse square of the edge, more or less: follow that from the coarse side.
    finest = box.size * FINEST
    edge, best, kept = box.size * COARSEST, box.size, None
    for _ in range(5):
        tried = cut(edge)
        # Each new vertex on a smooth surface makes two new faces.
        made = (float(sided[tried.face_material].sum()) - before) / 2
        if made <= room:
            if edge < best:
                best, kept = edge, tried
            if edge <= finest or made > BUDGET_USED * room:
                break
        aim = room * (1 + BUDGET_USED) / 2
        # Few new faces predict the next count badly; the weld drops tiny faces.
        edge = max(edge * max(float(np.sqrt(max(made, 0) / aim)), 0.2), finest)
    return cut(best) if kept is None else kept, best


class Grain:
    """Longest edge allowed at each place.

    The length allowed changes by no more than half of the way one goes: where it jumped, splitting would go on
    for ever along the jump.
    """

    def __init__(self, scene: Scene, rays: Rays, box: Box):
        # 24 cells along the scene's size; light and sight are measured for each
        self.box, self.cell = box, box.size / 24
        self.corner = box.low - 1.5 * self.cell  # of the first cell's middle: a cell to spare, walls not on its sides
        shape = np.ceil((box.high - self.corner) / self.cell).astype(int) + 2
        self.kinds = []  # factor, and the distance (X, Y, Z) [m] to the nearest cell of that kind
        if not len(box.hits):
            return
        cell = np.rint((box.hits - self.corner) / self.cell).astype(np.int64)
        cells, first, counts = np.unique(cell, axis=0, return_index=True, return_counts=True)
        # a cell with fewer than 0.25 of the median number of hits is dim
        factor = np.where(counts < 0.25 * np.median(counts), DIM_FACTOR, 1.0)
        factor = np.where(_in_sight(scene, rays, box, first), factor, factor * UNSEEN_FACTOR)
        for f in np.unique(factor):
            empty = np.ones(shape, bool)
            empty[tuple(cells[factor == f].T)] = False
            self.kinds.append((float(f), _distances(empty, self.cell)))

    def longest(self, edge: float):
        """Return the function `longest` of tessellate(), with `edge` [m] where the mesh is finest."""

        def allowed(middle: np.ndarray, length: np.ndarray) -> np.ndarray:
            out = np.maximum(np.maximum(self.box.low - middle, middle - self.box.high), 0.0)
            outside = np.sqrt((out * out).sum(axis=-1)) - length / 2  # of the edge's nearest end, at least
            return np.maximum(self._inside(edge, middle, length), outside / GROWTH)

        return allowed

    def _inside(self, edge: float, middle: np.ndarray, length: np.ndarray) -> np.ndarray:
        at = ((middle - self.corner) / self.cell).reshape(-1, 3)
        result = np.full(length.shape, DIM_FACTOR * DIM_FACTOR * edge if self.kinds else edge)
        for factor, distances in self.kinds:
            away = _between(distances, at).reshape(length.shape)
            away = np.maximum(away - self.cell - length / 2, 0.0)
            result = np.minimum(result, factor * edge + away / GROWTH)
        return result


def _distances(empty: np.ndarray, cell: float) -> np.ndarray:
    """Return how far it is [m] from each cell (X, Y, Z) to the nearest one that is not empty: one axis at a time."""
    squared = np.where(empty, np.inf, 0.0)
    for axis, n in enumerate(squared.shape):
        apart = np.subtract.outer(np.arange(n), np.arange(n)) ** 2.0
        rows = np.moveaxis(squared, axis, -1)
        squared = np.moveaxis((rows[..., None, :] + apart).min(axis=-1), -1, axis)
    return np.ascontiguousarray(cell * np.sqrt(squared))


@allocating
def _between(grid, at):
    """Return the values (n,) at places (n, 3) between the cells of a grid, linear per axis, constant outside."""
    out = np.empty(len(at))
    low, share = np.empty(3, np.int64), np.empty(3)
    for i in range(len(at)):
        for c in range(3):
            x = min(max(at[i, c], 0.0), grid.shape[c] - 1.0)
            low[c] = min(int(x), grid.shape[c] - 2)
            share[c] = x - low[c]
        total = 0.0
        for corner in range(8):
            weight, x, y, z = 1.0, low[0], low[1], low[2]
            weight *= share[0] if corner & 1 else 1.0 - share[0]
            weight *= share[1] if corner & 2 else 1.0 - share[1]
            weight *= share[2] if corner & 4 else 1.0 - share[2]
            total += weight * grid[x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)]
        out[i] = total
    return out


def _in_sight(scene: Scene, rays: Rays, box: Box, rows: np.ndarray) -> np.ndarray:
    """Return which hits the camera sees, or will when it is turned a little."""
    if scene.camera is None:
        return np.ones(len(rows), bool)
    points = box.hits[rows] + 1e-3 * box.size * box.normals[rows]
    to = points - np.array(scene.camera.position)
    t, _ = rays.hits(np.broadcast_to(scene.camera.position, to.shape), unit(to))
    return (np.abs(in_frame(scene.camera, scene.up, points)).max(axis=1) < 1.2) & (t > 0.98 * length(to))

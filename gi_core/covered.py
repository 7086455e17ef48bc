"""Receivers that a mobile covers at a pose, to be drawn like those beside it: see `hidden.py`.

Under the foot of a statue the floor is black, and its triangles carry the black out into the open, another notch at
every pose. Which receivers these are is found anew for each picture, from those near a mobile alone. A mobile also
covers some of its own: a chair's seat goes on inside its posts, wherever it stands.
"""

from __future__ import annotations

import numpy as np

from gi_core.accelerator import Transforms, rays_to_object
from gi_core.error import luminance
from gi_core.evaluation_points import evaluation_points
from gi_core.hidden import BLACK, LITTLE, LOOKS, NONE_HIDDEN, Hidden, directions, look_round
from gi_core.mesh_neighbours import neighbours
from gi_core.model import Model

MOST = 0.7  # of all directions: so many must meet the mobile


class Covered:
    """Finds them; made once a scene."""

    def __init__(self, model: Model):
        s = model.surfaces
        n = s.receiver_range(0).stop
        points, normals = evaluation_points(s, model.object_receivers)
        self._model = model
        self._points, self._normals = points[:n].astype(np.float32), normals[:n]
        self._columns = np.ascontiguousarray(self._points.T)
        self._near = neighbours(np.concatenate([model.corners(o) for o in range(s.objects)]), len(points))
        sunk = np.zeros(len(points), bool)
        for o in range(1, s.objects):
            own = s.receiver_range(o)
            sunk[own], _ = look_round(model, o, points[own], normals[own])
        self._sunk = np.flatnonzero(sunk)

    def find(self, irradiance: np.ndarray, at: Transforms) -> Hidden:
        """Return the receivers that are covered at these poses, in light (R, 3), with their lit neighbours."""
        found = [self._under(o, irradiance, at) for o in range(1, len(at.position))]
        found.append(self._sunk[self._dark(self._sunk, irradiance, LITTLE)])
        rows = np.unique(np.concatenate(found))
        return self._with_neighbours(rows, irradiance) if len(rows) else NONE_HIDDEN

    def _under(self, o: int, irradiance: np.ndarray, at: Transforms) -> np.ndarray:
        """Return the rows of black receivers that see little but mobile o."""
        world = self._model.world
        middle = at.rotation[o] @ world.sphere_centre[o] + at.position[o]
        near, r = np.ones(len(self._points), bool), np.float32(world.sphere_radius[o])
        for x, m in zip(self._columns, middle.astype(np.float32), strict=True):
            near &= np.abs(x - m) < r
        rows = np.flatnonzero(near)
        rows = rows[self._dark(rows, irradiance, BLACK)]
        rays = directions(self._normals[rows]).reshape(-1, 3)
        local = rays_to_object(at, o, np.repeat(self._points[rows], LOOKS, axis=0), rays)
        limits = np.full(len(rays), 2 * world.sphere_radius[o], np.float32)
        _, face = self._model.accelerator.nearest(o, *local, limits)
        return rows[(face >= 0).reshape(-1, LOOKS).mean(axis=1) >= MOST]

    def _dark(self, rows: np.ndarray, irradiance: np.ndarray, share: float) -> np.ndarray:
        """Return which of the rows (n,) bool have no more than a share of the light beside them."""
        return luminance(irradiance[rows]) <= share * self._brightest_beside(rows, irradiance)

    def _brightest_beside(self, rows: np.ndarray, irradiance: np.ndarray) -> np.ndarray:
        of, neighbour = self._pairs(rows)
        out = np.zeros(len(rows))
        np.maximum.at(out, of, luminance(irradiance[neighbour]))
        return out

    def _pairs(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return each neighbour of each row, and the number of that row in `rows`."""
        first, count = self._near.first[rows], self._near.first[rows + 1] - self._near.first[rows]
        of = np.repeat(np.arange(len(rows)), count)
        within = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        return of, self._near.of[first[of] + within].astype(np.int64)

    def _with_neighbours(self, rows: np.ndarray, irradiance: np.ndarray) -> Hidden:
        of, neighbour = self._pairs(rows)
        black = BLACK * self._brightest_beside(rows, irradiance)
        visible = (luminance(irradiance[neighbour]) > black[of]) & ~np.isin(neighbour, rows)
        of, neighbour = of[visible], neighbour[visible]
        some, count = np.unique(of, return_counts=True)
        return Hidden(rows[some], np.concatenate([[0], np.cumsum(count)]), neighbour, np.delete(rows, some))

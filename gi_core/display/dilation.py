"""Dilation: pictures fill vertices that light cannot reach from the lit ones beside them.

Where one thing stands on another, vertices of the one lie inside the other: floor under a cupboard, wall behind a
shelf. They are black, rightly, but interpolation carries the black into the open: dark teeth along every contact. A
picture therefore gives such a receiver the mean colour of its lit neighbours, and next to no weight in its triangles.
A column that stands on the border of a shadow is then lit on one side down to its foot, dark on the other. Only
pictures are dilated: irradiance stays what it is, and errors are those of irradiance.

A receiver is *unreached* by one of three rules, each beside lit neighbours:

- inside: most of its directions meet the inside of solid things, and it has little of its neighbours' light;
- closed: most of its directions end nearby, and it is black. Where a neighbour is black in the open the dark is real:
  nothing is carried over at the foot of a thin wall beside an unlit room;
- cut off: it is black, and surfaces lie between it and each lit neighbour; so is the end of a table's leg that is sunk
  through the floor. None of its faces may be black altogether: that again is a dark region.

Receivers look at their own object; static receivers near a mobile look at that too, at each pose.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import dot, length
from gi_core.geometry.error import luminance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.geometry.mesh_neighbours import neighbours
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms, rays_to_object

DIRECTIONS = 16
NEAR = 0.06  # of the scene's size: a space that is no wider is no room
CHUNK = 2048  # receivers per step: some 10 ms
BLACK = 0.02  # of the brightest neighbour's light: a photon in a million slips through where edges meet
LITTLE = 0.1  # the same inside solid things, which light enters at corners by the radius of a disc
WEIGHT = 1e-3  # of an unreached receiver in its triangles; squared where it has no lit neighbour
SHORT = 1e-3  # of the way to a neighbour that is left out: faces meet there
UNKNOWN, OPEN, CLOSED, INSIDE = -1, 0, 1, 2


class Unreached(NamedTuple):
    """Receivers to be filled, and the lit neighbours that they are filled from."""

    rows: np.ndarray  # (h,) int64, ascending
    first: np.ndarray  # (h + 1,) int64 into `neighbours`
    neighbours: np.ndarray  # (k,) int64
    deep: np.ndarray  # (d,) int64 unreached receivers without a lit neighbour


class Drawn(NamedTuple):
    """Irradiance for pictures, and the weight of each receiver where a triangle is interpolated."""

    irradiance: np.ndarray  # (R, 3) [W/m2]
    weights: np.ndarray | None  # (R,) float32: 1, WEIGHT or its square; None: all 1


NONE_UNREACHED = Unreached(np.zeros(0, np.int64), np.zeros(1, np.int64), *[np.zeros(0, np.int64)] * 2)


class Dilation:
    """Finds unreached receivers of a scene. What receivers look at is remembered, light and poses are not."""

    def __init__(self, model: Model, size: float):
        """size [m]: longest side of the box that light falls on, as `gi_core.defaults.choose` finds it."""
        s = model.surfaces
        self._model, self._near = model, NEAR * size
        points, self._normals = evaluation_points(s, model.object_receivers)
        self._points = points.astype(np.float32)
        self._neighbours = neighbours(np.concatenate([model.corners(o) for o in range(s.objects)]), len(points))
        self._static_columns = np.ascontiguousarray(self._points[s.receiver_range(0)].T)
        self._place = np.full(len(points), UNKNOWN, np.int8)
        for o in range(1, s.objects):
            own = s.receiver_range(o)
            self._place[own] = self._places(o, self._points[own], directions(self._normals[own]))
        self._in_mobiles = np.flatnonzero(self._place == INSIDE)

    def find_static(self, irradiance: np.ndarray) -> Generator[None, None, Unreached]:
        """Find unreached receivers of the static part by its light (n, 3) without mobiles, in steps; returns them."""
        light = luminance(irradiance)
        brightest = self._brightest_beside(np.arange(len(light)), light)
        black = light <= BLACK * brightest
        rows = np.flatnonzero(light <= LITTLE * brightest)
        yield
        unknown = rows[self._place[rows] == UNKNOWN]
        for first in range(0, len(unknown), CHUNK):
            some = unknown[first : first + CHUNK]
            self._place[some] = self._places(0, self._points[some], directions(self._normals[some]))
            yield
        place = self._place[: len(light)]
        inside = rows[place[rows] == INSIDE]
        closed = self._without_dark_beside(np.flatnonzero(black & (place == CLOSED)), black & (place == OPEN))
        cut_off = self._cut_off(
            np.setdiff1d(np.flatnonzero(black & (place == OPEN)), self._of_black_faces(black)), black
        )
        return self._unreached(np.unique(np.concatenate([inside, closed, cut_off])), light)

    def _without_dark_beside(self, rows: np.ndarray, dark: np.ndarray) -> np.ndarray:
        """Return the rows that have no neighbour in the dark (n,) bool."""
        of, neighbour = self._pairs(rows)
        return np.delete(rows, of[dark[neighbour]])

    def _of_black_faces(self, black: np.ndarray) -> np.ndarray:
        """Return the corners of the static faces whose corners are all black (n,) bool."""
        corners = self._model.corners(0)
        return np.unique(corners[black[corners].all(axis=1)])

    def _cut_off(self, rows: np.ndarray, black: np.ndarray) -> np.ndarray:
        """Return the rows between which and each neighbour that is not black (n,) bool another surface lies."""
        of, neighbour = self._pairs(rows)
        of, neighbour = of[~black[neighbour]], neighbour[~black[neighbour]]
        start = self._points[neighbour]
        way = self._points[rows[of]] - start
        far = np.maximum(length(way), np.float32(1e-30))
        limits = far * np.float32(1 - SHORT)
        _, face = self._model.accelerator.nearest(0, start, way / far[:, None], limits)
        return np.delete(rows, of[face < 0])

    def find_moved(self, irradiance: np.ndarray, at: Transforms) -> Unreached:
        """Find static receivers under mobiles at these poses, and receivers inside mobiles, by the light (R, 3)."""
        light = luminance(irradiance)
        rows = [self._under(o, light, at) for o in range(1, len(at.position))]
        rows.append(self._in_mobiles[self._is_dark(self._in_mobiles, light, LITTLE)])
        return self._unreached(np.unique(np.concatenate(rows)), light)

    def _under(self, o: int, light: np.ndarray, at: Transforms) -> np.ndarray:
        """Return the rows of black static receivers that mobile o closes."""
        world = self._model.world
        middle = at.rotation[o] @ world.sphere_centre[o] + at.position[o]
        near, r = np.ones(self._static_columns.shape[1], bool), np.float32(world.sphere_radius[o])
        for x, m in zip(self._static_columns, middle.astype(np.float32), strict=True):
            near &= np.abs(x - m) < r
        rows = np.flatnonzero(near)
        rows = rows[self._is_dark(rows, light, BLACK)]
        rays = directions(self._normals[rows])
        origins = np.repeat(self._points[rows], DIRECTIONS, axis=0)
        origins, rays = rays_to_object(at, o, origins, rays.reshape(-1, 3))
        return rows[self._places(o, origins, rays) != OPEN]

    def _places(self, o: int, points: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Return the place (n,) int8 of each of n points among the faces of object o, in that object's space.

        points (n, 3) or (n DIRECTIONS, 3) float32, rays (n DIRECTIONS, 3) float32 unit.
        """
        s, rays = self._model.surfaces, rays.reshape(-1, 3)
        origins = points if len(points) == len(rays) else np.repeat(points, DIRECTIONS, axis=0)
        limits = np.full(len(rays), self._model.world.size, np.float32)
        distance, face = self._model.accelerator.nearest(o, origins, rays, limits)
        behind = (face >= 0) & (dot(s.normals[face], rays) > 0) & ~s.two_sided[face]
        inside, near = ((a.reshape(-1, DIRECTIONS).mean(axis=1) > 0.5) for a in (behind, distance < self._near))
        return np.where(inside, INSIDE, np.where(near, CLOSED, OPEN)).astype(np.int8)

    def _is_dark(self, rows: np.ndarray, light: np.ndarray, share: float) -> np.ndarray:
        """Return which of the rows (n,) bool have no more than a share of the light (R,) beside them."""
        return light[rows] <= share * self._brightest_beside(rows, light)

    def _brightest_beside(self, rows: np.ndarray, light: np.ndarray) -> np.ndarray:
        of, neighbour = self._pairs(rows)
        out = np.zeros(len(rows))
        np.fmax.at(out, of, light[neighbour])  # nan: not known
        return out

    def _pairs(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return each neighbour of each row, and the number of that row in `rows`."""
        first, count = self._neighbours.first[rows], np.diff(self._neighbours.first)[rows]
        of = np.repeat(np.arange(len(rows)), count)
        within = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        return of, self._neighbours.of[first[of] + within].astype(np.int64)

    def _unreached(self, rows: np.ndarray, light: np.ndarray) -> Unreached:
        """Return the rows with their lit neighbours."""
        of, neighbour = self._pairs(rows)
        is_lit = np.ones(len(light), bool)
        is_lit[rows] = False
        lit = is_lit[neighbour] & (light[neighbour] > BLACK * self._brightest_beside(rows, light)[of])
        of, neighbour = of[lit], neighbour[lit]
        some, count = np.unique(of, return_counts=True)
        return Unreached(rows[some], np.concatenate([[0], np.cumsum(count)]), neighbour, np.delete(rows, some))


def directions(normals: np.ndarray) -> np.ndarray:
    """Return directions (n, DIRECTIONS, 3) float32 over each hemisphere, by the cosine: a spiral (Vogel 1979)."""
    k = np.arange(DIRECTIONS)
    r, angle = np.sqrt((k + 0.5) / DIRECTIONS), k * np.pi * (3 - np.sqrt(5))
    local = np.stack([r * np.cos(angle), r * np.sin(angle), np.sqrt(1 - r * r)], axis=1)
    across = np.cross(normals, np.where(np.abs(normals[:, :1]) > 0.5, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
    across /= np.sqrt((across * across).sum(axis=1))[:, None]
    frames = np.stack([across, np.cross(normals, across), normals], axis=1)
    return (local @ frames).astype(np.float32)


def dilated(irradiance: np.ndarray, *unreached: Unreached) -> Drawn:
    """Return irradiance (R, 3) with unreached receivers filled; the same array where there are none."""
    some = [u for u in unreached if len(u.rows)]
    if not some:
        return Drawn(irradiance, None)
    out, weights = irradiance.copy(), np.ones(len(irradiance), np.float32)
    for u in some:
        total = np.add.reduceat(irradiance[u.neighbours], u.first[:-1])
        out[u.rows] = total / np.diff(u.first)[:, None]
        weights[u.rows], weights[u.deep] = WEIGHT, WEIGHT * WEIGHT
    return Drawn(out, weights)

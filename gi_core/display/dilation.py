"""Dilation: in pictures, unreached vertices take the light of their lit neighbours.

Vertices inside another object (floor under a cupboard, wall behind a shelf) are black. Interpolation would carry the
black into the open, as dark teeth along every contact. A picture gives such a receiver the mean irradiance of its lit
neighbours and a weight near zero in its triangles. A column on the border of a shadow is then lit on one side down to
its foot. Irradiance itself, errors and invariants do not change.

A receiver with lit neighbours is *unreached* by one of three rules:

- inside: most of its directions hit the inside of solid objects, or it lies on their faces, and it has little of its
  neighbours' light;
- closed: most of its directions end nearby, and it is black. No neighbour in the open may be black: there the dark is
  real, as at the foot of a thin wall beside an unlit room;
- cut off: it is black, and surfaces lie between it and each lit neighbour, as at the end of a table leg below the
  floor. None of its faces may be black at all corners: that is a dark region.

Rays of receivers test their own object. Static receivers near a mobile also test the mobile, at each pose. Black
receivers of mobiles test the static part, as a chair's foot in a rug would darken the leg up to the seat.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.pause import pause, pieces
from gi_core.base.results import KEPT, digest
from gi_core.base.vectors import cross, dot, length
from gi_core.gather.hit_cache import pose_bits
from gi_core.gather.path_ends import BLACK
from gi_core.geometry.error import luminance
from gi_core.model import Model
from gi_core.rays.accelerator import LIFT, Transforms
from gi_core.rays.all_objects import rays_to_object
from gi_core.scene.pose import to_world_at

DIRECTIONS = 16


def directions(normals: np.ndarray) -> np.ndarray:
    """Return cosine-distributed directions (n, DIRECTIONS, 3) float32 about normals (n, 3), from steep to flat."""
    k = np.arange(DIRECTIONS)
    r, angle = np.sqrt((k + 0.5) / DIRECTIONS), k * np.pi * (3 - np.sqrt(5))
    local = np.stack([r * np.cos(angle), r * np.sin(angle), np.sqrt(1 - r * r)], axis=1)
    across = cross(normals, np.where(np.abs(normals[:, :1]) > 0.5, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
    across /= np.maximum(length(across), 1e-30)[:, None]  # no normal: no faces with area
    frames = np.stack([across, cross(normals, across), normals], axis=1)
    return (local @ frames).astype(np.float32)


LITTLE = 0.1  # the same inside solid objects, which light enters at corners by the radius of a disc
WEIGHT = 1e-3  # of an unreached receiver in its triangles; squared where it has no lit neighbour
UNKNOWN, OPEN, CLOSED, INSIDE_SOLID = -1, 0, 1, 2


class Unreached(NamedTuple):
    """Unreached receivers and their lit neighbours."""

    rows: np.ndarray  # (h,) int64, ascending
    first: np.ndarray  # (h + 1,) int64 into `neighbours`
    neighbours: np.ndarray  # (k,) int64
    enclosed: np.ndarray  # (d,) int64 unreached receivers without a lit neighbour


class Drawn(NamedTuple):
    """Irradiance for pictures, and the interpolation weight of each receiver."""

    irradiance: np.ndarray  # (R, 3) [W/m2]
    weights: np.ndarray | None  # (R,) float32: 1, WEIGHT or its square; None: all 1


NONE_UNREACHED = Unreached(np.zeros(0, np.int64), np.zeros(1, np.int64), *[np.zeros(0, np.int64)] * 2)


class Beside(NamedTuple):
    """Static receivers beside a mobile at a pose."""

    pose: bytes
    rows: np.ndarray  # (n,) int64, ascending
    pairs: tuple[np.ndarray, np.ndarray]  # of the rows, see _pairs()
    place: np.ndarray  # (n,) int8, UNKNOWN until rays have found it


class Dilation:
    """Search for unreached receivers of a scene. Ray results are cached; light and poses are arguments."""

    def __init__(self, model: Model, size: float):
        """size [m]: of the scene."""
        s, self._model = model.surfaces, model
        self._near = 0.06 * size  # a space narrower than 0.06 of the scene's size counts as closed
        points, self._normals = model.evaluation_points
        self._points = points.astype(np.float32)
        self._neighbours = model.linked
        self._static_columns = np.ascontiguousarray(self._points[s.receiver_range(0)].T)
        self._place = np.full(len(points), UNKNOWN, np.int8)
        # By mobile, at its last pose: a lamp's slider moves nothing.
        self._beside: dict[int, Beside] = {}
        self._in_static: dict[int, tuple[bytes, np.ndarray]] = {}  # place (n,) int8 of its receivers
        for o in range(s.objects):
            own, key = s.receiver_range(o), digest(model.shape_keys[o], self._near, float(model.world.size))
            if (places := model.results.get("places", key)) is not None:
                self._place[own] = places
            elif o > 0:
                self._place[own] = self._places(o, self._points[own], directions(self._normals[own]))
            # A view: those of the static part follow.
            model.results.keep("places", key, self._place[own], KEPT * s.objects)
        self._in_mobiles = np.flatnonzero(self._place == INSIDE_SOLID)
        self._in_mobiles_pairs = self._pairs(self._in_mobiles)

    def find_static(self, irradiance: np.ndarray) -> Unreached:
        """Find unreached static receivers by irradiance (n, 3) without mobiles."""
        light = luminance(irradiance)
        of, neighbour = self._pairs(np.arange(len(light)))
        brightest = _brightest(of, len(light), light[neighbour])
        black = light <= BLACK * brightest
        rows = np.flatnonzero(light <= LITTLE * brightest)
        pause()
        unknown = rows[self._place[rows] == UNKNOWN]
        for part in pieces(len(unknown)):
            at = unknown[part]
            self._place[at] = self._places(0, self._points[at], directions(self._normals[at]))
        place = self._place[: len(light)]
        inside = rows[place[rows] == INSIDE_SOLID]
        closed = self._without_dark_beside(np.flatnonzero(black & (place == CLOSED)), black & (place == OPEN))
        cut_off = self._cut_off(
            np.setdiff1d(np.flatnonzero(black & (place == OPEN)), self._of_black_faces(black)), black
        )
        return self._unreached(np.unique(np.concatenate([inside, closed, cut_off])), irradiance)

    def _without_dark_beside(self, rows: np.ndarray, dark: np.ndarray) -> np.ndarray:
        """Return the rows without a neighbour in `dark` (n,) bool."""
        of, neighbour = self._pairs(rows)
        return np.delete(rows, of[dark[neighbour]])

    def _of_black_faces(self, black: np.ndarray) -> np.ndarray:
        """Return the corners of the static faces whose corners are all black (n,) bool."""
        corners = self._model.corners(0)
        return np.unique(corners[black[corners].all(axis=1)])

    def _cut_off(self, rows: np.ndarray, black: np.ndarray) -> np.ndarray:
        """Return the rows that a surface separates from each neighbour that is not `black` (n,) bool."""
        of, neighbour = self._pairs(rows)
        of, neighbour = of[~black[neighbour]], neighbour[~black[neighbour]]
        start = self._points[neighbour]
        way = self._points[rows[of]] - start
        far = np.maximum(length(way), np.float32(1e-30))
        # 1e-3 of the distance to a neighbour is left out at both ends, where faces meet
        limits = far * np.float32(1 - 1e-3)
        _, face = self._model.accelerator.opaque.nearest(0, start, way / far[:, None], limits)
        return np.delete(rows, of[face < 0])

    def find_moved(self, irradiance: np.ndarray, at: Transforms) -> Unreached:
        """Find static receivers under mobiles at these poses, and receivers of mobiles inside these or the static part.

        irradiance (R, 3): of the frame.
        """
        rows = [find(o, irradiance, at) for o in range(1, len(at.position)) for find in (self._under, self._sunk)]
        rows.append(self._in_mobiles[_is_dark(self._in_mobiles, self._in_mobiles_pairs, irradiance, LITTLE)])
        return self._unreached(np.unique(np.concatenate(rows)), irradiance)

    def _under(self, o: int, irradiance: np.ndarray, at: Transforms) -> np.ndarray:
        """Return the rows of dark static receivers that mobile o encloses."""
        if o not in self._beside or self._beside[o].pose != pose_bits(at, o):
            rows = self._static_near(o, at)
            self._beside[o] = Beside(pose_bits(at, o), rows, self._pairs(rows), np.full(len(rows), UNKNOWN, np.int8))
        _, near, pairs, place = self._beside[o]
        # where a side meets the grid of the floor, paths bring a sixth of the light beside
        dark = np.flatnonzero(_is_dark(near, pairs, irradiance, 0.25))
        if len(unknown := dark[place[dark] == UNKNOWN]):
            rows = near[unknown]
            origins = np.repeat(self._points[rows], DIRECTIONS, axis=0)
            rays = directions(self._normals[rows]).reshape(-1, 3)
            place[unknown] = self._places(o, *rays_to_object(at, o, origins, rays))
        black = _is_dark(near, pairs, irradiance, BLACK)[dark]
        return near[dark[(place[dark] == INSIDE_SOLID) | (black & (place[dark] == CLOSED))]]

    def _sunk(self, o: int, irradiance: np.ndarray, at: Transforms) -> np.ndarray:
        """Return the rows of black receivers of mobile o that the static part encloses."""
        own = self._model.surfaces.receiver_range(o)
        light = luminance(irradiance[own])
        may_be = (light <= BLACK * light.max(initial=0.0)) & (self._place[own] != INSIDE_SOLID)
        rows = own.start + np.flatnonzero(may_be)
        rows = rows[_is_dark(rows, self._pairs(rows), irradiance, BLACK)]
        if o not in self._in_static or self._in_static[o][0] != pose_bits(at, o):
            self._in_static[o] = pose_bits(at, o), np.full(own.stop - own.start, UNKNOWN, np.int8)
        place = self._in_static[o][1]
        if len(unknown := rows[place[rows - own.start] == UNKNOWN]):
            R, p = at.rotation[o, None], at.position[o, None]
            normals = to_world_at(R, 0 * p, self._normals[unknown])
            points = to_world_at(R, p, self._points[unknown]).astype(np.float32)
            place[unknown - own.start] = self._places(0, points, directions(normals))
        return rows[place[rows - own.start] != OPEN]

    def _static_near(self, o: int, at: Transforms) -> np.ndarray:
        """Return the rows of static receivers in the box round the bounding sphere of mobile o."""
        world = self._model.world
        middle = (at.rotation[o] @ world.sphere_centre[o] + at.position[o]).astype(np.float32)
        rows, r = np.arange(self._static_columns.shape[1]), np.float32(world.sphere_radius[o])
        for x, m in zip(self._static_columns, middle, strict=True):
            rows = rows[np.abs(x[rows] - m) < r]
        return rows

    def _places(self, o: int, points: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Return the place (n,) int8 (OPEN, CLOSED or INSIDE_SOLID) of each of n points, in object o's space.

        points (n, 3) or (n DIRECTIONS, 3) float32, rays (n DIRECTIONS, 3) float32 unit.
        """
        s, rays = self._model.surfaces, rays.reshape(-1, 3)
        origins = points if len(points) == len(rays) else np.repeat(points, DIRECTIONS, axis=0)
        limits = np.full(len(rays), self._model.world.size, np.float32)
        distance, face = self._model.accelerator.opaque.nearest(o, origins, rays, limits)
        behind = (face >= 0) & (dot(s.normals[face], rays) > 0) & ~s.two_sided[face]
        behind |= distance <= LIFT * np.abs(origins).max(axis=1)  # on a face, as at the foot of a box in the grid
        inside, near = ((a.reshape(-1, DIRECTIONS).mean(axis=1) > 0.5) for a in (behind, distance < self._near))
        return np.where(inside, INSIDE_SOLID, np.where(near, CLOSED, OPEN)).astype(np.int8)

    def _pairs(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return all neighbours of the rows, and for each the index into `rows`."""
        first = self._neighbours.first[rows]
        count = self._neighbours.first[rows + 1] - first
        of = np.repeat(np.arange(len(rows)), count)
        within = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        return of, self._neighbours.of[first[of] + within].astype(np.int64)

    def _unreached(self, rows: np.ndarray, irradiance: np.ndarray) -> Unreached:
        """Return the rows (n,), ascending, with their lit neighbours, by irradiance (R, 3)."""
        of, neighbour = self._pairs(rows)
        light = luminance(irradiance.take(neighbour, axis=0))
        is_lit = np.ones(len(irradiance), bool)
        is_lit[rows] = False
        lit = is_lit[neighbour] & (light > BLACK * _brightest(of, len(rows), light)[of])
        count = np.bincount(of[lit], minlength=len(rows))
        has_lit = count > 0
        return Unreached(rows[has_lit], np.append(0, np.cumsum(count[has_lit])), neighbour[lit], rows[~has_lit])


def _is_dark(
    rows: np.ndarray, pairs: tuple[np.ndarray, np.ndarray], irradiance: np.ndarray, share: float
) -> np.ndarray:
    """Return which of the rows (n,) bool have at most a share of their brightest neighbour's light."""
    of, neighbour = pairs
    own, beside = (luminance(irradiance.take(receivers, axis=0)) for receivers in (rows, neighbour))
    return own <= share * _brightest(of, len(rows), beside)


def _brightest(of: np.ndarray, n: int, light: np.ndarray) -> np.ndarray:
    """Return the light of the brightest neighbour of n rows, 0 where there is none; of (k,), light (k,): of each."""
    out = np.zeros(n)
    np.fmax.at(out, of, light)  # nan: unknown
    return out


def dilated(irradiance: np.ndarray, *unreached: Unreached) -> Drawn:
    """Return irradiance (R, 3) with unreached receivers filled, and weights; the same array if there are none."""
    nonempty = [u for u in unreached if len(u.rows)]
    if not nonempty:
        return Drawn(irradiance, None)
    out, weights = irradiance.copy(), np.ones(len(irradiance), np.float32)
    for u in nonempty:
        total = np.add.reduceat(irradiance.take(u.neighbours, axis=0), u.first[:-1])
        out[u.rows] = total / np.diff(u.first)[:, None]
        weights[u.rows], weights[u.enclosed] = WEIGHT, WEIGHT * WEIGHT
    return Drawn(out, weights)


class UnreachedReceivers:
    """`static` are those of the static part, by the light of the last search."""

    def __init__(self, model: Model):
        self.static = NONE_UNREACHED
        self._model = model
        self._dilation: Dilation | None = None

    def find(self, light: np.ndarray) -> None:
        """Find static ones by irradiance (n, 3) without mobiles.

        light: of all lamps; without one of them, its places would be dark, not unreached.
        """
        if self._dilation is None:
            self._dilation = Dilation(self._model, self._model.scene_size)
            pause()
        self.static = self._dilation.find_static(light)

    def drawn(self, irradiance: np.ndarray, at: Transforms) -> Drawn:
        """Return irradiance (R, 3) at poses for pictures, unreached ones filled; as it is before the search."""
        if self._dilation is None:
            return Drawn(irradiance, None)
        return dilated(irradiance, self.static, self._dilation.find_moved(irradiance, at))

"""Receivers that nobody sees, and what is drawn in their place.

Where one thing stands on another, vertices of the one lie inside the other: floor under a cupboard, wall behind a
shelf. They are black, rightly, but their triangles reach out into the open, and interpolation carries the black with
it: dark teeth along every contact. What can be seen of its triangles is to go on as it is beside it. So such a receiver
has a colour, the mean of its visible neighbours, but next to no say in its triangles: a picture interpolates with the
weights of `Drawn`. A column that stands on the line between light and shade is then lit on one side up to its foot,
dark on the other. Irradiance itself stays what it is: errors are told of that.

A receiver is *hidden* if little light reaches it and it lies inside solid things (most of what it looks at is their
inside), or next to none does and it lies in a closed space (most of what it looks at is near). It must have lit
neighbours; in a closed space none may be merely dark: at the foot of a thin wall beside an unlit room nothing is
carried over. A *speck* counts as hidden too: it is black wherever it lies, but nearly all round it is lit. No light
ends like that; few paths or photons have missed it so far. So does the *end* of a thing that pokes through a wall, no
farther than its last triangles: black, none of its faces black altogether, and cut off from each lit neighbour.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from gi_core.error import luminance
from gi_core.evaluation_points import evaluation_points
from gi_core.model import Model
from gi_core.rows import dot

LOOKS = 16  # directions
NEAR = 0.06  # of the scene's size: a space that is no wider is no room
CHUNK = 2048  # receivers a step: some 10 ms
BLACK = 0.02  # of a neighbour's light, that is nothing: a photon in a million slips through where edges meet
LITTLE = 0.1  # the same inside a solid thing, where what there is came through its corners by the radius of a disc
ROUND = 0.7  # of the corners of the faces round a speck, that are lit: at the corner of a dark region two thirds are
SHORT = 1e-3  # of the way to a neighbour, which is not looked along: there are the faces that meet there
SAY = 1e-3  # of a visible receiver's, that a hidden one has in its triangles; of that, one farther inside
UNKNOWN, OPEN, CLOSED, INSIDE = -1, 0, 1, 2


class Hidden(NamedTuple):
    """Hidden receivers and their visible neighbours; a neighbour counts as often as faces join the two."""

    rows: np.ndarray  # (h,) int64, ascending
    first: np.ndarray  # (h + 1,) int64 into `neighbours`
    neighbours: np.ndarray  # (k,) int64
    deep: np.ndarray  # (d,) int64 receivers beside these that lie in there too, but have no visible neighbour


class Drawn(NamedTuple):
    """Irradiance for pictures, and how much each receiver counts where a triangle is interpolated."""

    irradiance: np.ndarray  # (R, 3) [W/m2]
    weights: np.ndarray | None  # (R,) float32: 1, SAY, or its square; None: all 1


NONE_HIDDEN = Hidden(np.zeros(0, np.int64), np.zeros(1, np.int64), *[np.zeros(0, np.int64)] * 2)


class HiddenReceivers:
    """Finds them in the static part of a scene; what has been looked at once is remembered."""

    def __init__(self, model: Model, size: float):
        """size [m]: of what light falls on, as `gi_core.defaults` finds it."""
        self._model, self._near, self._corners = model, NEAR * size, model.corners(0)
        self._closed = np.full(model.surfaces.receiver_range(0).stop, UNKNOWN, np.int8)
        self._points: tuple[np.ndarray, np.ndarray] | None = None

    def find(self, irradiance: np.ndarray) -> Generator[None, None, Hidden]:
        """Find the hidden ones by the light (n, 3) of the static part without mobiles, in steps; returns them."""
        light, peak = luminance(irradiance), np.zeros(len(irradiance))
        of_face = light[self._corners].max(axis=1)
        for corner in self._corners.T:
            np.maximum.at(peak, corner, of_face)
        lit = light > BLACK * peak
        faint = light <= LITTLE * peak
        yield
        few = np.flatnonzero(faint & lit)
        yield from self._look_round(few)
        lit[few[self._closed[few] == INSIDE]] = False
        speck = ~lit & (self._share_round(lit) >= ROUND)
        black = ~lit[self._corners]
        mixed = black.any(axis=1) & ~black.all(axis=1)
        candidate = np.zeros(len(lit), bool)
        candidate[self._corners[mixed][black[mixed]]] = True
        yield
        beside = candidate[self._corners].any(axis=1)
        concerned = np.zeros(len(lit), bool)
        concerned[self._corners[beside][black[beside]]] = True
        yield from self._look_round(np.flatnonzero(concerned))
        dark = np.zeros(len(lit), bool)
        dark[self._corners[(~lit & ~speck & (self._closed == OPEN))[self._corners].any(axis=1)]] = True
        nobody_sees = ~lit & ((self._closed == INSIDE) | ((self._closed == CLOSED) & ~dark) | speck)
        yield
        ends = candidate & ~nobody_sees
        ends[self._corners[black.all(axis=1)].reshape(-1)] = False
        nobody_sees |= self._cut_off(*_pairs(self._corners[mixed], ends, lit), ends)
        yield
        candidate &= nobody_sees
        beside = candidate[self._corners].any(axis=1)
        deep = np.zeros(len(lit), bool)
        deep[self._corners[beside]] = True
        deep &= nobody_sees & ~candidate
        return _with_neighbours(self._corners[mixed], candidate, lit, np.flatnonzero(deep))

    def _share_round(self, lit: np.ndarray) -> np.ndarray:
        """Return the share (n,) of lit ones among the other corners of each receiver's faces; 0 where it has none."""
        count, of = np.zeros(len(lit)), np.zeros(len(lit))
        others = lit[self._corners].sum(axis=1)
        for corner in self._corners.T:
            count += np.bincount(corner, others - lit[corner], len(lit))
            of += np.bincount(corner, minlength=len(lit))
        return count / np.maximum(2 * of, 1)

    def _look_round(self, rows: np.ndarray):
        """Find out which receivers lie in a closed space, those that are not yet known."""
        if self._points is None:
            n = len(self._closed)
            points, normals = evaluation_points(self._model.surfaces, self._model.object_receivers)
            self._points = points[:n], normals[:n]
            yield
        rows = rows[self._closed[rows] == UNKNOWN]
        for first in range(0, len(rows), CHUNK):
            some = rows[first : first + CHUNK]
            self._closed[some] = self._are_closed(self._points[0][some], self._points[1][some])
            yield

    def _cut_off(self, of: np.ndarray, neighbour: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return which of `ends` (n,) bool see none of their neighbours, pairs of rows, past other surfaces."""
        points, towards = (self._points[0][rows].astype(np.float32) for rows in (neighbour, of))
        way = towards - points
        length = np.sqrt((way * way).sum(axis=1))
        far = length > 0
        way[far] /= length[far, None]
        _, face = self._model.accelerator.nearest(0, points, way, length * np.float32(1 - SHORT))
        out = ends.copy()
        out[of[face < 0]] = False
        return out

    def _are_closed(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        inside, distance = look_round(self._model, 0, points, normals)
        near = np.median(distance, axis=1) < self._near
        return np.where(inside, INSIDE, np.where(near, CLOSED, OPEN))


def look_round(model: Model, o: int, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which points of object o lie inside solid things of it, (n,) bool, and how far each looks, (n, LOOKS)
    float32 [m]. points (n, 3), normals (n, 3) in its own space."""
    n = len(points)
    rays = directions(normals).reshape(-1, 3)
    origins = np.repeat(points.astype(np.float32), LOOKS, axis=0)
    distance, face = model.accelerator.nearest(o, origins, rays, np.full(n * LOOKS, model.world.size, np.float32))
    behind = dot(model.surfaces.normals[face], rays) > 0
    inside = (face >= 0) & behind & ~model.surfaces.two_sided[face]
    return inside.reshape(n, LOOKS).mean(axis=1) > 0.5, distance.reshape(n, LOOKS)


def directions(normals: np.ndarray) -> np.ndarray:
    """Return directions (n, LOOKS, 3) float32 over each hemisphere, by the cosine: a spiral (Vogel 1979)."""
    k = np.arange(LOOKS)
    r, angle = np.sqrt((k + 0.5) / LOOKS), k * np.pi * (3 - np.sqrt(5))
    local = np.stack([r * np.cos(angle), r * np.sin(angle), np.sqrt(1 - r * r)], axis=1)
    across = np.cross(normals, np.where(np.abs(normals[:, :1]) > 0.5, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
    across /= np.sqrt((across * across).sum(axis=1))[:, None]
    frames = np.stack([across, np.cross(normals, across), normals], axis=1)
    return (local @ frames).astype(np.float32)


def _pairs(corners: np.ndarray, hidden: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """Return (2, k) int64: hidden receivers, and beside each a lit corner of one of its faces (m, 3)."""
    pairs = []
    for a in range(3):
        for b in ((a + 1) % 3, (a + 2) % 3):
            both = hidden[corners[:, a]] & lit[corners[:, b]]
            pairs.append(corners[both][:, [a, b]])
    return np.concatenate(pairs).astype(np.int64).T


def _with_neighbours(corners: np.ndarray, hidden: np.ndarray, lit: np.ndarray, deep: np.ndarray) -> Hidden:
    """Return the hidden receivers with the lit corners of their faces (m, 3)."""
    of, neighbour = _pairs(corners, hidden, lit)
    order = np.lexsort((neighbour, of))
    rows, count = np.unique(of, return_counts=True)
    return Hidden(rows, np.concatenate([[0], np.cumsum(count)]), neighbour[order], deep)


def drawn(irradiance: np.ndarray, *hidden: Hidden) -> Drawn:
    """Return irradiance (R, 3) with hidden receivers as they are drawn; the same array where there are none."""
    some = [h for h in hidden if len(h.rows)]
    if not some:
        return Drawn(irradiance, None)
    out, weights = irradiance.copy(), np.ones(len(irradiance), np.float32)
    for h in some:
        total = np.add.reduceat(irradiance[h.neighbours], h.first[:-1])
        out[h.rows] = total / np.diff(h.first)[:, None]
        weights[h.rows], weights[h.deep] = SAY, SAY * SAY
    return Drawn(out, weights)

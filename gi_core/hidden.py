"""Receivers that nobody sees, and what is drawn in their place.

Where one thing stands on another, vertices of the one lie inside the other: floor under a cupboard, wall behind a
shelf. They are black, rightly, but their triangles reach out into the open, and interpolation carries the black with
it: dark teeth along every contact. Such a receiver is drawn with the mean of its visible neighbours, so that what can
be seen of its triangles goes on as it is beside it. Irradiance itself stays what it is: errors are told of that.

A receiver is *hidden* if next to no light reaches it, it lies in a closed space (most of what it looks at is the inside
of solid things, or near), it has lit neighbours, and no neighbour is merely dark: at the foot of a thin wall beside an
unlit room nothing is carried over.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from gi_core.error import luminance
from gi_core.evaluation_points import evaluation_points
from gi_core.model import Model

LOOKS = 16  # directions
NEAR = 0.06  # of the scene's size: a space that is no wider is no room
CHUNK = 2048  # receivers a step: some 10 ms
BLACK = 0.02  # of a neighbour's light, that is nothing: a photon in a million slips through where edges meet
UNKNOWN, OPEN, CLOSED = -1, 0, 1


class Hidden(NamedTuple):
    """Hidden receivers and their visible neighbours; a neighbour counts as often as faces join the two."""

    rows: np.ndarray  # (h,) int64, ascending
    first: np.ndarray  # (h + 1,) int64 into `neighbours`
    neighbours: np.ndarray  # (k,) int64


NONE_HIDDEN = Hidden(np.zeros(0, np.int64), np.zeros(1, np.int64), np.zeros(0, np.int64))


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
        yield
        black = ~lit[self._corners]
        mixed = black.any(axis=1) & ~black.all(axis=1)
        candidate = np.zeros(len(lit), bool)
        candidate[self._corners[mixed][black[mixed]]] = True
        yield
        beside = candidate[self._corners].any(axis=1)
        concerned = np.zeros(len(lit), bool)
        concerned[self._corners[beside][black[beside]]] = True
        yield from self._look_round(np.flatnonzero(concerned))
        candidate &= self._closed == CLOSED
        dark = (~lit & (self._closed == OPEN))[self._corners].any(axis=1)
        candidate[self._corners[dark].reshape(-1)] = False
        return _with_neighbours(self._corners[mixed], candidate, lit)

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

    def _are_closed(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        model, n = self._model, len(points)
        rays = directions(normals).reshape(-1, 3)
        origins = np.repeat(points.astype(np.float32), LOOKS, axis=0)
        limits = np.full(n * LOOKS, model.world.size, np.float32)
        distance, face = model.accelerator.nearest(0, origins, rays, limits)
        behind = (model.surfaces.normals[face] * rays).sum(axis=1) > 0
        inside = (face >= 0) & behind & ~model.surfaces.two_sided[face]
        near = np.median(distance.reshape(n, LOOKS), axis=1) < self._near
        return np.where(near | (inside.reshape(n, LOOKS).mean(axis=1) > 0.5), CLOSED, OPEN)


def directions(normals: np.ndarray) -> np.ndarray:
    """Return directions (n, LOOKS, 3) float32 over each hemisphere, by the cosine: a spiral (Vogel 1979)."""
    k = np.arange(LOOKS)
    r, angle = np.sqrt((k + 0.5) / LOOKS), k * np.pi * (3 - np.sqrt(5))
    local = np.stack([r * np.cos(angle), r * np.sin(angle), np.sqrt(1 - r * r)], axis=1)
    across = np.cross(normals, np.where(np.abs(normals[:, :1]) > 0.5, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
    across /= np.sqrt((across * across).sum(axis=1))[:, None]
    frames = np.stack([across, np.cross(normals, across), normals], axis=1)
    return (local @ frames).astype(np.float32)


def _with_neighbours(corners: np.ndarray, hidden: np.ndarray, lit: np.ndarray) -> Hidden:
    """Return the hidden receivers with the lit corners of their faces (m, 3)."""
    pairs = []
    for a in range(3):
        for b in ((a + 1) % 3, (a + 2) % 3):
            both = hidden[corners[:, a]] & lit[corners[:, b]]
            pairs.append(corners[both][:, [a, b]])
    of, neighbour = np.concatenate(pairs).astype(np.int64).T
    order = np.lexsort((neighbour, of))
    rows, count = np.unique(of, return_counts=True)
    return Hidden(rows, np.concatenate([[0], np.cumsum(count)]), neighbour[order])


def drawn(irradiance: np.ndarray, *hidden: Hidden) -> np.ndarray:
    """Return irradiance (R, 3) with hidden receivers as they are drawn; the same array where there are none."""
    some = [h for h in hidden if len(h.rows)]
    if not some:
        return irradiance
    out = irradiance.copy()
    for h in some:
        total = np.add.reduceat(irradiance[h.neighbours], h.first[:-1])
        out[h.rows] = total / np.diff(h.first)[:, None]
    return out

"""Directions of light at the receivers of glossy faces: integer moments in a fixed hierarchy of cells.

Report 2.10 stores the rays that reach a glossy vertex, and 2.10.1 summarises them in a QuadTree, whose list "gets
degraded after repeated insertion and deletion". Here a cell holds integer sums of its rays: flux per channel, and flux
times direction. Inserting and removing a ray cancel exactly, so no history degrades them.

Cells describe how light is distributed over directions; its irradiance comes from the frame, so gloss shares the
estimator, gathered light and artifact control of the diffuse part. Rays are the segments that cross the receiver's
disc, with any estimator.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import basis
from gi_core.base.threads import run_ranges
from gi_core.gloss.discs import GRAIN, GlossDiscs
from gi_core.gloss.hemisphere import CELLS, cell_of, centres
from gi_core.gloss.radiance import GRAZING, Directions
from gi_core.gloss.rays import RayTree
from gi_core.photons.paths import PathVertices, Segments, segments_of
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange

FIELDS = 6  # of a cell, see GlossLight
SUMS = 7  # of a cell: flux of three channels, weight times direction (x, y, z) in the object's space, and weight
FLUX_SHIFT = 12  # bits of flux left out of moments ...
DIRECTION_BITS = 14  # ... and bits of a direction: 2^36.2 at most per ray, 2^26 rays in 63 bits
PART = 8192  # photons added at a time
MOST_PHOTONS = 1 << 18  # in the sums: directions need no more


class GlossLight(NamedTuple):
    """Directional light of a frame at n glossy receivers. The arrays are never written to again.

    A cell holds the share of irradiance that arrives through it, per channel, and the mean direction towards that light
    in the object's space: (red, green, blue, x, y, z). The mean is shorter than 1 where directions spread. Rays weigh
    flux / sqrt(cos), between irradiance and radiance.
    """

    rows: np.ndarray  # (n,) int64, receivers, ascending
    resting: np.ndarray  # (n, CELLS, 6) float32, without mobiles; zeros of receivers on mobiles
    changed: np.ndarray  # (k,) int64 into rows, ascending
    cells: np.ndarray  # (k, CELLS, 6) float32, in place of `resting`
    tree: RayTree | None = None  # the rays one by one, see `gi_core.gloss.rays`; None: cells alone
    opened: float = 0.0  # see Directions

    def directions(self) -> Directions:
        """Return the light of all receivers."""
        cells, tree = self.resting.copy(), self.tree
        cells[self.changed] = self.cells
        if tree is None:
            return Directions(cells, np.zeros(1, np.int64), np.empty((0, FIELDS), np.float32))
        return Directions(cells, tree.offsets, tree.rays, self.opened)


class GlossCells:
    """Sums of a scene's glossy receivers. Not thread safe."""

    def __init__(self, discs: GlossDiscs):
        self.discs, static = discs, discs.count(0)
        self._sums, self._delta = (np.zeros((static, CELLS, SUMS), np.int64) for _ in range(2))
        self._resting = np.zeros((len(discs.rows), CELLS, FIELDS), np.float32)
        self._store: object = None  # of the photons in the sums
        self._weights = np.ones((discs.model.emitters.lamps.count, 3))
        self.photons = self._rested = 0  # in the sums, and in `_resting`

    def bring_in(self, store: object, paths: PathVertices, weights: np.ndarray) -> Iterator[None]:
        """Add the photons of `paths` that are not yet in the sums, in steps; weights (G, 3): of the lamps' flux.

        store: identifies the photons. The sums begin anew when it or the weights differ from the last call.
        """
        if store is not self._store or not np.array_equal(weights, self._weights):
            self._store, self._weights, self.photons, self._rested = store, weights.copy(), 0, 0
            self._sums[:] = 0
        count, model = min(len(paths.offsets) - 1, MOST_PHOTONS), self.discs.model
        while self.photons < count:
            last = min(self.photons + PART, count)
            segments = segments_of(paths, model.eps, self.photons, last)
            self._deposit(0, segments, model.static, 1, self._sums)
            self.photons = last
            yield
        if self._rested != self.photons:
            resting, everything = self._resting.copy(), np.arange(len(self._sums))
            _shares(self._sums, self._delta, 0.0, everything, self.discs.normals_of(0), centres(), resting)
            self._resting, self._rested = resting, self.photons

    def evaluate(self, change: PoseChange) -> GlossLight:
        """Return the light of a frame's poses. Its photons may be fewer or more than those in the sums."""
        touched = np.zeros(len(self._delta), bool)
        removed = change.removed_suffixes.segments(self.discs.model.threads)
        for sign, segments in ((-1, removed), (1, change.new_suffixes)):
            touched[self._deposit(0, segments, change.at, sign, self._delta)] = True
        changed = np.flatnonzero(touched)
        cells = np.empty((len(changed), CELLS, FIELDS), np.float32)
        scale = self.photons / max(change.photons, 1)
        _shares(self._sums, self._delta, scale, changed, self.discs.normals_of(0), centres(), cells)
        self._delta[changed] = 0
        parts, rows = [cells], [changed]
        for o, segments in enumerate(change.near_mobiles, 1):
            count = self.discs.count(o)
            sums = np.zeros((count, CELLS, SUMS), np.int64)
            self._deposit(o, segments, change.at, 1, sums)
            parts.append(np.empty((count, CELLS, FIELDS), np.float32))
            _shares(sums, sums, 0.0, np.arange(count), self.discs.normals_of(o), centres(), parts[-1])
            rows.append(self.discs.first[o] + np.arange(count))
        return GlossLight(self.discs.rows, self._resting, np.concatenate(rows), np.concatenate(parts))

    def current_sums(self, change: PoseChange) -> np.ndarray:
        """Return the sums (static rows, CELLS, SUMS) int64 of a frame of as many photons as are in the sums."""
        out = self._sums.copy()
        removed = change.removed_suffixes.segments(self.discs.model.threads)
        for sign, segments in ((-1, removed), (1, change.new_suffixes)):
            self._deposit(0, segments, change.at, sign, out)
        return out

    def from_scratch(self, parts: Iterable[Segments], at: Transforms) -> np.ndarray:
        """Return the sums (static rows, CELLS, SUMS) int64 from all current segments: those of current_sums()."""
        out = np.zeros_like(self._sums)
        for segments in parts:
            self._deposit(0, segments, at, 1, out)
        return out

    def _deposit(self, o: int, segments: Segments, at: Transforms, sign: int, sums: np.ndarray) -> np.ndarray:
        """Add `sign` times the rays of segments to the cells of object o's receivers; return the receivers touched."""
        found, normals = self.discs.crossed(o, segments, at), self.discs.normals_of(o)

        def add(_, first, last):
            for c in found:
                rays = c.line, c.receiver, c.lines.direction, c.lines.flux, c.lines.lamp
                _add(*rays, self._weights, normals, sign, first, last, sums)

        if found:
            run_ranges(add, len(sums), self.discs.model.threads, GRAIN)
        return np.unique(np.concatenate([np.empty(0, np.int32), *(c.receiver for c in found)]))


@kernel
def _add(line, receiver, direction, flux, lamp, weights, normals, sign, first, last, sums):
    """Add rays to the cells of receivers first .. last - 1."""
    for j in range(len(line)):
        i, k = receiver[j], line[j]
        if i < first or i >= last:
            continue
        x, y, z = -float(direction[k, 0]), -float(direction[k, 1]), -float(direction[k, 2])
        n = normals[i]
        ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
        u, v, w = x * ax + y * ay + z * az, x * bx + y * by + z * bz, x * n[0] + y * n[1] + z * n[2]
        cell, total = cell_of(u, v, w), np.int64(0)
        for c in range(3):
            q = np.int64(flux[k, c] * weights[lamp[k], c] + 0.5)
            total += q
            sums[i, cell, c] += sign * q
        weight = np.int64((total >> FLUX_SHIFT) / math.sqrt(max(w, GRAZING)) + 0.5)
        sums[i, cell, 6] += sign * weight
        sums[i, cell, 3] += sign * weight * np.int64(math.floor(x * (1 << DIRECTION_BITS) + 0.5))
        sums[i, cell, 4] += sign * weight * np.int64(math.floor(y * (1 << DIRECTION_BITS) + 0.5))
        sums[i, cell, 5] += sign * weight * np.int64(math.floor(z * (1 << DIRECTION_BITS) + 0.5))


@kernel
def _shares(sums, delta, scale, rows, normals, middles, out):
    """Write shares and mean directions of sums + scale x delta of some rows (k,) to out (k, CELLS, 6)."""
    for j in range(len(rows)):
        i = rows[j]
        red = green = blue = 0.0
        for c in range(CELLS):
            red += max(0.0, sums[i, c, 0] + scale * delta[i, c, 0])
            green += max(0.0, sums[i, c, 1] + scale * delta[i, c, 1])
            blue += max(0.0, sums[i, c, 2] + scale * delta[i, c, 2])
        n = normals[i]
        ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
        for c in range(CELLS):
            out[j, c, 0] = max(0.0, sums[i, c, 0] + scale * delta[i, c, 0]) / red if red > 0.0 else 0.0
            out[j, c, 1] = max(0.0, sums[i, c, 1] + scale * delta[i, c, 1]) / green if green > 0.0 else 0.0
            out[j, c, 2] = max(0.0, sums[i, c, 2] + scale * delta[i, c, 2]) / blue if blue > 0.0 else 0.0
            x = sums[i, c, 3] + scale * delta[i, c, 3]
            y = sums[i, c, 4] + scale * delta[i, c, 4]
            z = sums[i, c, 5] + scale * delta[i, c, 5]
            size = math.sqrt(x * x + y * y + z * z)
            whole = (sums[i, c, 6] + scale * delta[i, c, 6]) * (1 << DIRECTION_BITS)
            if size > 0.0:
                size = max(size, whole)
            else:
                m = middles[c]
                x = m[0] * ax + m[1] * bx + m[2] * n[0]
                y = m[0] * ay + m[1] * by + m[2] * n[1]
                z = m[0] * az + m[1] * bz + m[2] * n[2]
                size = 1.0
            out[j, c, 3], out[j, c, 4], out[j, c, 5] = x / size, y / size, z / size

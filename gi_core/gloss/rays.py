"""Rays that reach each glossy receiver, kept one by one: the list of report 2.10, and its QuadTree with all rays.

The report stores the rays that affect a vertex, and checks removed and new ones against that list. A ray is named by
photon and bounce. A frame is the list at rest without the removed rays and with the new ones, and equals the list from
scratch, bit for bit. Rays lie in the order of the hierarchy's cells, so one array serves as list and as QuadTree.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.pause import pause
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.gloss.discs import GlossDiscs, Intake
from gi_core.gloss.hemisphere import CELLS, axes_of, cell_towards
from gi_core.photons.paths import PathVertices, Segments, segments_of
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange

MOST_LISTED_PHOTONS = 1 << 18
MOST_RAYS = 1 << 23  # 270 MB; a scene of more takes rays from fewer photons
PHOTON_BITS, BOUNCE_BITS, CELL_BITS = 18, 19, 6
RECEIVER_BIT = PHOTON_BITS + BOUNCE_BITS + CELL_BITS  # of a ray's key; receivers have the 20 bits above


class RayTree(NamedTuple):
    """Rays of a frame at n glossy receivers, in the order of receiver, cell, photon and bounce. Never written again."""

    offsets: np.ndarray  # (n CELLS + 1,) int64: cell c of receiver i has rays offsets[i CELLS + c] and following
    rays: np.ndarray  # (m, 6) float32: shares of the receiver's red, green and blue; direction towards the light


class _Rays(NamedTuple):
    key: np.ndarray  # (m,) int64, ascending: receiver, cell, photon, bounce
    flux: np.ndarray  # (m, 3) float32, fixed-point units
    direction: np.ndarray  # (m, 3) float32, towards the light, in the object's space

    @property
    def receiver(self) -> np.ndarray:
        return self.key >> RECEIVER_BIT

    @property
    def photon(self) -> np.ndarray:
        return (self.key >> BOUNCE_BITS) & ((1 << PHOTON_BITS) - 1)

    def where(self, wanted: np.ndarray) -> _Rays:
        return _Rays(*(a[wanted] for a in self))


class RayLists:
    """Rays at the receivers of `discs`. Not thread safe."""

    def __init__(self, discs: GlossDiscs):
        self.discs, self._intake = discs, Intake(discs.model.emitters.lamps.count)
        self._rays, self._parts = _joined([]), []

    @property
    def photons(self) -> int:
        """Photons in the lists."""
        return self._intake.photons

    def bring_in(self, store: object, paths: PathVertices, weights: np.ndarray) -> None:
        """Add the photons of `paths` that are not yet in the lists; arguments as for GlossCells."""
        if self._intake.begins_anew(store, weights):
            self._rays, self._parts = _joined([]), []
        count, model = min(len(paths.offsets) - 1, MOST_LISTED_PHOTONS), self.discs.model
        held = len(self._rays.key) + sum(len(p.key) for p in self._parts)
        while self.photons < count and held < MOST_RAYS:
            last = self._intake.end_of_part(count)
            self._parts.append(self._found(0, segments_of(paths, self.photons, last), model.static))
            self._intake.photons, held = last, held + len(self._parts[-1].key)
            pause()
        if self._parts:
            self._rays, self._parts = _joined([self._rays, *self._parts]), []

    def evaluate(self, change: PoseChange) -> RayTree:
        """Return the rays of a frame. Receivers whose rays changed have those of the frame's photons alone."""
        photons = min(self.photons, change.photons)
        return _tree(self._of_frame(change, photons), len(self.discs.rows))

    def _of_frame(self, change: PoseChange, photons: int) -> _Rays:
        removed, new = (
            self._found(0, segments, change.at, photons)
            for segments in (change.removed_suffixes.segments(self.discs.model.threads), change.new_suffixes)
        )
        resting = self._rays
        keep = np.ones(len(resting.key), bool)
        keep[np.searchsorted(resting.key, removed.key)] = False
        if photons < self.photons:
            touched = np.zeros(self.discs.count(0), bool)
            touched[removed.receiver], touched[new.receiver] = True, True
            keep &= ~touched[resting.receiver] | (resting.photon < photons)
        parts = [_merged(resting.where(keep), new)]
        for o, segments in enumerate(change.near_mobiles, 1):
            parts.append(self._found(o, segments, change.at, photons))
        return _Rays(*(np.concatenate(a) for a in zip(*parts, strict=True)))

    def from_scratch(self, parts: Iterable[Segments], at: Transforms) -> RayTree:
        """Return the rays of static receivers from all current segments; those of evaluate() must equal them."""
        rays = _joined([self._found(0, segments, at, self.photons) for segments in parts])
        return _tree(rays, self.discs.count(0))

    def _found(self, o: int, segments: Segments, at: Transforms, photons: int = MOST_LISTED_PHOTONS) -> _Rays:
        """Return the rays of segments of the first `photons` photons at object o's receivers."""
        threads, normals, first = self.discs.model.threads, self.discs.normals_of(o), int(self.discs.first[o])
        if photons < MOST_LISTED_PHOTONS or (segments.size and segments.photon[-1] >= MOST_LISTED_PHOTONS):
            is_counted = segments.photon < min(photons, MOST_LISTED_PHOTONS)
            segments = Segments(*(a[is_counted] for a in segments))
        out = []
        for _, c in self.discs.crossed(o, [segments], at):
            n = len(c.line)
            rays = _Rays(np.empty(n, np.int64), np.empty((n, 3), np.float32), np.empty((n, 3), np.float32))

            def write(_, a, b, crossings=c, rays=rays):
                _write(crossings, self._intake.weights, normals, first, a, b, rays)

            run_ranges(write, n, threads, COSTLY)
            out.append(rays)
        return _joined(out)


def _joined(parts: list[_Rays]) -> _Rays:
    """Return rays in the order of their keys."""
    if not parts:
        return _Rays(np.empty(0, np.int64), np.empty((0, 3), np.float32), np.empty((0, 3), np.float32))
    every = _Rays(*(np.concatenate(a) for a in zip(*parts, strict=True)))
    return every.where(np.argsort(every.key))


def _merged(rays: _Rays, new: _Rays) -> _Rays:
    """Return two ordered sets of rays in order."""
    if not len(new.key):
        return rays
    place = np.searchsorted(rays.key, new.key)
    return _Rays(*(np.insert(a, place, b, axis=0) for a, b in zip(rays, new, strict=True)))


def _tree(rays: _Rays, receivers: int) -> RayTree:
    counts = np.bincount(rays.key >> (RECEIVER_BIT - CELL_BITS), minlength=receivers * CELLS)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    starts = offsets[:-1:CELLS]
    totals = np.zeros((receivers, 3))
    lit = np.flatnonzero(offsets[CELLS::CELLS] > starts)
    if len(lit):
        totals[lit] = np.add.reduceat(rays.flux, starts[lit], axis=0, dtype=np.float64)
    shares = rays.flux / np.maximum(totals, 1.0)[rays.receiver]
    return RayTree(offsets, np.concatenate([shares, rays.direction], axis=1, dtype=np.float32, casting="same_kind"))


@kernel
def _write(crossings, weights, normals, first_row, first, last, out):
    """Write rays first .. last - 1 of Crossings; weights (G, 3): of the lamps' flux; normals (n, 3): of the object's
    receivers; first_row: of these among all receivers.
    """
    lines = crossings.lines
    for j in range(first, last):
        i, k = crossings.receiver[j], crossings.line[j]
        d = lines.direction[k]
        towards = -float(d[0]), -float(d[1]), -float(d[2])
        place = np.int64(first_row + i) * CELLS + cell_towards(axes_of(normals[i]), towards)[0]
        out.key[j] = (((place << PHOTON_BITS) + crossings.photon[k]) << BOUNCE_BITS) + crossings.bounce[k]
        for c in range(3):
            out.direction[j, c] = towards[c]
            out.flux[j, c] = np.int64(lines.flux[k, c] * weights[lines.lamp[k], c] + 0.5)

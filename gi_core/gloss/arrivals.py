"""Rays of segments at an object's glossy receivers, in the order of receivers, and their sums in cells."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.gloss.discs import GlossDiscs
from gi_core.gloss.hemisphere import GRAZING, add_ray, axes_of, cell_towards, weight_of
from gi_core.photons.paths import Segments
from gi_core.rays.accelerator import Transforms

FLUX_SHIFT = 12  # bits of flux left out of moments ...
DIRECTION_BITS = 14  # ... and bits of a direction: 2^36.2 at most per ray, 2^26 rays in 63 bits
RAY = 8  # numbers of a ray, see _weigh()


class Arrivals(NamedTuple):
    """Rays of segments at an object's receivers, in the order of receivers."""

    rows: np.ndarray  # (k,) int64, receivers that rays reach, ascending
    first: np.ndarray  # (k + 1,) int64 into `line`, first ray of each
    line: np.ndarray  # (m,) int32 into the next two
    rays: np.ndarray  # (S, RAY) int64, see _weigh()
    direction: np.ndarray  # (S, 3) float32, of the segments, in the object's space


def arrivals(
    discs: GlossDiscs, o: int, parts: list[tuple[int, Segments]], at: Transforms, weights: np.ndarray
) -> Arrivals:
    """Return the rays of segments, each part with its sign, at object o's receivers; weights (G, 3): of the lamps."""
    found = [(parts[k][0], c) for k, c in discs.crossed(o, [segments for _, segments in parts], at)]
    n, sizes = discs.count(o), [len(c.lines.low) for _, c in found]
    rays, receiver = np.empty((sum(sizes), RAY), np.int64), [np.empty(0, np.int32)]
    direction, lines = [np.empty((0, 3), np.float32)], [np.empty(0, np.int32)]
    for (sign, c), last in zip(found, np.cumsum(sizes), strict=True):
        first = int(last) - len(c.lines.low)
        _weigh(c.lines.direction, c.lines.flux, c.lines.lamp, weights, sign, rays[first:last])
        receiver.append(c.receiver)
        direction.append(c.lines.direction)
        lines.append(c.line + np.int32(first))
    at_receiver, along = np.concatenate(receiver), np.concatenate(lines)
    counts = np.bincount(at_receiver, minlength=n)
    cursor, ordered = np.cumsum(counts) - counts, np.empty_like(along)
    rows = np.flatnonzero(counts)
    starts = np.append(cursor[rows], len(along))
    _order(at_receiver, along, cursor, ordered)
    return Arrivals(rows, starts, ordered, rays, np.concatenate(direction))


@kernel
def _weigh(direction, flux, lamp, weights, sign, out):
    """Write rays (S, RAY): sign x flux per channel, direction towards the light, weight before its cosine, sign."""
    for k in range(len(out)):
        total = np.int64(0)
        for c in range(3):
            q = np.int64(flux[k, c] * weights[lamp[k], c] + 0.5)
            total += q
            out[k, c] = sign * q
            out[k, 3 + c] = np.int64(math.floor(0.5 - float(direction[k, c]) * (1 << DIRECTION_BITS)))
        out[k, 6], out[k, 7] = total >> FLUX_SHIFT, sign


@kernel
def _order(receiver, line, cursor, out):
    """Write lines in the order of receivers; cursor (n,): place of the first of each, advanced."""
    for j in range(len(receiver)):
        out[cursor[receiver[j]]] = line[j]
        cursor[receiver[j]] += 1


@kernel
def add_rays(arrivals, j, n, to, gone):
    """Add the rays at row j, a receiver of normal n, to its cells (CELLS, SUMS); return the cells reached as bits.

    Removed rays are subtracted from `gone` (CELLS, SUMS), which may be `to`.
    """
    axes, reached = axes_of(n), np.uint64(0)
    for e in range(arrivals.first[j], arrivals.first[j + 1]):
        k = arrivals.line[e]
        d, ray = arrivals.direction[k], arrivals.rays[k]
        cell, cosine = cell_towards(axes, (-float(d[0]), -float(d[1]), -float(d[2])))
        weight = ray[7] * np.int64(weight_of(ray[6], cosine, GRAZING) + 0.5)
        moment = weight * ray[3], weight * ray[4], weight * ray[5]
        add_ray(to[cell] if ray[7] > 0 else gone[cell], (ray[0], ray[1], ray[2]), moment, weight)
        reached |= np.uint64(1) << np.uint64(cell)
    return reached


@kernel
def deposit(arrivals, first, last, normals, sums):
    """Add the rays at receivers, rows first .. last - 1, to their sums (n, CELLS, SUMS)."""
    for j in range(first, last):
        i = arrivals.rows[j]
        add_rays(arrivals, j, normals[i], sums[i], sums[i])

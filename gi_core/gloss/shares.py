"""Sums of cells become shares of irradiance and mean directions: without mobiles, and at a frame's poses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import basis
from gi_core.gloss.arrivals import DIRECTION_BITS, add_rays
from gi_core.gloss.hemisphere import CELLS, SUMS
from gi_core.gloss.light import FIELDS


class StaticSums(NamedTuple):
    """Sums of the receivers of one object without mobiles, and the light that is made of them. Mobiles have no sums."""

    photons: np.ndarray  # (n, CELLS, SUMS) int64
    gathered: np.ndarray  # (n, CELLS, SUMS) float64, in place of photons, in their units; (0, ...): none
    totals: np.ndarray  # (n, 3) float64, of the cells
    place: np.ndarray  # (n,) int64 into `light`
    light: np.ndarray  # (m, CELLS, FIELDS) float32, see GlossLight.resting


class Scratch(NamedTuple):
    """Scratch memory of frame_cells()."""

    added: np.ndarray  # (CELLS, SUMS) int64, zeros before and after
    gone: np.ndarray  # (CELLS, SUMS) int64, zeros before and after
    now: np.ndarray  # (CELLS, SUMS) float64
    reached: np.ndarray  # (CELLS,) int64

    @classmethod
    def new(cls) -> Scratch:
        return cls(*np.zeros((2, CELLS, SUMS), np.int64), np.empty((CELLS, SUMS)), np.empty(CELLS, np.int64))


def as_light(sums: np.ndarray) -> np.ndarray:
    """Return cells (n, CELLS, 6) float32, as of a GlossLight, of gathered sums (n, CELLS, SUMS), see `GlossGather`."""
    scaled = sums * np.array([1.0] * 3 + [1 << DIRECTION_BITS] * 3 + [1.0])
    out = np.zeros((len(sums), CELLS, FIELDS), np.float32)
    normalise(scaled, np.arange(len(sums)), out, np.empty((len(sums), 3)))
    return out


@kernel
def turn(even, normals, out):
    """Write even light (CELLS, 6) around normals (n, 3) to out (n, CELLS, 6)."""
    for i in range(len(normals)):
        n = normals[i]
        ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
        for c in range(CELLS):
            e = even[c]
            out[i, c, 0], out[i, c, 1], out[i, c, 2] = e[0], e[1], e[2]
            out[i, c, 3] = e[3] * ax + e[4] * bx + e[5] * n[0]
            out[i, c, 4] = e[3] * ay + e[4] * by + e[5] * n[1]
            out[i, c, 5] = e[3] * az + e[4] * bz + e[5] * n[2]


@kernel
def _write_mean(x, y, z, weight, out):
    """Write the mean direction of a cell's sums, if there is any light."""
    size = math.sqrt(x * x + y * y + z * z)
    if size > 0.0:
        size = max(size, weight * (1 << DIRECTION_BITS))
        out[3], out[4], out[5] = x / size, y / size, z / size


@kernel
def normalise(sums, place, out, totals):
    """Write shares and mean directions of sums (n, CELLS, SUMS) to rows place (n,) of out, and totals (n, 3)."""
    for i in range(len(sums)):
        of, to = sums[i], out[place[i]]
        for k in range(3):
            total = 0.0
            for c in range(CELLS):
                total += of[c, k]
            for c in range(CELLS):
                to[c, k] = of[c, k] / total if total > 0.0 else 0.0
            totals[i, k] = total
        for c in range(CELLS):
            _write_mean(float(of[c, 3]), float(of[c, 4]), float(of[c, 5]), float(of[c, 6]), to[c])


@kernel
def _left(scale, gone, photons):
    """Return the share of a cell's light that mobiles leave: that of its photons."""
    return max(0.0, 1.0 + scale * gone / photons) if photons > 0 else 1.0


@kernel
def _move(static, i, c, scale, room):
    """Write the sums of cell c of receiver i at a frame's poses; return how much red, green and blue they change.

    The cell's added and removed sums become zeros.
    """
    added, gone, now = room.added[c], room.gone[c], room.now[c]
    red = green = blue = 0.0
    if i >= len(static.photons):
        for k in range(SUMS):
            now[k] = scale * (added[k] + gone[k])
    elif not len(static.gathered):
        before = static.photons[i, c]
        red, green, blue = float(before[0]), float(before[1]), float(before[2])
        for k in range(SUMS):
            now[k] = scale * (added[k] + gone[k]) + float(before[k])
    else:
        better, photons = static.gathered[i, c], static.photons[i, c]
        red, green, blue = better[0], better[1], better[2]
        for k in range(3):
            now[k] = _left(scale, gone[k], photons[k]) * better[k] + scale * added[k]
        left = _left(scale, gone[6], photons[6])  # directions lose the share that their weight does
        for k in range(3, SUMS):
            now[k] = left * better[k] + scale * added[k]
    for k in range(SUMS):
        added[k] = gone[k] = 0
    for k in range(3):
        now[k] = max(0.0, now[k])
    return now[0] - red, now[1] - green, now[2] - blue


@kernel
def frame_cells(arrivals, first, last, normals, static, scale, room, out):
    """Write shares and mean directions of receivers, rows first .. last - 1, to rows of out (k, CELLS, 6).

    static: a StaticSums, without these rays, which count `scale` times; room: a Scratch.
    """
    for j in range(first, last):
        i = arrivals.rows[j]
        resting, to, n = static.light[static.place[i]], out[j], 0
        bits = add_rays(arrivals, j, normals[i], room.added, room.gone)
        for c in range(CELLS):
            if (bits >> np.uint64(c)) & np.uint64(1):
                room.reached[n] = c
                n += 1
        red = green = blue = 0.0
        if i < len(static.photons):
            red, green, blue = static.totals[i, 0], static.totals[i, 1], static.totals[i, 2]
        r, g, b = red, green, blue
        for m in range(n):
            more = _move(static, i, room.reached[m], scale, room)
            r, g, b = r + more[0], g + more[1], b + more[2]
        # Shares of the cells that no ray reaches change with the totals alone.
        red, green, blue = red / r if r > 0.0 else 0.0, green / g if g > 0.0 else 0.0, blue / b if b > 0.0 else 0.0
        for c in range(CELLS):
            to[c, 0], to[c, 1], to[c, 2] = red * resting[c, 0], green * resting[c, 1], blue * resting[c, 2]
            to[c, 3], to[c, 4], to[c, 5] = resting[c, 3], resting[c, 4], resting[c, 5]
        for m in range(n):
            c = room.reached[m]
            now = room.now[c]
            to[c, 0] = now[0] / r if r > 0.0 else 0.0
            to[c, 1] = now[1] / g if g > 0.0 else 0.0
            to[c, 2] = now[2] / b if b > 0.0 else 0.0
            _write_mean(now[3], now[4], now[5], now[6], to[c])

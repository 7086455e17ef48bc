"""Guided emission: photons of the sun and the sky start mostly where their light meets receivers.

A room that is lit by a window receives 1 % of the flux that such a light must emit. Its emission numbers, which are
uniform in [0, 1)^4, are divided into cells. Rays tell which share h of a cell's photons hits a side with receivers.
A cell is drawn with the density

    p = (1 - EVEN) sqrt(h + m) / mean + EVEN

where m is the mean h of the cells around, and a photon from it carries 1 / p of its flux: expectations are the same.
The root minimises the variance of the light that arrives, where a cell holds both fates.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import picked
from gi_core.lights.kinds import SKY, SUN, emitted

EVEN = 0.1  # share of photons that starts evenly: 1e-4 of the light that arrives comes from cells without hits
CELL_RAYS = 4  # 16 win nothing
# Cells of numbers (s, t, u, v): of the direction, and of the place. 295,000 cells in place of 37,000: 0.21, not 0.16 of
# photons count in a room with one window, and the rays take 0.1 s.
CELLS = {SKY: (12, 24, 8, 16), SUN: (1, 1, 32, 128)}

Hits = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class Guide:
    """`arriving`, `landing`: shares of a light's flux that hit receivers, any face; `table` (n,): for guided()."""

    def __init__(self, kind: int, parameters: np.ndarray, hits: Hits):
        """hits(origin (n, 3) [m], direction (n, 3) unit): whether rays meet sides with receivers, any, (n,) bool."""
        self.shape = CELLS[kind]
        cells = int(np.prod(self.shape))
        low = np.stack(np.unravel_index(np.repeat(np.arange(cells), CELL_RAYS), self.shape), axis=1)
        numbers = (low + np.random.default_rng(0).random(low.shape)) / self.shape
        origin, direction = np.empty((2, len(numbers), 3), np.float32)
        _emit_all(kind, parameters, numbers, origin, direction)
        meets, lands = hits(origin, direction)
        share = meets.reshape(cells, CELL_RAYS).mean(axis=1).reshape(self.shape)
        self.arriving, self.landing = float(meets.mean()), float(lands.mean())
        mean = (wanted := np.sqrt(share + _mean_around(share))).mean()
        self.table = _conditional((1 - EVEN) * wanted / mean + EVEN if mean > 0 else np.ones(self.shape))


@kernel
def _emit_all(kind, parameters, numbers, origin, direction):
    for k in range(len(numbers)):
        s, t, u, v = numbers[k, 0], numbers[k, 1], numbers[k, 2], numbers[k, 3]
        start, way = emitted(kind, parameters, numbers[0], u, v, s, t)
        for c in range(3):
            origin[k, c], direction[k, c] = start[c], way[c]


def _mean_around(share: np.ndarray) -> np.ndarray:
    """Return the mean of each cell and its neighbours: axes 1 and 3 are angles, the others end."""
    for axis in np.flatnonzero(np.array(share.shape) > 1):
        widths = [(1, 1) if a == axis else (0, 0) for a in range(share.ndim)]
        wide = np.pad(share, widths, "wrap" if axis in (1, 3) else "edge")
        n = share.shape[axis]
        share = sum(wide.take(range(k, k + n), axis) for k in range(3)) / 3
    return share


def _conditional(density: np.ndarray) -> np.ndarray:
    """Return the shape of the cells, and for each axis the running shares of its cells given those of earlier axes."""
    parts = [np.array(density.shape, np.float64)]
    for axis in range(density.ndim):
        mass = density.sum(axis=tuple(range(axis + 1, density.ndim))).reshape(-1, density.shape[axis])
        cdf = np.cumsum(mass, axis=1) / mass.sum(axis=1, keepdims=True)
        cdf[:, -1] = 1.0
        parts.append(cdf.reshape(-1))
    return np.concatenate(parts)


@kernel
def guided(table, s, t, u, v):
    """Return four numbers in [0, 1) drawn by a guide's table from uniform ones, and the flux 1 / p of their photon."""
    at, cell, flux = 4, 0, 1.0
    s, at, cell, flux = _drawn(table, 0, at, cell, flux, s)
    t, at, cell, flux = _drawn(table, 1, at, cell, flux, t)
    u, at, cell, flux = _drawn(table, 2, at, cell, flux, u)
    v, at, cell, flux = _drawn(table, 3, at, cell, flux, v)
    return s, t, u, v, min(flux, 1.0 / EVEN)


@kernel
def _drawn(table, axis, at, cell, flux, x):
    """Return number x drawn along an axis, where the next axis begins in the table, the cell and its flux."""
    n, rows = int(table[axis]), 1
    for a in range(axis):
        rows *= int(table[a])
    cdf = table[at + cell * n : at + (cell + 1) * n]
    k = picked(cdf, x)
    before = cdf[k - 1] if k > 0 else 0.0
    share = cdf[k] - before
    x = (k + min((x - before) / share, 1.0)) / n
    return x, at + rows * n, cell * n + k, flux / (n * share)

"""Disc indexing (report 2.7): a uniform grid over the discs, walked by each segment.

A disc is listed in every cell that its padded box touches. A crossing is accepted only in the cell
whose half-open interval of t holds it, so each disc counts once and no mailbox is needed. The
discs of a cell are copied in cell order as a structure of arrays, so that a slice can be tested
with vector instructions.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.disc_search.crossing import LANES, Discs, Lines, columns, counts, crossed
from gi_core.jit import kernel

CELL_RADII = 4.0  # cell edge in disc radii: see docs/measurements.md
MAX_CELLS = 1 << 22  # memory bound for tiny discs in a big scene; cells grow instead
PAD = 1e-3  # of a cell: rounding of a crossing against the cell's walls


class DiscIndex:
    """A uniform grid over discs."""

    def __init__(self, discs: Discs, cell_radii: float = CELL_RADII):
        self.discs = discs
        p = discs.positions
        r = float(discs.radius)
        low = p.min(axis=0).astype(np.float64) - 1.01 * r if len(p) else np.zeros(3)
        high = p.max(axis=0).astype(np.float64) + 1.01 * r if len(p) else np.ones(3)
        extent = np.maximum(high - low, 1e-12)
        cell = max(cell_radii * r, float(extent.max()) / 512, float(extent.prod() / MAX_CELLS) ** (1 / 3))
        self.shape = np.maximum(1, np.ceil(extent / cell)).astype(np.int64)
        self.low, self.cell = low, cell
        counts = np.zeros(int(self.shape.prod()) + 1, np.int64)
        half = _half_extents(discs, PAD * cell)
        half[discs.regions.area == 0] = -1.0  # nothing can cross these: listed nowhere
        _list(p, half, low, cell, self.shape, counts, np.empty(0, np.int32))
        room = (counts[:-1] + LANES - 1) // LANES * LANES
        self.first = np.concatenate([[0], np.cumsum(room)]).astype(np.int64)
        self.ids = np.full(int(self.first[-1]), -1, np.int32)
        _list(p, half, low, cell, self.shape, self.first[:-1].copy(), self.ids)
        self._columns = columns(p, discs.normals, self.ids)
        self.largest = int(room.max())

    def splat(self, lines: Lines, first: int, last: int, sign: int, sums: np.ndarray) -> int:
        """Add sign x flux of lines first .. last - 1 to sums (R, 3) int64 of the discs they cross.

        Returns the number of crossings.
        """
        return _splat(
            self.low, self.cell, self.shape, self.first, self.ids, self.largest, *self._columns, self.discs.own,
            *self.discs.regions[:2], self.discs.radius, *lines, first, last, sign, sums,
        )  # fmt: skip


def _half_extents(discs: Discs, pad: float) -> np.ndarray:
    """Return half the sides (R, 3) float64 of the box of each disc, padded."""
    n = discs.normals.astype(np.float64)
    return float(discs.radius) * np.sqrt(np.clip(1 - n * n, 0, 1)) + pad


@kernel
def _span(x, half, low, cell, n):
    a = int(math.floor((x - half - low) / cell))
    b = int(math.floor((x + half - low) / cell))
    return min(max(a, 0), n - 1), min(max(b, 0), n - 1)


@kernel
def _list(positions, half, low, cell, shape, cursor, ids):
    """Advance the cursor of each cell once for each disc in it; write the disc there if ids has room at all."""
    for j in range(len(positions)):
        if half[j, 0] < 0.0:
            continue
        x0, x1 = _span(positions[j, 0], half[j, 0], low[0], cell, shape[0])
        y0, y1 = _span(positions[j, 1], half[j, 1], low[1], cell, shape[1])
        z0, z1 = _span(positions[j, 2], half[j, 2], low[2], cell, shape[2])
        for x in range(x0, x1 + 1):
            for y in range(y0, y1 + 1):
                for z in range(z0, z1 + 1):
                    c = (x * shape[1] + y) * shape[2] + z
                    if len(ids):
                        ids[cursor[c]] = j
                    cursor[c] += 1


@kernel
def _clip(o, d, low, high, t0, t1):
    """Clip [t0, t1) to one slab."""
    if d == 0.0:
        return (t0, t1) if low <= o <= high else (t0, t0 - 1.0)
    a, b = (low - o) / d, (high - o) / d
    return max(t0, min(a, b)), min(t1, max(a, b))


@kernel
def _axis(o, d, t, low, cell, n):
    """Return where a walk along one axis stands: cell, step, t of the next wall, t between walls."""
    i = min(max(int(math.floor((o + t * d - low) / cell)), 0), n - 1)
    if d > 0.0:
        return i, 1, (low + (i + 1) * cell - o) / d, cell / d
    if d < 0.0:
        return i, -1, (low + i * cell - o) / d, -cell / d
    return i, 0, np.inf, 0.0


@kernel
def _splat(
    low, cell, shape, first_of, ids, largest, cx, cy, cz, nx, ny, nz, own, row, reach, radius,
    origin, direction, t_low, stop, t_high, flux, patches, touches, first, last, sign, sums,
):  # fmt: skip
    mask = np.zeros(largest, np.uint8)
    r2 = radius * radius
    pad = PAD * cell
    total = 0
    for k in range(first, last):
        ox, oy, oz = origin[k, 0], origin[k, 1], origin[k, 2]
        dx, dy, dz = direction[k, 0], direction[k, 1], direction[k, 2]
        # Clip to the grid, a little outside so that no crossing is lost to rounding.
        t0, t1 = float(t_low[k]), float(t_high[k])
        t0, t1 = _clip(ox, dx, low[0] - pad, low[0] + shape[0] * cell + pad, t0, t1)
        t0, t1 = _clip(oy, dy, low[1] - pad, low[1] + shape[1] * cell + pad, t0, t1)
        t0, t1 = _clip(oz, dz, low[2] - pad, low[2] + shape[2] * cell + pad, t0, t1)
        if not t0 < t1:
            continue
        ix, sx, tx, wx = _axis(ox, dx, t0, low[0], cell, shape[0])
        iy, sy, ty, wy = _axis(oy, dy, t0, low[1], cell, shape[1])
        iz, sz, tz, wz = _axis(oz, dz, t0, low[2], cell, shape[2])
        a = np.float32(t_low[k]) if t0 == float(t_low[k]) else np.float32(t0 - pad)
        a = max(a, t_low[k])
        while True:
            # This cell's part of the line is [a, b); the next one starts at the same bits.
            t = min(tx, min(ty, tz))
            b = t_high[k] if t >= t1 else max(a, np.float32(t))
            c = (ix * shape[1] + iy) * shape[2] + iz
            i0, i1 = first_of[c], first_of[c + 1]
            if i1 > i0 and b > a:
                n = crossed(
                    cx, cy, cz, nx, ny, nz, np.uint64(i0), np.uint64(i1), ox, oy, oz, dx, dy, dz, a, b, r2, mask
                )
                if n > 0:
                    for m in range(i0, i1):
                        if mask[m - i0]:
                            i = ids[m]
                            if counts(
                                i, cx[m], cy[m], cz[m], nx[m], ny[m], nz[m], k, ox, oy, oz, dx, dy, dz, stop[k], r2,
                                own, row, reach, patches, touches,
                            ):  # fmt: skip
                                total += 1
                                for ch in range(3):
                                    sums[i, ch] += sign * flux[k, ch]
            if t >= t1:
                break
            a = b
            if tx <= ty and tx <= tz:
                ix += sx
                tx += wx
                if ix < 0 or ix >= shape[0]:
                    break
            elif ty <= tz:
                iy += sy
                ty += wy
                if iy < 0 or iy >= shape[1]:
                    break
            else:
                iz += sz
                tz += wz
                if iz < 0 or iz >= shape[2]:
                    break
    return total

"""Disc index (report 2.7): a uniform grid over the discs, walked by each segment.

A disc is listed in every cell that its padded box touches. Each cell accepts only intersections in its half-open
interval of t, so each disc counts once and no mailbox is needed. The discs of a cell lie in blocks that vector
instructions test at once.

The cell size has the lowest predicted cost of traversal and disc tests. The report tuned the number of discs
per voxel by hand; the best number grows with the discs. In radii the best cells shrink, from 6 or 12 for sparse discs
to 2 for dense ones. Cells visited per metre of a random line are proportional to 1 / edge, so the mean over all cells
gives its cost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel, lowest_bit
from gi_core.base.vec import row
from gi_core.discs.search.predicate import (
    LANES,
    LISTED_AT_ONCE,
    Discs,
    Lines,
    add_accepted,
    blocks,
    discs_crossed,
    to_list,
)
from gi_core.photons.flux_sums import Sums

CELL_RADII = 4.0  # cell edge in disc radii: see docs/decisions/disc-searches.md
MAX_CELLS = 1 << 22  # memory bound for tiny discs in a big scene; cells grow instead
MOST_ALONG = 512  # cells along an axis
PAD = 1e-3  # of a cell: rounding of an intersection against the cell's walls
VISITS = 1024  # cells listed before their discs are tested: these lists stay in the level-1 cache


class Cells(NamedTuple):
    """A uniform grid of C cells, and the blocks of discs in each."""

    low: np.ndarray  # (3,) float64 [m]
    cell: float  # edge [m]
    shape: np.ndarray  # (3,) int64
    first: np.ndarray  # (C + 1,) int32, first block of each cell


class Visits(NamedTuple):
    """Scratch memory of a traversal: visited cells with discs, and their candidates."""

    line: np.ndarray  # (n,) int64
    blocks: np.ndarray  # (n, 2) int32, first and last + 1
    low: np.ndarray  # (n,) float32 [m], the line's interval in the cell
    high: np.ndarray  # (n,) float32 [m]
    candidates: np.ndarray  # (LISTED_AT_ONCE, 2) int64, line and entry of blocks

    @classmethod
    def of(cls, n: int) -> Visits:
        """Return memory for n visits."""
        low, high = np.empty(n, np.float32), np.empty(n, np.float32)
        return cls(
            np.empty(n, np.int64), np.empty((n, 2), np.int32), low, high, np.empty((LISTED_AT_ONCE, 2), np.int64)
        )


def discs_in_cells(discs: Discs, rows: np.ndarray, cell_radii: float):
    """Return the grid of some discs: edge and low (3,) [m], shape (3,), discs per cell (C,).

    The edge is cell_radii radii, or more if memory requires it.
    """
    p, around = discs.positions[rows].astype(np.float64), 1.01 * float(discs.radius)
    low, extent = np.zeros(3), np.ones(3)
    if len(p):
        low, extent = p.min(axis=0) - around, np.maximum(np.ptp(p, axis=0) + 2 * around, 1e-12)
    cell = max(cell_radii * float(discs.radius), float(extent.max()) / MOST_ALONG)
    cell = max(cell, float(extent.prod() / MAX_CELLS) ** (1 / 3))
    # A border of empty cells: traversal inside the grid needs no test for its end.
    low, shape = low - cell, np.maximum(1, np.ceil(extent / cell)).astype(np.int64) + 2
    count = np.zeros(int(shape.prod()), np.int64)
    _list(rows, discs.positions, _half_extents(discs, PAD * cell), low, cell, shape, count, np.empty(0, np.int32))
    return cell, low, shape, count


class DiscIndex:
    """A uniform grid over discs."""

    def __init__(self, discs: Discs, cell_radii: float | None = None):
        """cell_radii: edge of the cells in disc radii; None: chosen."""
        rows = np.flatnonzero(to_list(discs))
        self.discs, self.cell_radii = discs, cell_radii or best_cell_radii(discs, rows)
        cell, low, shape, count = discs_in_cells(discs, rows, self.cell_radii)
        room = (count + LANES - 1) // LANES
        first = np.concatenate([[0], np.cumsum(room)]).astype(np.int32)
        ids = np.full(int(first[-1]) * LANES, -1, np.int32)
        half = _half_extents(discs, PAD * cell)
        _list(rows, discs.positions, half, low, cell, shape, first[:-1] * np.int64(LANES), ids)
        self.cells = Cells(low, cell, shape, first)
        self.blocks = blocks(discs, ids)

    def accumulate(self, lines: Lines, sign: int, sums: Sums) -> int:
        return _accumulate(self.cells, self.blocks, self.discs, lines, sign, sums, Visits.of(VISITS))

    @cached_property
    def discs_a_cell(self) -> float:
        """Mean number of discs per occupied cell."""
        held = (self.blocks.front >= 0) | (self.blocks.behind >= 0)
        return float(held.sum()) / max(int((np.diff(self.cells.first) > 0).sum()), 1)

    def summary(self) -> str:
        return f"disc_index: cells of {self.cell_radii:g} radii with {self.discs_a_cell:.0f} discs per occupied cell"


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
def _list(rows, positions, half, low, cell, shape, cursor, ids):
    """Advance the cursor of each cell once per disc in it; write the disc there unless ids is empty."""
    for j in rows:
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


@inlined
def _axis(o, d, t, low, cell, n):
    """Return the state of a traversal along one axis: cell, step, t of the next wall, t between walls."""
    i = min(max(int(math.floor((o + t * d - low) / cell)), 0), n - 1)
    if d > 0.0:
        return i, 1, (low + (i + 1) * cell - o) / d, cell / d
    if d < 0.0:
        return i, -1, (low + i * cell - o) / d, -cell / d
    return i, 0, np.inf, 0.0


@kernel
def _accumulate(cells, blocks, discs, lines, sign, sums, visits):
    """Three passes over some segments at a time: occupied cells on the line, discs crossed there, sums.

    Passes are separate because most of the time is spent waiting for memory. Within one pass the
    accesses of different segments are independent, so the processor overlaps them.
    """
    cell = cells.cell
    pad = PAD * cell
    near = cell - pad
    lx, ly, lz = cells.low[0], cells.low[1], cells.low[2]
    nx, ny, nz = cells.shape[0], cells.shape[1], cells.shape[2]
    n = total = 0
    for k in range(len(lines.low)):
        ox, oy, oz = row(lines.origin, k)
        dx, dy, dz = row(lines.direction, k)
        # Clip to the inside of the border, slightly enlarged, so that no intersection is lost to rounding.
        t0, t1 = float(lines.low[k]), float(lines.high[k])
        t0, t1 = _clip(ox, dx, lx + near, lx + nx * cell - near, t0, t1)
        t0, t1 = _clip(oy, dy, ly + near, ly + ny * cell - near, t0, t1)
        t0, t1 = _clip(oz, dz, lz + near, lz + nz * cell - near, t0, t1)
        if not t0 < t1:
            continue
        ix, sx, tx, wx = _axis(ox, dx, t0, lx, cell, nx)
        iy, sy, ty, wy = _axis(oy, dy, t0, ly, cell, ny)
        iz, sz, tz, wz = _axis(oz, dz, t0, lz, cell, nz)
        a = lines.low[k] if t0 == float(lines.low[k]) else max(lines.low[k], np.float32(t0 - pad))
        c = (ix * ny + iy) * nz + iz
        jump_x, jump_y, jump_z = sx * ny * nz, sy * nz, sz
        while True:
            t = min(tx, min(ty, tz))
            if cells.first[c] < cells.first[c + 1]:
                # This cell's part of the line is [a, b); the next one starts at the same bits.
                visits.line[n] = k
                visits.blocks[n, 0], visits.blocks[n, 1] = cells.first[c], cells.first[c + 1]
                visits.low[n], visits.high[n] = a, lines.high[k] if t >= t1 else max(a, np.float32(t))
                n += 1
                if n == VISITS:
                    total += cross(n, visits, blocks, discs, lines, sign, sums)
                    n = 0
            if t >= t1:
                break
            a = max(a, np.float32(t))
            if tx <= ty and tx <= tz:
                c += jump_x
                tx += wx
            elif ty <= tz:
                c += jump_y
                ty += wy
            else:
                c += jump_z
                tz += wz
    return total + cross(n, visits, blocks, discs, lines, sign, sums)


@kernel
def cross(visited, visits, blocks, discs, lines, sign, sums):
    """Add sign x flux of the lines of some visits to the sums of the discs that they cross; return their number."""
    r2 = discs.radius * discs.radius
    total = n = 0
    for v in range(visited):
        k = visits.line[v]
        origin, direction = row(lines.origin, k), row(lines.direction, k)
        a, b = visits.low[v], visits.high[v]
        for block in range(visits.blocks[v, 0], visits.blocks[v, 1]):
            bits = discs_crossed(blocks.data, block, origin, direction, a, b, r2)
            while bits != 0:
                visits.candidates[n, 0], visits.candidates[n, 1] = k, block * LANES + lowest_bit(bits)
                bits &= bits - np.uint32(1)
                n += 1
            if n > LISTED_AT_ONCE - LANES:
                total += add_accepted(n, visits.candidates, blocks, discs, lines, sign, sums)
                n = 0
    return total + add_accepted(n, visits.candidates, blocks, discs, lines, sign, sums)


TRIED_CELL_RADII = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)  # radii


def best_cell_radii(discs: Discs, rows: np.ndarray) -> float:
    """Return the cell edge in disc radii for a grid over discs `rows` (n,), by descent from CELL_RADII."""
    return _downhill(lambda radii: ns_per_metre(discs, rows, radii))


def _downhill(cost: Callable[[float], float]) -> float:
    """Return a local minimum over TRIED_CELL_RADII; each evaluation is a pass over the discs."""
    at = TRIED_CELL_RADII.index(CELL_RADII)
    costs = {at: cost(TRIED_CELL_RADII[at])}

    def better(k: int) -> bool:
        if not 0 <= k < len(TRIED_CELL_RADII):
            return False
        if k not in costs:
            costs[k] = cost(TRIED_CELL_RADII[k])
        return costs[k] < costs[at]

    for step in (1, -1):
        while better(at + step):
            at += step
    return TRIED_CELL_RADII[at]


def ns_per_metre(discs: Discs, rows: np.ndarray, cell_radii: float) -> float:
    """Return the predicted time per metre of line in a grid with such cells [ns]."""
    cell, _, shape, count = discs_in_cells(discs, rows, cell_radii)
    inside = float((shape - 2).prod())  # without the border
    blocks = (count + LANES - 1) // LANES
    # Of an Intel Xeon 2.1 GHz; only ratios matter. The way to the next cell, the start of its tests, LANES discs.
    step, visit, block = 6.0, 20.0, 12.0
    return (step + (visit * float((count > 0).sum()) + block * float(blocks.sum())) / inside) / cell

"""A uniform grid over discs, walked by each segment (report 2.7).

A disc is listed in every cell that its padded box touches. A crossing is accepted only in the cell
whose half-open interval of t holds it, so each disc counts once and no mailbox is needed. The
discs of a cell lie in blocks that vector instructions test at once.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import allocating, inlined, kernel
from gi_core.discs.search.accumulate import ROOM, add_found
from gi_core.discs.search.predicate import LANES, Discs, Lines, blocks, crossed, lane_of, share
from gi_core.discs.search.pretest import discs_left, triangles
from gi_core.photons.flux_sums import Sums

CELL_RADII = 4.0  # cell edge in disc radii: see docs/measurements.md
MAX_CELLS = 1 << 22  # memory bound for tiny discs in a big scene; cells grow instead
MOST_ALONG = 512  # cells along an axis
PAD = 1e-3  # of a cell: rounding of a crossing against the cell's walls
VISITS = 1024  # cells that are listed before their discs are tested: these lists stay in the first cache


def box_of(discs: Discs, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return low and extent (3,) float64 [m] of a box around some discs."""
    p, r = discs.positions[rows].astype(np.float64), 1.01 * float(discs.radius)
    if not len(p):
        return np.zeros(3), np.ones(3)
    return p.min(axis=0) - r, np.maximum(np.ptp(p, axis=0) + 2 * r, 1e-12)


def cell_for(extent: np.ndarray, radius: float, cell_radii: float = CELL_RADII) -> float:
    """Return the edge [m] of a grid's cells: that of cell_radii radii, unless memory would not do."""
    return max(cell_radii * radius, float(extent.max()) / MOST_ALONG, float(extent.prod() / MAX_CELLS) ** (1 / 3))


def discs_in_cells(discs: Discs, rows: np.ndarray, cell_radii: float):
    """Return the grid of cells of so many radii over some discs: edge, low (3,) [m], shape (3,), discs a cell (C,)."""
    low, extent = box_of(discs, rows)
    cell = cell_for(extent, float(discs.radius), cell_radii)
    # A border of empty cells: a walk inside the grid needs no look at where it ends.
    low, shape = low - cell, np.maximum(1, np.ceil(extent / cell)).astype(np.int64) + 2
    count = np.zeros(int(shape.prod()), np.int64)
    _list(rows, discs.positions, _half_extents(discs, PAD * cell), low, cell, shape, count, np.empty(0, np.int32))
    return cell, low, shape, count


class DiscGrid:
    """A uniform grid over some of the discs, those of the given rows (n,)."""

    def __init__(self, discs: Discs, rows: np.ndarray, pretest: str = "none", cell_radii: float = CELL_RADII):
        self.discs, self.cell_radii = discs, cell_radii
        self.cell, self.low, self.shape, count = discs_in_cells(discs, rows, cell_radii)
        room = (count + LANES - 1) // LANES
        self.first = np.concatenate([[0], np.cumsum(room)]).astype(np.int32)
        ids = np.full(int(self.first[-1]) * LANES, -1, np.int32)
        half = _half_extents(discs, PAD * self.cell)
        _list(rows, discs.positions, half, self.low, self.cell, self.shape, self.first[:-1] * np.int64(LANES), ids)
        self.blocks, self.pretest = blocks(discs, ids), triangles(pretest, discs, ids)

    def splat(self, lines: Lines, sign: int, sums: Sums, part: int = 0, parts: int = 1) -> int:
        """Add sign x flux of a share of the lines to the sums of the discs they cross; returns how many crossings."""
        first, last = share(len(lines.low), part, parts)
        return _splat(
            self.low, self.cell, self.shape, self.first, *self.blocks, self.discs.own,
            *self.discs.regions[:2], self.discs.radius, *lines, first, last, sign, *sums, self.pretest,
        )  # fmt: skip

    @property
    def discs_a_cell(self) -> float:
        """How many discs are in a cell that has any."""
        held = (self.blocks.front >= 0) | (self.blocks.behind >= 0)
        return float(held.sum()) / max(int((np.diff(self.first) > 0).sum()), 1)

    def summary(self) -> str:
        """Return in words how large the cells are, and how full."""
        return f"cells of {self.cell_radii:g} radii with {self.discs_a_cell:.0f} discs where any are"


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
    """Advance the cursor of each cell once for each disc in it; write the disc there if ids has room at all."""
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
    """Return where a walk along one axis stands: cell, step, t of the next wall, t between walls."""
    i = min(max(int(math.floor((o + t * d - low) / cell)), 0), n - 1)
    if d > 0.0:
        return i, 1, (low + (i + 1) * cell - o) / d, cell / d
    if d < 0.0:
        return i, -1, (low + i * cell - o) / d, -cell / d
    return i, 0, np.inf, 0.0


@allocating
def _splat(
    low, cell, shape, first_of, data, front, behind, own, row, reach, radius,
    origin, direction, t_low, stop, t_high, flux, patches, touches, first, last, sign, sums, touched, base, log,
    pretest,
):  # fmt: skip
    """Three passes over some segments at a time: full cells on the way, discs crossed there, sums.

    Apart, because most of the time goes into waiting for memory: within one pass the accesses of
    different segments do not depend on each other, and the processor overlaps them.
    """
    r2 = radius * radius
    pad = PAD * cell
    near = cell - pad
    lx, ly, lz = low[0], low[1], low[2]
    nx, ny, nz = shape[0], shape[1], shape[2]
    visit_line, visit_blocks = np.empty(VISITS, np.int64), np.empty((VISITS, 2), np.int32)
    visit_low, visit_high = np.empty(VISITS, np.float32), np.empty(VISITS, np.float32)
    found = np.empty((ROOM, 2), np.int64)
    visits = 0
    total = 0
    for k in range(first, last):
        ox, oy, oz = origin[k, 0], origin[k, 1], origin[k, 2]
        dx, dy, dz = direction[k, 0], direction[k, 1], direction[k, 2]
        # Clip to what is inside the border, a little outside so that no crossing is lost to rounding.
        t0, t1 = float(t_low[k]), float(t_high[k])
        t0, t1 = _clip(ox, dx, lx + near, lx + nx * cell - near, t0, t1)
        t0, t1 = _clip(oy, dy, ly + near, ly + ny * cell - near, t0, t1)
        t0, t1 = _clip(oz, dz, lz + near, lz + nz * cell - near, t0, t1)
        if not t0 < t1:
            continue
        ix, sx, tx, wx = _axis(ox, dx, t0, lx, cell, nx)
        iy, sy, ty, wy = _axis(oy, dy, t0, ly, cell, ny)
        iz, sz, tz, wz = _axis(oz, dz, t0, lz, cell, nz)
        a = t_low[k] if t0 == float(t_low[k]) else max(t_low[k], np.float32(t0 - pad))
        c = (ix * ny + iy) * nz + iz
        jump_x, jump_y, jump_z = sx * ny * nz, sy * nz, sz
        while True:
            t = min(tx, min(ty, tz))
            if first_of[c] < first_of[c + 1]:
                # This cell's part of the line is [a, b); the next one starts at the same bits.
                visit_line[visits] = k
                visit_blocks[visits, 0], visit_blocks[visits, 1] = first_of[c], first_of[c + 1]
                visit_low[visits], visit_high[visits] = a, t_high[k] if t >= t1 else max(a, np.float32(t))
                visits += 1
                if visits == VISITS:
                    total += _cross(
                        visits, visit_line, visit_blocks, visit_low, visit_high, found, data, front, behind, own,
                        row, reach, r2, origin, direction, stop, flux, patches, touches, sign, sums, touched, base, log,
                        pretest,
                    )  # fmt: skip
                    visits = 0
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
    total += _cross(
        visits, visit_line, visit_blocks, visit_low, visit_high, found, data, front, behind, own,
        row, reach, r2, origin, direction, stop, flux, patches, touches, sign, sums, touched, base, log, pretest,
    )  # fmt: skip
    return total


@kernel
def _cross(
    visits, visit_line, visit_blocks, visit_low, visit_high, found, data, front, behind, own,
    row, reach, r2, origin, direction, stop, flux, patches, touches, sign, sums, touched, base, log, pretest,
):  # fmt: skip
    total = n = 0
    for v in range(visits):
        k = visit_line[v]
        ox, oy, oz = origin[k, 0], origin[k, 1], origin[k, 2]
        dx, dy, dz = direction[k, 0], direction[k, 1], direction[k, 2]
        a, b = visit_low[v], visit_high[v]
        for block in range(visit_blocks[v, 0], visit_blocks[v, 1]):
            if pretest is not None:
                left = discs_left(pretest, data, block, ox, oy, oz, dx, dy, dz)
                if left == 0:
                    continue
            bits = crossed(data, block, ox, oy, oz, dx, dy, dz, a, b, r2)
            if pretest is not None:
                bits &= left
            while bits != 0:
                found[n, 0], found[n, 1] = k, block * LANES + lane_of(bits)
                bits &= bits - np.uint32(1)
                n += 1
            if n > ROOM - LANES:
                total += add_found(
                    n, found, data, front, behind, own, row, reach, r2, origin, direction, stop, flux, patches,
                    touches, sign, sums, touched, base, log,
                )  # fmt: skip
                n = 0
    return total + add_found(
        n, found, data, front, behind, own, row, reach, r2, origin, direction, stop, flux, patches, touches, sign, sums,
        touched, base, log,
    )  # fmt: skip

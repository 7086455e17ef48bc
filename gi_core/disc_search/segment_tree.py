"""A lazily built tree over the segments (after Ray Maps, Havran et al. 2005): discs ask it.

A kd-tree over the box of the discs' middles. The list of a cell holds the segments that come within a disc's radius
of it, so a disc asks one leaf alone and no segment is met twice. A leaf is split only once enough discs have asked it
that splitting costs less than going on; where no disc asks, or no segment passes, nothing is ever built.
"""

from __future__ import annotations

import numpy as np

from gi_core.disc_search.crossing import (
    DISC_FIELDS,
    LANES,
    LINE_FIELDS,
    Discs,
    Lines,
    blocks,
    crossing,
    lane_of,
    share,
    to_list,
)
from gi_core.disc_search.found import ROOM, add_found
from gi_core.disc_search.line_list import fill_up, load
from gi_core.disc_search.pretest import lines_left, triangles
from gi_core.disc_search.space_curve import hilbert_order
from gi_core.jit import inlined, kernel
from gi_core.sums import Sums

BATCH = 1 << 15  # lines a tree
ASKED = 16  # discs that ask a leaf before it is split: two lists are written for the price of so many tests
LEAF = 4 * LANES  # lines that are not split further
LEAST_RADII = 4.0  # disc radii, edge of a cell that is not split further
ROUNDING = 4e-6  # of the distances in a line's arithmetic, with room
_LINE, _DISC, _SPAN = LINE_FIELDS * LANES, DISC_FIELDS * LANES, 2 * LANES


class SegmentTree:
    """Discs in Hilbert order, which ask a tree over the lines of a call; a share of the work is some of the lines."""

    parts_share_lines = False

    def __init__(self, discs: Discs, pretest: str = "none"):
        self.discs = discs
        rows = np.flatnonzero(to_list(discs))
        rows = rows[hilbert_order(discs.positions[rows])]
        self._count = len(rows)
        filled = np.full(-(-len(rows) // LANES) * LANES, -1)
        filled[: len(rows)] = rows
        self.blocks, self.pretest = blocks(discs, filled), triangles(pretest, discs, filled)
        p = discs.positions[rows]
        self._box = np.zeros((2, 3), np.float32)
        if len(rows):
            self._box[:] = p.min(axis=0), p.max(axis=0)
        self._far = float(np.abs(p).max(initial=0.0))
        self.nodes = 0  # of the last tree

    def splat(self, lines: Lines, sign: int, sums: Sums, part: int = 0, parts: int = 1) -> int:
        """Add sign x flux of lines to the sums of the discs they cross; see `gi_core.disc_search`."""
        first, last = share(len(lines.low), part, parts)
        if first == last or not self._count:
            return 0
        d = self.discs
        found, self.nodes = _splat(
            self._box, self._count, self._far, tuple(self.blocks), d.own, *d.regions[:2], d.radius, *lines, first, last,
            sign, *sums, self.pretest,
        )  # fmt: skip
        return found

    def told(self) -> str:
        """Return in words what was built."""
        return f"segment_tree: {self.nodes:,} cells in the last tree, for {self._count:,} discs"


@kernel
def _splat(
    box, discs_asking, far, discs, own, row, reach, radius,
    origin, direction, low, stop, high, flux, patches, touches, first, last, sign, sums, touched, base, log, pretest,
):  # fmt: skip
    data = discs[0]
    r2 = radius * radius
    adding = (
        *discs,
        own,
        row,
        reach,
        r2,
        origin,
        direction,
        stop,
        flux,
        patches,
        touches,
        sign,
        sums,
        touched,
        base,
        log,
    )
    found = np.empty((ROOM, 2), np.int64)
    room = 8 * (min(BATCH, last - first) // LANES + 1)
    lists, who = np.empty(room * _LINE, np.float32), np.empty(room * LANES, np.int32)
    spans = np.empty(room * _SPAN, np.float32)
    # A node: its cell, then both children or -1, first block of its list, number of lines, how many asked, axis or -1.
    cells, split = np.empty((1024, 6), np.float32), np.empty(1024, np.float32)
    nodes = np.empty((1024, 6), np.int32)
    total = n = count = 0
    for batch in range(first, last, BATCH):
        size = min(BATCH, last - batch)
        pad = np.float32(ROUNDING) * (load(origin, direction, low, high, batch, batch + size, lists, who) + far)
        _whole_spans(lists, spans, size)
        wide = radius + pad
        for c in range(3):
            cells[0, c], cells[0, 3 + c] = box[0, c], box[1, c]
        nodes[0, 0], nodes[0, 1], nodes[0, 2], nodes[0, 3], nodes[0, 4], nodes[0, 5] = -1, -1, 0, size, 0, -1
        count, used, leaf = 1, (size + LANES - 1) // LANES, 0
        for e in range(discs_asking):
            j = (e // LANES) * _DISC + e % LANES
            x, y, z = data[j], data[j + LANES], data[j + 2 * LANES]
            b = cells[leaf]
            if not (b[0] <= x and x <= b[3] and b[1] <= y and y <= b[4] and b[2] <= z and z <= b[5]):
                leaf = 0
            while True:
                # Ask the leaf, or split it if it has been asked often.
                if nodes[leaf, 5] < 0:
                    nodes[leaf, 4] += 1
                    if (
                        nodes[leaf, 3] <= LEAF
                        or nodes[leaf, 4] != ASKED
                        or not _choose(cells, split, nodes, leaf, radius)
                    ):
                        break
                axis = nodes[leaf, 5]
                at = x if axis == 0 else y if axis == 1 else z
                side = 1 if at >= split[leaf] else 0
                if nodes[leaf, side] < 0:
                    # Make this child now that it is asked for.
                    if count == len(cells):
                        cells, split, nodes = _grown(cells), _grown(split), _grown(nodes)
                    blocks_of = (nodes[leaf, 3] + LANES - 1) // LANES
                    if (used + blocks_of) * LANES > len(who):
                        more = 2 * (used + blocks_of)
                        lists, who = _room(lists, more * _LINE), _room(who, more * LANES)
                        spans = _room(spans, more * _SPAN)
                    held = _child(lists, who, spans, nodes[leaf], side, split[leaf], wide, used)
                    cells[count] = cells[leaf]
                    cells[count, axis + 3 * (1 - side)] = split[leaf]
                    nodes[count, 0], nodes[count, 1], nodes[count, 2], nodes[count, 3] = -1, -1, used, held
                    nodes[count, 4], nodes[count, 5] = 0, -1
                    nodes[leaf, side] = count
                    count, used = count + 1, used + (held + LANES - 1) // LANES
                leaf = nodes[leaf, side]
            if nodes[leaf, 3] == 0:
                continue
            nx, ny, nz, limit = data[j + 3 * LANES], data[j + 4 * LANES], data[j + 5 * LANES], data[j + 6 * LANES]
            for block in range(nodes[leaf, 2], nodes[leaf, 2] + (nodes[leaf, 3] + LANES - 1) // LANES):
                if pretest is not None:
                    left_over = lines_left(pretest, lists, block, e, x, y, z, nx, ny, nz)
                    if left_over == 0:
                        continue
                bits = crossing(lists, block, x, y, z, nx, ny, nz, limit, r2)
                if pretest is not None:
                    bits &= left_over
                while bits != 0:
                    found[n, 0], found[n, 1] = who[block * LANES + lane_of(bits)], e
                    bits &= bits - np.uint32(1)
                    n += 1
                if n > ROOM - LANES:
                    total += add_found(n, found, *adding)
                    n = 0
    return total + add_found(n, found, *adding), count


@kernel
def _whole_spans(lists, spans, size):
    """Begin with each line's whole interval as what lies in the root's cell."""
    for e in range((size + LANES - 1) // LANES * LANES):
        b, lane = e // LANES, e % LANES
        spans[b * _SPAN + lane] = lists[b * _LINE + 6 * LANES + lane]
        spans[b * _SPAN + LANES + lane] = lists[b * _LINE + 7 * LANES + lane]


@kernel
def _choose(cells, split, nodes, leaf, radius):
    """Choose the middle of the longest edge; False where the cell is too small."""
    axis, longest = 0, np.float32(-1.0)
    for c in range(3):
        edge = cells[leaf, 3 + c] - cells[leaf, c]
        if edge > longest:
            axis, longest = c, edge
    if longest <= np.float32(LEAST_RADII) * radius:
        return False
    nodes[leaf, 5] = axis
    split[leaf] = np.float32(0.5) * (cells[leaf, axis] + cells[leaf, 3 + axis])
    return True


@inlined
def _below(lists, spans, block, axis, wall):
    """Return which lines of a block come below a wall along an axis: a bit a lane."""
    base, at = np.uint64(block) * np.uint64(_LINE), np.uint64(block) * np.uint64(_SPAN)
    o, d = base + np.uint64(axis) * np.uint64(LANES), base + np.uint64(axis + 3) * np.uint64(LANES)
    bits = np.uint32(0)
    for lane in range(np.uint64(LANES)):
        a = lists[o + lane] + spans[at + lane] * lists[d + lane]
        b = lists[o + lane] + spans[at + np.uint64(LANES) + lane] * lists[d + lane]
        bits = np.uint32(bits | np.uint32(np.uint32(min(a, b) <= wall) << np.uint32(lane)))
    return bits


@inlined
def _above(lists, spans, block, axis, wall):
    """Return which lines of a block come above a wall along an axis: a bit a lane."""
    base, at = np.uint64(block) * np.uint64(_LINE), np.uint64(block) * np.uint64(_SPAN)
    o, d = base + np.uint64(axis) * np.uint64(LANES), base + np.uint64(axis + 3) * np.uint64(LANES)
    bits = np.uint32(0)
    for lane in range(np.uint64(LANES)):
        a = lists[o + lane] + spans[at + lane] * lists[d + lane]
        b = lists[o + lane] + spans[at + np.uint64(LANES) + lane] * lists[d + lane]
        bits = np.uint32(bits | np.uint32(np.uint32(max(a, b) >= wall) << np.uint32(lane)))
    return bits


@kernel
def _child(lists, who, spans, node, side, at, wide, onto):
    """Write the list of one child; returns how many lines it has. Those near the plane belong to both."""
    axis, first, count = node[5], node[2], node[3]
    wall = at - wide if side == 1 else at + wide
    n = 0
    for block in range(first, first + (count + LANES - 1) // LANES):
        bits = _above(lists, spans, block, axis, wall) if side == 1 else _below(lists, spans, block, axis, wall)
        rest = count - (block - first) * LANES
        if rest < LANES:
            bits = np.uint32(bits & np.uint32((1 << rest) - 1))
        while bits != 0:
            lane = lane_of(bits)
            bits &= bits - np.uint32(1)
            _copy(lists, who, spans, block, lane, onto + n // LANES, n % LANES, axis, wall, side == 0)
            n += 1
    fill_up(lists, onto, n)
    return n


@inlined
def _copy(lists, who, spans, block, lane, to_block, to_lane, axis, wall, keep_below):
    """Copy a line to a child's list, its span clipped at the child's wall (a disc's radius behind the plane).

    However flat the line meets the wall, what is cut off lies beyond it along this axis: nothing is lost.
    """
    i, j = block * _LINE + lane, to_block * _LINE + to_lane
    for field in range(LINE_FIELDS):
        lists[j + field * LANES] = lists[i + field * LANES]
    who[to_block * LANES + to_lane] = who[block * LANES + lane]
    o, d = lists[i + axis * LANES], lists[i + (axis + 3) * LANES]
    t0, t1 = spans[block * _SPAN + lane], spans[block * _SPAN + LANES + lane]
    t = (wall - o) / d
    if (d > 0) == keep_below:
        t1 = t if t < t1 and d != 0 else t1
    else:
        t0 = t if t > t0 and d != 0 else t0
    spans[to_block * _SPAN + to_lane], spans[to_block * _SPAN + LANES + to_lane] = t0, t1


@kernel
def _grown(array):
    out = np.empty((2 * len(array), *array.shape[1:]), array.dtype)
    out[: len(array)] = array
    return out


@kernel
def _room(array, n):
    out = np.empty(n, array.dtype)
    out[: len(array)] = array
    return out

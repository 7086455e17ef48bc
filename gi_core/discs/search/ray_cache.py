"""Ray cache (Lastra et al. 2002; report 1.2.1, 2.6): a stack of spheres, each with the segments that cross it.

Receivers are visited in an order that keeps neighbours together. Receivers in the smallest sphere are tested against
the few segments in its list. The list of a sphere is filled from that of its parent. If a list is empty, all
receivers of its sphere are skipped at once.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.bits import lowest_bit
from gi_core.base.hilbert_curve import hilbert_order
from gi_core.base.jit import allocating
from gi_core.base.vec import row
from gi_core.discs.search.accumulate import LISTED_AT_ONCE, add_accepted
from gi_core.discs.search.line_list import LineLists, load, push
from gi_core.discs.search.predicate import (
    DISC_FIELDS,
    LANES,
    LINE_FIELDS,
    Discs,
    Lines,
    blocks,
    lines_crossing,
    to_list,
)
from gi_core.discs.search.pretest import lines_left, triangles
from gi_core.discs.search.sphere_stack import stack_spheres
from gi_core.photons.flux_sums import Sums

BATCH = 1 << 15  # lines that go through all spheres together: a list of them is 1 MB
DISC_BLOCK = DISC_FIELDS * LANES


class RayCache:
    """Spheres over discs in Hilbert order; each part of the work is some blocks of neighbours."""

    parts_share_lines = True  # a part is some of the discs, with every line

    def __init__(self, discs: Discs, pretest: str = "none", ordered: bool = True):
        """ordered: visit the discs along a Hilbert curve, not in the order of the mesh."""
        self.discs = discs
        rows = np.flatnonzero(to_list(discs))
        if ordered:
            rows = rows[hilbert_order(discs.positions[rows])]
        self.spheres = stack_spheres(discs.positions[rows], float(discs.radius))
        filled = np.full(-(-len(rows) // LANES) * LANES, -1)
        filled[: len(rows)] = rows
        self.blocks, self.pretest = blocks(discs, filled), triangles(pretest, discs, filled)
        self._far = float(np.abs(discs.positions[rows]).max(initial=0.0))

    def accumulate(self, lines: Lines, sign: int, sums: Sums, part: int = 0, parts: int = 1) -> int:
        """Add sign x flux of lines to the sums of the discs they cross; see `gi_core.discs.search`."""
        s = self.spheres
        if not len(s.first):
            return 0
        # 8 runs of blocks per share of the work, spread over the receivers because light is uneven
        count = 8 * parts if parts > 1 else 1
        bounds = np.searchsorted(s.first, np.arange(count + 1) * s.last[0] // count)
        bounds[0], bounds[-1] = 0, len(s.first)
        return _accumulate(s, bounds, part, parts, self._far, self.blocks, self.discs, self.pretest, lines, sign, sums)

    def summary(self) -> str:
        """Return a summary of the structures."""
        deep = int(self.spheres.depth.max(initial=-1)) + 1
        return f"ray_cache: {len(self.spheres.first):,} spheres, stacked {deep} deep"


@allocating
def _accumulate(spheres, bounds, part, parts, far, blocks, discs, pretest, lines, sign, sums):
    low = lines.low
    depths = spheres.depth.max() + 2
    start, count = np.zeros(depths + 1, np.int64), np.zeros(depths + 1, np.int64)  # list 0 holds every line
    stack, candidates = np.zeros(depths, np.int64), np.empty((LISTED_AT_ONCE, 2), np.int64)
    room = 4 * (min(BATCH, len(low)) // LANES + 1)
    data, number = np.empty(room * LINE_FIELDS * LANES, np.float32), np.empty(room * LANES, np.int32)
    lists = LineLists(data, number, start, count)
    total = 0
    for batch in range(0, len(low), BATCH):
        count[0] = min(BATCH, len(low) - batch)
        # rounding of a line's arithmetic, with room: 4e-6 of the distances
        pad = np.float32(4e-6) * (load(lines, batch, batch + count[0], lists) + far)
        for block in range(part, len(bounds) - 1, parts):
            part_of = bounds[block], bounds[block + 1]
            more, lists = _visit(
                spheres, part_of, pad, lists, stack, candidates, blocks, discs, pretest, lines, sign, sums
            )
            total += more
    return total


@allocating
def _visit(spheres, part, pad, lists, stack, candidates, blocks, discs, pretest, lines, sign, sums):
    """Visit the receivers from the first one of sphere part[0] to that of sphere part[1]; lists may grow."""
    k, last = part
    start, count = lists.start, lists.count
    first_of, last_of, behind_of, parent, depth, centre, radius = spheres
    data, r2 = blocks.data, discs.radius * discs.radius
    at = first_of[k] if k < len(first_of) else last_of[0]
    end = first_of[last] if last < len(first_of) else last_of[0]
    n = total = height = 0
    # Push the spheres around the first one.
    while k < last and height < depth[k]:
        around = k
        for _ in range(depth[k] - height):
            around = parent[around]
        reaches = radius[around] + pad
        lists = push(lists, np.int64(height), row(centre, around), reaches * reaches)
        if count[height + 1] == 0:
            at, k = last_of[around], behind_of[around]
            break
        stack[height] = around
        height += 1
    while at < end:
        begins = end if k >= last else first_of[k]
        if height > 0:
            # Try the receivers up to where the next sphere begins or the smallest one ends.
            listed, number = lists.data, lists.number
            upto = min(last_of[stack[height - 1]], begins)
            for e in range(at, upto):
                j = (e // LANES) * DISC_BLOCK + e % LANES
                at_disc = data[j], data[j + LANES], data[j + 2 * LANES]
                normal = data[j + 3 * LANES], data[j + 4 * LANES], data[j + 5 * LANES]
                limit = data[j + 6 * LANES]
                for b in range(start[height], start[height] + (count[height] + LANES - 1) // LANES):
                    if pretest is not None:
                        left = lines_left(pretest, listed, b, e, at_disc, normal)
                        if left == 0:
                            continue
                    bits = lines_crossing(listed, b, at_disc, normal, limit, r2)
                    if pretest is not None:
                        bits &= left
                    while bits != 0:
                        candidates[n, 0], candidates[n, 1] = number[b * LANES + lowest_bit(bits)], e
                        bits &= bits - np.uint32(1)
                        n += 1
                    if n > LISTED_AT_ONCE - LANES:
                        total += add_accepted(n, candidates, blocks, discs, lines, sign, sums)
                        n = 0
            at = max(at, upto)
            if at >= last_of[stack[height - 1]]:
                height -= 1
                continue
        if k >= last:
            break
        # Push the next sphere; where nothing passes through it, pass over all that it holds.
        reaches = radius[k] + pad
        lists = push(lists, np.int64(height), row(centre, k), reaches * reaches)
        if count[height + 1] == 0:
            at, k = max(at, last_of[k]), behind_of[k]
        else:
            stack[height] = k
            height, k = height + 1, k + 1
    return total + add_accepted(n, candidates, blocks, discs, lines, sign, sums), lists

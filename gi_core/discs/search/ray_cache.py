"""Ray cache (Lastra et al. 2002; report 1.2.1, 2.6): a stack of spheres, each with the segments that cross it.

Receivers are visited in an order that keeps neighbours together. Receivers in the smallest sphere are tested against
the few segments in its list. The list of a sphere is filled from that of its parent. If a list is empty, all
receivers of its sphere are skipped at once.

A list holds lines in blocks, each block in one piece of memory: the x of LANES origins, then their y, ... then low and
high, so vector instructions test 16 lines against one sphere or disc. Lists are padded with fillers: lines that cross
nothing.

A sphere is pushed around the first receiver inside its parent. It is popped at the first receiver whose disc is not
entirely inside. Receivers do not move in object space, so pushes and pops are computed once per object. Each sphere is
then shrunk to its discs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, inlined, kernel, lowest_bit
from gi_core.base.nearest_points import hilbert_order
from gi_core.base.vec import difference, dot, row
from gi_core.discs.search.predicate import (
    DISC_FIELDS,
    LANES,
    LINE_FIELDS,
    LISTED_AT_ONCE,
    Discs,
    Lines,
    add_accepted,
    blocks,
    lines_crossing,
    offset,
    three,
    to_list,
)
from gi_core.photons.flux_sums import Sums

SHRINK = 0.5  # radius of a sphere over its parent's, see docs/decisions/disc-searches.md
LEAST_RADII = 2.0  # disc radii: radius of the smallest sphere


class Spheres(NamedTuple):
    """Spheres in the order of pushes. The spheres inside sphere k are k + 1 .. behind[k] - 1."""

    first: np.ndarray  # (K,) int32, receivers first .. last - 1 of the order are inside
    last: np.ndarray  # (K,) int32
    behind: np.ndarray  # (K,) int32
    parent: np.ndarray  # (K,) int32, -1 of the root
    depth: np.ndarray  # (K,) int32, 0 of the root
    centre: np.ndarray  # (K, 3) float32 [m]
    radius: np.ndarray  # (K,) float32 [m]


def stack_spheres(points: np.ndarray, reach: float) -> Spheres:
    """Return the spheres over discs of radius `reach` [m] around points (n, 3), in the given order."""
    points = np.ascontiguousarray(points, np.float64)
    whole = 0.5 * float(np.sqrt((np.ptp(points, axis=0) ** 2).sum())) + 2 * reach if len(points) else 0.0
    count = max(0, int(np.ceil(np.log(max(whole / (LEAST_RADII * reach), 1.0)) / -np.log(SHRINK))))
    radii = LEAST_RADII * reach * SHRINK ** -np.arange(count - 1.0, -1.0, -1.0)
    room = len(points) * (count + 1) + 1
    first, last, parent = (np.empty(room, np.int32) for _ in range(3))
    n = _push_and_pop(points, reach, radii, first, last, parent)
    first, last, parent = first[:n].copy(), last[:n].copy(), parent[:n].copy()
    behind, depth = np.empty(n, np.int32), np.zeros(n, np.int32)
    centre, radius = np.empty((n, 3), np.float32), np.empty(n, np.float32)
    _tighten(points, reach, first, last, parent, behind, depth, centre, radius)
    return Spheres(first, last, behind, parent, depth, centre, radius)


@allocating
def _push_and_pop(points, reach, radii, first, last, parent):
    """Write the spheres in the order of pushes; return their number.

    Spheres with the same receivers as their parent, or with few receivers, are left out.
    """
    n, depth = len(points), 0
    begun, centre = np.zeros(len(radii), np.int64), np.zeros((len(radii), 3))
    if n == 0:
        return 0
    first[0], last[0], parent[0] = 0, n, -1
    spheres = 1
    # The last receiver of a sphere is known only at its pop, hence two passes.
    ends = np.zeros((len(radii), n), np.int32)
    for i in range(n + 1):
        keep = 0
        while i < n and keep < depth:
            off, room = difference(points[i], centre[keep]), radii[keep] - reach
            if dot(off, off) > room * room:
                break
            keep += 1
        for level in range(keep, depth):
            ends[level, begun[level]] = i
        for level in range(keep, len(radii)):
            if i < n:
                begun[level] = i
                centre[level, 0], centre[level, 1], centre[level, 2] = points[i, 0], points[i, 1], points[i, 2]
        depth = len(radii)
    on_stack = np.zeros(len(radii) + 1, np.int64)
    height = 1
    for i in range(n):
        while last[on_stack[height - 1]] <= i:
            height -= 1
        for level in range(len(radii)):
            end = ends[level, i]
            above = on_stack[height - 1]
            # a sphere of fewer than 4 receivers costs more than it saves
            if end - i < 4 or (first[above] == i and last[above] == end):
                continue
            first[spheres], last[spheres], parent[spheres] = i, end, above
            on_stack[height] = spheres
            height += 1
            spheres += 1
    return spheres


@allocating
def _tighten(points, reach, first, last, parent, behind, depth, centre, radius):
    for k in range(len(first)):
        if parent[k] >= 0:
            depth[k] = depth[parent[k]] + 1
        low, high = points[first[k]].copy(), points[first[k]].copy()
        for i in range(first[k], last[k]):
            for c in range(3):
                low[c], high[c] = min(low[c], points[i, c]), max(high[c], points[i, c])
        most = 0.0
        middle = 0.5 * (low + high)
        for i in range(first[k], last[k]):
            off = difference(points[i], middle)
            most = max(most, dot(off, off))
        for c in range(3):
            centre[k, c] = middle[c]
        radius[k] = (np.sqrt(most) + reach) * (1.0 + 1e-3)  # 1e-3 of a sphere's radius covers rounding
    # In push order, a sphere ends where the next sphere of its depth or above begins.
    for k in range(len(first) - 1, -1, -1):
        j = k + 1
        while j < len(first) and depth[j] > depth[k]:
            j = behind[j]
        behind[k] = j


_BLOCK = LINE_FIELDS * LANES


class LineLists(NamedTuple):
    """A stack of lists of lines: list h holds count[h] lines from block start[h] on."""

    data: np.ndarray  # (blocks * 128,) float32, in blocks
    number: np.ndarray  # (blocks * LANES,) int32, number of each line
    start: np.ndarray  # (depths,) int64
    count: np.ndarray  # (depths,) int64


@kernel
def load(lines, first, last, lists):
    """Write lines first .. last - 1 into the first blocks; return the largest distance of an origin from 0 [m]."""
    far, data = np.float32(0.0), lists.data
    for k in range(first, last):
        e = k - first
        j = (e // LANES) * _BLOCK + e % LANES
        for c in range(3):
            data[j + c * LANES] = lines.origin[k, c]
            data[j + (3 + c) * LANES] = lines.direction[k, c]
            far = max(far, abs(lines.origin[k, c]))
        data[j + 6 * LANES], data[j + 7 * LANES] = lines.low[k], lines.high[k]
        lists.number[e] = k
    fill_up(data, 0, last - first)
    return far


@kernel
def fill_up(data, block, count):
    """Pad the last block of a list of `count` lines, which begins at `block`, with fillers."""
    for e in range(count, (count + LANES - 1) // LANES * LANES):
        j = (block + e // LANES) * _BLOCK + e % LANES
        for field in range(6):
            data[j + field * LANES] = np.float32(0.0)
        data[j + 6 * LANES], data[j + 7 * LANES] = np.float32(np.inf), np.float32(-np.inf)


@inlined
def _lines_inside(data, block, centre, r2):
    """Return the lines of a block that pass through a sphere, one bit per lane. By nearest points, without branches."""
    base = np.uint64(block) * np.uint64(_BLOCK)
    bits = np.uint32(0)
    for lane in range(np.uint64(LANES)):
        j = base + lane
        a, direction = difference(centre, three(data, j)), three(data, j + np.uint64(3 * LANES))
        t = min(max(dot(a, direction), data[j + np.uint64(6 * LANES)]), data[j + np.uint64(7 * LANES)])
        p = offset(a, t, direction)
        yes = dot(p, p) <= r2
        bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits


@allocating
def push(lists, height, centre, r2):
    """Write the lines of list `height` that pass through a sphere to list height + 1, behind it in the same memory.

    Returns the lists, reallocated if memory was too small. A filler is infinitely far away: the clamp
    leaves t = -inf.
    """
    data, number, start, count = lists
    first, blocks = start[height], (count[height] + LANES - 1) // LANES
    onto, n = first + blocks, 0
    if (onto + blocks) * LANES > len(number):
        data, number = _grown(data, 2 * (onto + blocks) * _BLOCK), _grown(number, 2 * (onto + blocks) * LANES)
    for b in range(first, onto):
        bits = _lines_inside(data, b, centre, r2)
        while bits != 0:
            lane = lowest_bit(bits)
            bits &= bits - np.uint32(1)
            i, j = b * _BLOCK + lane, (onto + n // LANES) * _BLOCK + n % LANES
            for field in range(LINE_FIELDS):
                data[j + field * LANES] = data[i + field * LANES]
            number[onto * LANES + n] = number[b * LANES + lane]
            n += 1
    fill_up(data, onto, n)
    start[height + 1], count[height + 1] = onto, n
    return LineLists(data, number, start, count)


@allocating
def _grown(array, n):
    out = np.empty(n, array.dtype)
    out[: len(array)] = array
    return out


BATCH = 1 << 15  # lines that go through all spheres together: a list of them is 1 MB
DISC_BLOCK = DISC_FIELDS * LANES


class RayCache:
    """Spheres over discs in Hilbert order."""

    def __init__(self, discs: Discs):
        self.discs = discs
        rows = np.flatnonzero(to_list(discs))
        rows = rows[hilbert_order(discs.positions[rows])]
        self.spheres = stack_spheres(discs.positions[rows], float(discs.radius))
        filled = np.full(-(-len(rows) // LANES) * LANES, -1)
        filled[: len(rows)] = rows
        self.blocks = blocks(discs, filled)
        self._far = float(np.abs(discs.positions[rows]).max(initial=0.0))

    def accumulate(self, lines: Lines, sign: int, sums: Sums) -> int:
        if not len(self.spheres.first):
            return 0
        return _accumulate(self.spheres, self._far, self.blocks, self.discs, lines, sign, sums)

    def summary(self) -> str:
        deep = int(self.spheres.depth.max(initial=-1)) + 1
        return f"ray_cache: {len(self.spheres.first):,} spheres, stacked {deep} deep"


@allocating
def _accumulate(spheres, far, blocks, discs, lines, sign, sums):
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
        more, lists = _visit(spheres, pad, lists, stack, candidates, blocks, discs, lines, sign, sums)
        total += more
    return total


@allocating
def _visit(spheres, pad, lists, stack, candidates, blocks, discs, lines, sign, sums):
    """Visit all receivers; lists may grow."""
    start, count = lists.start, lists.count
    first_of, last_of, behind_of, _, _, centre, radius = spheres
    data, r2 = blocks.data, discs.radius * discs.radius
    n = total = height = at = k = 0
    while at < last_of[0]:
        begins = first_of[k] if k < len(first_of) else last_of[0]
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
                    bits = lines_crossing(listed, b, at_disc, normal, limit, r2)
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
        # Push the next sphere; where nothing passes through it, pass over all that it holds.
        reaches = radius[k] + pad
        lists = push(lists, np.int64(height), row(centre, k), reaches * reaches)
        if count[height + 1] == 0:
            at, k = max(at, last_of[k]), behind_of[k]
        else:
            stack[height] = k
            height, k = height + 1, k + 1
    return total + add_accepted(n, candidates, blocks, discs, lines, sign, sums), lists

"""The one predicate that decides whether a segment crosses a receiver's disc.

Every disc search calls discs_crossed() and accepts(). A search only chooses the discs to test, a superset of those
crossed. All arithmetic is float32 in a fixed order, so a decision has the same bits everywhere.

Accepted candidates are added to the sums. They are listed first: memory accesses overlap in a separate loop.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import difference, dot, largest, rotate_back, row
from gi_core.discs.region import EXTENSION, Regions, inside
from gi_core.geometry.receivers import NONE
from gi_core.model import BEHIND, Model
from gi_core.photons.flux_sums import CHUNK_BITS
from gi_core.photons.paths import Segments
from gi_core.rays.accelerator import GAP, Transforms, line
from gi_core.retrace.cuts import RemovedSuffixes

LISTED_AT_ONCE = 2048  # candidates listed before they are added


@kernel
def add_accepted(n, candidates, blocks, discs, lines, sign, sums):
    """Add sign x flux of the accepted ones of n candidates (line, entry of blocks); return their number.

    The log gets the bits of t that decided.
    """
    total, log = 0, sums.log
    for f in range(n):
        k = candidates[f, 0]
        i, centre, normal = receiver(blocks, candidates[f, 1], lines.direction[k])
        if i >= 0 and accepts(discs, i, centre, normal, lines, k):
            total += 1
            for c in range(3):
                sums.flux[i, 3 * lines.lamp[k] + c] += sign * lines.flux[k, c]
            sums.touched[(sums.first + i) >> CHUNK_BITS] = True
            if len(log.line):
                at = log.count[0]
                log.count[0] = at + 1
                if at < len(log.line):
                    log.line[at], log.receiver[at] = k, i
                    slope = dot(lines.direction[k], normal)
                    log.distance[at] = dot(difference(centre, lines.origin[k]), normal) / slope
    return total


LANES = 16  # discs tested at a time: two AVX2 vectors, one of AVX-512
DISC_FIELDS = 7  # x, y, z of a position and of a normal, and the limit of the slope
_BLOCK = np.uint64(DISC_FIELDS * LANES)
LINE_FIELDS = 8  # x, y, z of an origin and of a direction, low, high
_LINE_BLOCK = np.uint64(LINE_FIELDS * LANES)
_NORMAL, _LIMIT, _HIGH = np.uint64(3 * LANES), np.uint64(6 * LANES), np.uint64(7 * LANES)  # normal or direction; ...


class Discs(NamedTuple):
    """Receivers' discs in one object's space."""

    positions: np.ndarray  # (R, 3) float32 [m]
    normals: np.ndarray  # (R, 3) float32 unit
    own: np.ndarray  # (R,) int32, 2 patch + side of the receiver, NONE of a probe
    back: np.ndarray  # (R,) int32, receiver on the other side of the same disc or NONE; BEHIND on those themselves
    radius: np.float32  # [m]
    regions: Regions  # the part of each disc that light can reach


class Blocks(NamedTuple):
    """Discs in blocks of LANES, each block contiguous; lists are padded with fillers.

    A disc of a two-sided surface serves the receivers on both its sides.
    """

    data: np.ndarray  # (E / LANES * 112,) float32: LANES x, LANES y, ... of positions, of normals, limits
    front: np.ndarray  # (E,) int32 receiver that sees lines against the normal, NONE
    behind: np.ndarray  # (E,) int32 receiver that sees lines along the normal, NONE


class Lines(NamedTuple):
    """Segments prepared for disc tests, in the discs' space."""

    origin: np.ndarray  # (S, 3) float32
    direction: np.ndarray  # (S, 3) float32 unit
    low: np.ndarray  # (S,) float32, where the segment begins ...
    stop: np.ndarray  # (S,) float32, ... and ends, see extended()
    high: np.ndarray  # (S,) float32, where its extension on a concave side ends
    flux: np.ndarray  # (S, 3) int32
    lamp: np.ndarray  # (S,) uint8, lamp of the photon
    patches: np.ndarray  # (S, 3) int32, 2 patch + side at start, static end, cut; NONE
    touches: np.ndarray  # (S, 3, 3) float32, those three points


@inlined
def extended(t, origin, least):
    """Return where a part ends that ends at distance t of a line, and where the rest begins, float32 [m].

    The part that arrives at a surface then crosses a disc in its plane, and the one that leaves does not. least
    (float32) [m]: to add, more where the coordinates of a long line are rounded more.
    """
    return t + max(least, np.float32(GAP) * (largest(origin) + t))


@kernel
def _begins(removed, least, out):
    """Write where removed suffixes begin (n,)."""
    for j in range(len(out)):
        out[j] = removed.low[j]
        if removed.low[j] >= 0.0:
            out[j] = extended(removed.low[j], row(removed.paths.position, removed.vertex[j]), least)


def begins(removed: RemovedSuffixes, radius: float) -> np.ndarray:
    """Return from where on intersections of the cut segments count as removed, (n,) float32 [m]."""
    out = np.empty(len(removed.low), np.float32)
    _begins(removed, np.float32(EXTENSION * radius), out)
    return out


def longest_extension(model: Model, at: Transforms, radius: float) -> float:
    """Return the most [m] by which extended() lengthens a segment that lands at objects in `at`."""
    reach = np.abs(at.position) + np.abs([model.world.box_low, model.world.box_high]).max(axis=(0, 2))[:, None]
    return max(EXTENSION * radius, 4 * GAP * max(model.farthest, float(reach.max())))


@kernel
def _carry(R, p, segments, patch, concave, radius, out):
    """Write lines of segments: R, p the pose of the discs' object, patch (F,), concave (2 patches,)."""
    least = np.float32(EXTENSION * radius)
    for k in range(len(out.stop)):
        _put(out.touches[k, 0], rotate_back(R, difference(segments.origin[k], p)))
        _put(out.touches[k, 1], rotate_back(R, difference(segments.end[k], p)))
        _put(out.touches[k, 2], rotate_back(R, difference(segments.hit[k], p)))
        a, b = out.touches[k, 0], out.touches[k, 1]
        _put(out.origin[k], a)
        dx, dy, dz, length = line(a[0], a[1], a[2], b[0], b[1], b[2])
        _put(out.direction[k], (dx, dy, dz))
        start = row(segments.origin, k)
        if segments.low[k] < 0.0:
            out.low[k] = min(extended(np.float32(0.0), start, least), np.float32(0.5) * length)
        else:
            out.low[k] = extended(segments.low[k], start, least)
        lands = segments.end_side[k] != NONE or segments.cut_side[k] != NONE
        out.stop[k] = extended(segments.high[k], start, least) if lands else segments.high[k]
        out.patches[k, 0] = _patch_side(patch, segments.start_side[k])
        out.patches[k, 1] = _patch_side(patch, segments.end_side[k])
        out.patches[k, 2] = _patch_side(patch, segments.cut_side[k])
        landed = out.patches[k, 2] if out.patches[k, 2] != NONE else out.patches[k, 1]
        out.high[k] = out.stop[k]
        if landed != NONE and concave[landed]:
            out.high[k] += np.float32(2.0 * radius)


@inlined
def _put(row, a):
    row[0], row[1], row[2] = a[0], a[1], a[2]


@inlined
def _patch_side(patch, side):
    """Return 2 patch + side of a face's side, NONE of none."""
    return 2 * patch[side >> 1] + (side & 1) if side >= 0 else NONE


def share(n: int, part: int, parts: int) -> tuple[int, int]:
    """Return first and last of share `part` when n items are split into `parts` shares."""
    return n * part // parts, n * (part + 1) // parts


def lines(segments: Segments, rotation, position, model: Model, radius: float) -> Lines:
    """Return segments transformed to an object's space.

    A segment that lands on a concave side of a patch is extended by 2 radius: see accepts(). Others
    are not: behind a wall a cupboard may hold thousands of discs.
    """
    s, n = segments, segments.size
    out = Lines(
        *np.empty((2, n, 3), np.float32),
        *np.empty((3, n), np.float32),
        s.flux,
        s.lamp,
        np.empty((n, 3), np.int32),
        np.empty((n, 3, 3), np.float32),
    )
    _carry(rotation, position, segments, model.surfaces.patch, model.concave, radius, out)
    return out


@inlined
def _crosses(centre, normal, limit, origin, direction, low, high, r2):
    """Return whether a line crosses a disc at t in [low, high), from a visible side: the predicate itself.

    Everything is float32, nothing branches. A line in the plane of a disc divides by zero, a filler 0 by 0;
    inf and nan fail the comparisons.
    """
    slope = dot(direction, normal)
    a = difference(centre, origin)
    t = dot(a, normal) / slope
    p = offset(a, t, direction)
    return (slope < limit) & (t >= low) & (t < high) & (dot(p, p) <= r2)


@inlined
def offset(a, t, direction):
    """Return the point of a line at t relative to a disc's centre; a: from the line's origin to the centre."""
    return t * direction[0] - a[0], t * direction[1] - a[1], t * direction[2] - a[2]


@inlined
def three(data, j):
    """Return three fields in a row of the lane of entry j of a block; j is unsigned."""
    return data[j], data[j + np.uint64(LANES)], data[j + np.uint64(2 * LANES)]


@inlined
def discs_crossed(data, block, origin, direction, low, high, r2):
    """Return the discs of a block that a line crosses, one bit per lane. origin, direction: tuples.

    LLVM vectorises the loop: it has no branch, a fixed length, unsigned indices (checks for negative ones
    would prevent it) and no memory writes.
    """
    base = np.uint64(block) * _BLOCK
    bits = np.uint32(0)
    for lane in range(np.uint64(LANES)):
        j = base + lane
        centre, normal, limit = three(data, j), three(data, j + _NORMAL), data[j + _LIMIT]
        yes = _crosses(centre, normal, limit, origin, direction, low, high, r2)
        bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits


@inlined
def lines_crossing(data, block, centre, normal, limit, r2):
    """Return the lines of a block of a line list that cross one disc: discs_crossed() with exchanged roles."""
    base = np.uint64(block) * _LINE_BLOCK
    bits = np.uint32(0)
    for lane in range(np.uint64(LANES)):
        j = base + lane
        origin, direction = three(data, j), three(data, j + _NORMAL)
        low, high = data[j + _LIMIT], data[j + _HIGH]
        yes = _crosses(centre, normal, limit, origin, direction, low, high, r2)
        bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits


@inlined
def receiver(blocks, e, direction):
    """Return the receiver of a line's intersection with the disc of entry e, or NONE; its position; its normal."""
    j = (e // LANES) * (DISC_FIELDS * LANES) + e % LANES
    data = blocks.data
    centre = data[j], data[j + LANES], data[j + 2 * LANES]
    nx, ny, nz = data[j + 3 * LANES], data[j + 4 * LANES], data[j + 5 * LANES]
    if dot(direction, (nx, ny, nz)) < np.float32(0.0):
        return blocks.front[e], centre, (nx, ny, nz)
    return blocks.behind[e], centre, (-nx, -ny, -nz)


def blocks(discs: Discs, rows: np.ndarray) -> Blocks:
    """Return blocks of some discs (n,), a multiple of LANES; a row of -1 is a filler, never crossed."""
    kept, at = rows >= 0, np.maximum(rows, 0)
    data = np.zeros((len(rows) // LANES, DISC_FIELDS, LANES), np.float32)
    for f, (array, c) in enumerate((a, c) for a in (discs.positions, discs.normals) for c in range(3)):
        data[:, f] = np.where(kept, array[at, c], np.float32(0)).reshape(-1, LANES)
    lit = discs.regions.area > 0
    front = np.where(kept & lit[at], at, NONE)
    behind = np.where(kept, discs.back[at], NONE)
    behind[(behind >= 0) & ~lit[behind]] = NONE
    data[:, 6] = np.where(behind >= 0, np.inf, 0.0).reshape(-1, LANES)
    return Blocks(data.reshape(-1), front.astype(np.int32), behind.astype(np.int32))


def to_list(discs: Discs) -> np.ndarray:
    """Return (R,) bool: discs to list, of receivers that light can reach; the back of a listed disc is not listed."""
    lit = discs.regions.area > 0
    return (discs.back != BEHIND) & (lit | ((discs.back >= 0) & lit[discs.back]))


@inlined
def _meets(e, mine, k, centre, r2, lines):
    """Return whether line k meets the receiver's patch at its point e (either side) within 2r."""
    a = difference(lines.touches[k, e], centre)
    return (mine >= 0) & (lines.patches[k, e] >> 1 == mine >> 1) & (dot(a, a) <= np.float32(4.0) * r2)


@inlined
def accepts(discs, i, centre, normal, lines, k):
    """Return whether receiver i at `centre` accepts the intersection of line k that discs_crossed() found.

    - A segment that starts or ends on the receiver's own patch within 2r of it counts only for its
      side there. On a convex surface the disc floats in front, and light that leaves the front
      crosses it from behind. (On a sphere such a start is within 2r, exactly.)
    - Behind its hit a segment counts for at most 2r, only on the patch of the hit and within 2r of it:
      a concave surface rises through its own tangent disc (report 1.2.1).
    - The intersection must lie in the reachable region of the disc.

    There is no branch until the last rule. Two in five intersections with a tree's leaves fail the first, and branch
    mispredictions took more than half of the time (124 to 50 ns).
    """
    r2, mine, patches = discs.radius * discs.radius, discs.own[i], lines.patches
    direction = lines.direction[k]
    a = difference(centre, lines.origin[k])
    t = dot(a, normal) / dot(direction, normal)
    starts = _meets(0, mine, k, centre, r2, lines)
    ends = _meets(1, mine, k, centre, r2, lines)
    cut = _meets(2, mine, k, centre, r2, lines)
    elsewhere = (starts & (patches[k, 0] != mine)) | (ends & (patches[k, 1] != mine)) | (cut & (patches[k, 2] != mine))
    is_cut = patches[k, 2] != NONE  # a mobile stops this part
    lands = cut if is_cut else ends
    accepted = (not elsewhere) & ((t < lines.stop[k]) | lands)
    row = discs.regions.row[i]
    if accepted and row >= 0:
        layer = 1 if ends | cut else 0
        return inside(offset(a, t, direction), normal, math.sqrt(r2), discs.regions.reach, row, layer)
    return accepted


@kernel
def crossing(discs, i, lines, out):
    """Write which lines (n,) bool count at receiver i, by the predicate alone."""
    centre = discs.positions[i, 0], discs.positions[i, 1], discs.positions[i, 2]
    normal = discs.normals[i, 0], discs.normals[i, 1], discs.normals[i, 2]
    r2, none = discs.radius * discs.radius, np.float32(0.0)
    for k in range(len(out)):
        o = lines.origin[k, 0], lines.origin[k, 1], lines.origin[k, 2]
        d = lines.direction[k, 0], lines.direction[k, 1], lines.direction[k, 2]
        meets = _crosses(centre, normal, none, o, d, lines.low[k], lines.high[k], r2)
        out[k] = meets and accepts(discs, i, centre, normal, lines, k)

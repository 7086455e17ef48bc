"""The one predicate that decides whether a segment crosses a receiver's disc, and what it adds.

Every disc search calls crossed() and counts(); a search only chooses which discs are tried, and is a
superset. All arithmetic is float32 with a fixed order, so a decision has the same bits everywhere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.accelerator import line, to_local
from gi_core.jit import inlined, kernel
from gi_core.model import Model
from gi_core.paths import NONE, Segments
from gi_core.reachable_area import PLAIN, Regions, inside

LANES = 16  # discs tested at a time: two AVX2 vectors
_STEP = np.uint64(LANES)


class Discs(NamedTuple):
    """Receivers' discs in one object's space."""

    positions: np.ndarray  # (R, 3) float32 [m]
    normals: np.ndarray  # (R, 3) float32 unit
    own: np.ndarray  # (R,) int32, 2 patch + side of the receiver, NONE of a probe
    radius: np.float32  # [m]
    regions: Regions  # which part of each disc light can reach


class Lines(NamedTuple):
    """Segments made ready for disc tests, in the discs' space."""

    origin: np.ndarray  # (S, 3) float32
    direction: np.ndarray  # (S, 3) float32 unit
    low: np.ndarray  # (S,) float32
    stop: np.ndarray  # (S,) float32, where the segment ends ...
    high: np.ndarray  # (S,) float32, ... and where its extension behind the hit does
    flux: np.ndarray  # (S, 3) int32
    patches: np.ndarray  # (S, 3) int32, 2 patch + side at start, static end, cut; NONE
    touches: np.ndarray  # (S, 3, 3) float32, those three points


@kernel
def _lines(
    R, p, origin, end, hit, start_side, end_side, cut_side, stop, patch, concave, extension,
    o, d, high, patches, touches, first, last,
):  # fmt: skip
    for k in range(first, last):
        x, y, z = to_local(R, origin[k, 0] - p[0], origin[k, 1] - p[1], origin[k, 2] - p[2])
        touches[k, 0, 0], touches[k, 0, 1], touches[k, 0, 2] = x, y, z
        x, y, z = to_local(R, end[k, 0] - p[0], end[k, 1] - p[1], end[k, 2] - p[2])
        touches[k, 1, 0], touches[k, 1, 1], touches[k, 1, 2] = x, y, z
        x, y, z = to_local(R, hit[k, 0] - p[0], hit[k, 1] - p[1], hit[k, 2] - p[2])
        touches[k, 2, 0], touches[k, 2, 1], touches[k, 2, 2] = x, y, z
        a, b = touches[k, 0], touches[k, 1]
        o[k, 0], o[k, 1], o[k, 2] = a[0], a[1], a[2]
        d[k, 0], d[k, 1], d[k, 2], _ = line(a[0], a[1], a[2], b[0], b[1], b[2])
        patches[k, 0] = 2 * patch[start_side[k] >> 1] + (start_side[k] & 1) if start_side[k] >= 0 else NONE
        patches[k, 1] = 2 * patch[end_side[k] >> 1] + (end_side[k] & 1) if end_side[k] >= 0 else NONE
        patches[k, 2] = 2 * patch[cut_side[k] >> 1] + (cut_side[k] & 1) if cut_side[k] >= 0 else NONE
        landed = patches[k, 2] if patches[k, 2] != NONE else patches[k, 1]
        high[k] = stop[k]
        if landed != NONE and concave[landed]:
            high[k] += extension


def room_for_lines(segments: Segments) -> Lines:
    """Return room for the lines of some segments; fill_lines() writes them."""
    s, n = segments, segments.size
    return Lines(
        np.empty((n, 3), np.float32),
        np.empty((n, 3), np.float32),
        s.low,
        s.high,
        np.empty(n, np.float32),
        s.flux,
        np.empty((n, 3), np.int32),
        np.empty((n, 3, 3), np.float32),
    )


def fill_lines(
    out: Lines, segments: Segments, rotation, position, model: Model, radius: float, first: int, last: int
) -> None:
    """Carry segments first .. last - 1 into an object's space.

    A segment that lands on a concave side of a patch is extended by 2 radius: see counts(). Others
    are not: behind a wall a cupboard may hold thousands of discs.
    """
    s = segments
    _lines(
        rotation, position, s.origin, s.end, s.hit, s.start_side, s.end_side, s.cut_side, s.high, model.surfaces.patch,
        model.concave, np.float32(2 * radius), out.origin, out.direction, out.high, out.patches, out.touches,
        first, last,
    )  # fmt: skip


@kernel
def crossed(cx, cy, cz, nx, ny, nz, first, last, ox, oy, oz, dx, dy, dz, low, high, r2, mask):
    """Set mask[j - first] for the discs first .. last - 1 that a line crosses from the front at t in [low, high).

    Returns how many. Everything is float32. The loop has no branch and a fixed length: LLVM makes it
    vectors without a scalar rest, which for the 8 to 60 discs of a cell used to take most of the time.
    `first` and `last` are unsigned multiples of LANES: columns() fills up. (Checks for negative indices
    stop LLVM; slices would do, but counting references to six of them costs more than a small cell.)
    A line in the plane of a disc divides by zero, a filler 0 by 0; inf and nan fail the comparisons.
    """
    count = 0
    for block in range(first, last, _STEP):
        for lane in range(_STEP):
            j = block + lane
            slope = dx * nx[j] + dy * ny[j] + dz * nz[j]
            ax, ay, az = cx[j] - ox, cy[j] - oy, cz[j] - oz
            t = (ax * nx[j] + ay * ny[j] + az * nz[j]) / slope
            px, py, pz = t * dx - ax, t * dy - ay, t * dz - az
            yes = (slope < 0.0) & (t >= low) & (t < high) & (px * px + py * py + pz * pz <= r2)
            mask[j - first] = yes
            count += yes
    return count


def columns(positions: np.ndarray, normals: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return x, y, z of positions and of normals of some rows (n,); a row of -1 is a filler, never crossed."""
    kept = rows >= 0
    return tuple(
        np.where(kept, a[np.where(kept, rows, 0), c], np.float32(0)) for a in (positions, normals) for c in range(3)
    )


@inlined
def _touches_own(own, k, e, x, y, z, r2, patches, touches):
    """Tell whether the segment meets the receiver's patch at its point e (either side) within 2r."""
    if patches[k, e] == NONE or patches[k, e] >> 1 != own >> 1:
        return False
    a, b, c = touches[k, e, 0] - x, touches[k, e, 1] - y, touches[k, e, 2] - z
    return a * a + b * b + c * c <= np.float32(4.0) * r2


@inlined
def counts(i, x, y, z, nx, ny, nz, k, ox, oy, oz, dx, dy, dz, stop, r2, own, row, reach, patches, touches):
    """Tell whether a crossing of line k that crossed() found counts for receiver i at (x, y, z).

    Most receivers are PLAIN, one-sided with nothing in reach: all that crosses them before the end of
    the segment counts. Asking that first halves the cost of a crossing in cornell (170 to 90 ns),
    where a tenth of the receivers are not.
    """
    ax, ay, az = x - ox, y - oy, z - oz
    t = (ax * nx + ay * ny + az * nz) / (dx * nx + dy * ny + dz * nz)
    if row[i] == PLAIN and t < stop:
        return True
    px, py, pz = t * dx - ax, t * dy - ay, t * dz - az
    return _counts(i, x, y, z, nx, ny, nz, k, px, py, pz, t >= stop, r2, own, row, reach, patches, touches)


@inlined
def _counts(i, x, y, z, nx, ny, nz, k, px, py, pz, behind, r2, own, row, reach, patches, touches):
    """Tell whether the crossing at offset p from receiver i counts.

    - A segment that starts or ends on the receiver's own patch within 2r of it counts only for the
      side on which it lives there: on a convex surface the disc floats in front, and light that
      leaves the front crosses it from behind. (On a sphere such a start is within 2r, exactly.)
    - Behind its hit a segment counts for at most 2r, and only on the patch that it hit, within 2r of
      the hit: a concave surface rises through its own tangent disc (report 1.2.1).
    - The crossing must lie in the reachable region of the disc.
    """
    mine = own[i]
    lands = False
    if mine != NONE:
        for e in range(3):
            if _touches_own(mine, k, e, x, y, z, r2, patches, touches):
                if patches[k, e] != mine:
                    return False
                lands = lands or e > 0
    if behind:
        e = 2 if patches[k, 2] != NONE else 1  # what really stops this part
        if mine == NONE or patches[k, e] != mine or not _touches_own(mine, k, e, x, y, z, r2, patches, touches):
            return False
    if row[i] >= 0:
        return inside(px, py, pz, nx, ny, nz, math.sqrt(r2), reach, row[i], 1 if lands else 0)
    return True

"""The one predicate that decides whether a segment crosses a receiver's disc, and what it adds.

Every disc search calls crossed() and counts(); a search only chooses which discs are tried, and is a
superset. All arithmetic is float32 with a fixed order, so a decision has the same bits everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.accelerator import line, to_local
from gi_core.jit import kernel
from gi_core.paths import NONE, Segments
from gi_core.reachable_area import PLAIN, Regions, inside


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
def _lines(R, p, origin, end, hit, low, high, start_side, end_side, cut_side, patch, o, d, patches, touches):
    for k in range(len(low)):
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


def lines(segments: Segments, rotation: np.ndarray, position: np.ndarray, patch: np.ndarray, radius: float) -> Lines:
    """Carry segments into an object's space; `patch` (F,) int32 is the patch of every face.

    A segment that hits something is extended by 2 radius: see counts().
    """
    s, n = segments, segments.size
    out = Lines(
        np.empty((n, 3), np.float32),
        np.empty((n, 3), np.float32),
        s.low,
        s.high,
        np.where(s.hit_side != NONE, s.high + np.float32(2 * radius), s.high),
        s.flux,
        np.empty((n, 3), np.int32),
        np.empty((n, 3, 3), np.float32),
    )
    _lines(
        rotation, position, s.origin, s.end, s.hit, s.low, s.high, s.start_side, s.end_side, s.cut_side, patch,
        out.origin, out.direction, out.patches, out.touches,
    )  # fmt: skip
    return out


@kernel
def crossed(cx, cy, cz, nx, ny, nz, ox, oy, oz, dx, dy, dz, low, high, r2, mask):
    """Set mask[j] for the discs of a slice that a line crosses from the front at t in [low, high).

    Returns how many. Everything is float32. The loop has no branch: LLVM makes it 16 discs wide.
    A line in the plane of a disc divides by zero; inf and nan fail the comparisons.
    """
    count = 0
    for j in range(len(cx)):
        slope = dx * nx[j] + dy * ny[j] + dz * nz[j]
        ax, ay, az = cx[j] - ox, cy[j] - oy, cz[j] - oz
        t = (ax * nx[j] + ay * ny[j] + az * nz[j]) / slope
        px, py, pz = t * dx - ax, t * dy - ay, t * dz - az
        yes = (slope < 0.0) & (t >= low) & (t < high) & (px * px + py * py + pz * pz <= r2)
        mask[j] = yes
        count += yes
    return count


@kernel
def _touches_own(own, e, x, y, z, r2, patches, touches):
    """Tell whether the segment meets the receiver's patch at its point e (either side) within 2r."""
    if patches[e] == NONE or patches[e] >> 1 != own >> 1:
        return False
    a, b, c = touches[e, 0] - x, touches[e, 1] - y, touches[e, 2] - z
    return a * a + b * b + c * c <= np.float32(4.0) * r2


@kernel
def counts(i, x, y, z, nx, ny, nz, o, d, stop, r2, own, rules, patches, touches):
    """Tell whether a crossing that crossed() found counts for receiver i at (x, y, z).

    Most receivers are PLAIN, one-sided with nothing in reach: all that crosses them before the end of
    the segment counts. Asking that first halves the cost of a crossing in cornell (170 to 90 ns),
    where a tenth of the receivers are not.
    """
    ax, ay, az = x - o[0], y - o[1], z - o[2]
    t = (ax * nx + ay * ny + az * nz) / (d[0] * nx + d[1] * ny + d[2] * nz)
    if rules[0][i] == PLAIN and t < stop:
        return True
    return _counts(
        i, x, y, z, nx, ny, nz, t * d[0] - ax, t * d[1] - ay, t * d[2] - az, t >= stop, r2, own, rules, patches, touches
    )


@kernel
def _counts(i, x, y, z, nx, ny, nz, px, py, pz, behind, r2, own, rules, patches, touches):
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
            if _touches_own(mine, e, x, y, z, r2, patches, touches):
                if patches[e] != mine:
                    return False
                lands = lands or e > 0
    if behind:
        e = 2 if patches[2] != NONE else 1  # what really stops this part
        if mine == NONE or patches[e] != mine or not _touches_own(mine, e, x, y, z, r2, patches, touches):
            return False
    row, near, far = rules
    if row[i] >= 0:
        return inside(px, py, pz, nx, ny, nz, (far if lands else near)[row[i]])
    return True

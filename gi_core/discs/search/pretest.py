"""Pre-intersection tests (report 2.8): a line outside a triangle around the disc cannot cross the disc.

The triangle is equilateral and touches a disc a little larger than the receiver's. Each test accepts a superset
of predicate.py's intersections: it rejects only beyond any rounding error. The disc test decides the rest. The
tests are vectorised like the disc test, which is skipped for blocks with all lines outside. No line crosses
a filler, or a disc in its own plane (slope 0).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined
from gi_core.base.vec import cross, difference, dot
from gi_core.discs.search.predicate import DISC_FIELDS, LANES, LINE_FIELDS, Discs, offset, three

BADOUEL, PLUECKER, MOELLER = range(3)
PRETESTS = {"none": None, "badouel": BADOUEL, "pluecker": PLUECKER, "moeller_trumbore": MOELLER}
MARGIN = 0.05  # of the radius, by which the triangle's inner circle is larger
# An intersection has an error of some 12 roundings of the coordinates / slope, that of the disc test 8. A line counts
# as outside only where 64 roundings are less than the margin.
_BELIEVED = np.float32(64 * 2.0**-24)
_RADII = np.float32(64.0)  # margins: the triangle's own share of those coordinates, three radii
_FIELDS = (8, 18, 9)  # of a disc, by the numbers above
_DISC, _LINE = np.uint64(DISC_FIELDS * LANES), np.uint64(LINE_FIELDS * LANES)
_L1, _L2, _L3, _L6, _L7, _L9, _L12, _L15 = (np.uint64(k * LANES) for k in (1, 2, 3, 6, 7, 9, 12, 15))


class Triangles(NamedTuple):
    """Data of one test: the triangle around each disc, in blocks as `predicate.Blocks`."""

    kind: int  # BADOUEL, PLUECKER or MOELLER
    data: np.ndarray  # (E / LANES * fields * LANES,) float32
    margin: np.float32  # [m]


def triangles(name: str, discs: Discs, rows: np.ndarray) -> Triangles | None:
    """Return the data of a test of PRETESTS for discs (n,), a multiple of LANES; a row of -1 is a filler."""
    kind = PRETESTS[name]
    if kind is None:
        return None
    centre, normal = discs.positions.astype(np.float64), discs.normals.astype(np.float64)
    inner = (1 + MARGIN) * float(discs.radius)
    across = np.eye(3)[np.abs(normal).argmin(axis=1)]
    across -= (across * normal).sum(axis=1)[:, None] * normal
    across /= np.sqrt((across * across).sum(axis=1))[:, None]
    turned = np.cross(normal, across)
    corner = [2 * inner * (math.cos(a) * across + math.sin(a) * turned) for a in 2 * math.pi / 3 * np.arange(3)]
    edge = [corner[(k + 1) % 3] - corner[k] for k in range(3)]
    if kind == BADOUEL:
        columns = _badouel_columns(normal, corner)
    elif kind == PLUECKER:
        columns = [c for k in range(3) for c in (edge[k], np.cross(centre + corner[k], edge[k]))]
    else:
        columns = [corner[0], edge[0], -edge[2]]
    fields = np.concatenate([c.T for c in columns]).astype(np.float32)[:, np.maximum(rows, 0)]
    data = fields.reshape(len(fields), -1, LANES).transpose(1, 0, 2)
    return Triangles(kind, np.ascontiguousarray(data).reshape(-1), np.float32(MARGIN * float(discs.radius)))


def _badouel_columns(normal, corner) -> list[np.ndarray]:
    """Return the rows that map a point of the plane to alpha and beta, projected along the normal's longest axis."""
    n, longest = len(normal), np.abs(normal).argmax(axis=1)
    i, j = (longest + 1) % 3, (longest + 2) % 3
    k = np.arange(n)
    u1, v1 = (corner[1] - corner[0])[k, i], (corner[1] - corner[0])[k, j]
    u2, v2 = (corner[2] - corner[0])[k, i], (corner[2] - corner[0])[k, j]
    size = u1 * v2 - u2 * v1
    alpha, beta = np.zeros((n, 3)), np.zeros((n, 3))
    alpha[k, i], alpha[k, j] = v2 / size, -u2 / size
    beta[k, i], beta[k, j] = -v1 / size, u1 / size
    return [alpha, beta, *(-(c * corner[0]).sum(axis=1)[:, None] for c in (alpha, beta))]


@inlined
def _badouel(data, j, centre, normal, origin, direction, margin):
    """Badouel 1990: the point in the plane, its coordinates in the triangle projected along an axis."""
    slope = dot(direction, normal)
    a = difference(centre, origin)
    t = dot(a, normal) / slope
    p = offset(a, t, direction)
    alpha = dot(three(data, j), p) + data[j + _L6]
    beta = dot(three(data, j + _L3), p) + data[j + _L7]
    inside = (alpha >= 0) & (beta >= 0) & (alpha + beta <= 1)
    unsure = abs(slope) * margin <= _BELIEVED * (_extent(a) + _RADII * margin)
    return (inside | unsure) & (slope != 0)


@inlined
def _extent(a):
    return abs(a[0]) + abs(a[1]) + abs(a[2])


@inlined
def _pluecker(data, j, centre, normal, origin, direction, margin):
    """Pluecker coordinates: inside, the line passes all three edges on the same side."""
    moment = cross(origin, direction)
    a = dot(direction, three(data, j + _L3)) + dot(moment, three(data, j))
    b = dot(direction, three(data, j + _L9)) + dot(moment, three(data, j + _L6))
    c = dot(direction, three(data, j + _L15)) + dot(moment, three(data, j + _L12))
    inside = ((a >= 0) & (b >= 0) & (c >= 0)) | ((a <= 0) & (b <= 0) & (c <= 0))
    slope = dot(direction, normal)
    far = _extent(centre) + abs(origin[0]) + abs(origin[1]) + abs(origin[2]) + _RADII * margin
    return (inside | (abs(slope) * margin <= _BELIEVED * far)) & (slope != 0)


@inlined
def _moeller(data, j, centre, normal, origin, direction, margin):
    """Moeller and Trumbore 1997: coordinates in the triangle without its plane."""
    e1, e2 = three(data, j + _L3), three(data, j + _L6)
    a = difference(centre, origin)
    t = -a[0] - data[j], -a[1] - data[j + _L1], -a[2] - data[j + _L2]
    p, q = cross(direction, e2), cross(t, e1)
    det = dot(e1, p)
    u, v = dot(t, p) / det, dot(direction, q) / det
    inside = (u >= 0) & (v >= 0) & (u + v <= 1)
    slope = dot(direction, normal)
    unsure = abs(slope) * margin <= _BELIEVED * (_extent(a) + _RADII * margin)
    return (inside | unsure) & (slope != 0)


@inlined
def discs_left(pretest, data, block, origin, direction):
    """Return the discs of a block that a line may cross, one bit per lane."""
    kind, more, margin = pretest
    base, bits = np.uint64(block) * _DISC, np.uint32(0)
    if kind == BADOUEL:
        at = np.uint64(block) * np.uint64(_FIELDS[BADOUEL] * LANES)
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _badouel(more, at + lane, three(data, j), three(data, j + _L3), origin, direction, margin)
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    elif kind == PLUECKER:
        at = np.uint64(block) * np.uint64(_FIELDS[PLUECKER] * LANES)
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _pluecker(more, at + lane, three(data, j), three(data, j + _L3), origin, direction, margin)
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    else:
        at = np.uint64(block) * np.uint64(_FIELDS[MOELLER] * LANES)
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _moeller(more, at + lane, three(data, j), three(data, j + _L3), origin, direction, margin)
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits


@inlined
def lines_left(pretest, lists, block, e, centre, normal):
    """Return the lines of a block that may cross the disc of entry e, one bit per lane."""
    kind, more, margin = pretest
    base, bits = np.uint64(block) * _LINE, np.uint32(0)
    own, lane_of_disc = np.uint64(e // LANES), np.uint64(e % LANES)
    if kind == BADOUEL:
        at = own * np.uint64(_FIELDS[BADOUEL] * LANES) + lane_of_disc
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _badouel(more, at, centre, normal, three(lists, j), three(lists, j + _L3), margin)
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    elif kind == PLUECKER:
        at = own * np.uint64(_FIELDS[PLUECKER] * LANES) + lane_of_disc
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _pluecker(more, at, centre, normal, three(lists, j), three(lists, j + _L3), margin)
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    else:
        at = own * np.uint64(_FIELDS[MOELLER] * LANES) + lane_of_disc
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _moeller(more, at, centre, normal, three(lists, j), three(lists, j + _L3), margin)
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits

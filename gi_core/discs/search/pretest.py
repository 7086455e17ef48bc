"""Pre-intersection tests (report 2.8): is the line outside a triangle around the disc? Then it need not be tried.

The triangle is equilateral and touches a disc a little larger than the receiver's. Each test is a superset of
predicate.py's: it says "outside" only where rounding cannot have decided. What is left is tried as ever.
Written like the disc test, for vectors; a block whose lines are all outside is spared that test. Nothing
crosses a disc in whose plane it lies (slope 0), or a filler.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined
from gi_core.discs.search.predicate import DISC_FIELDS, LANES, LINE_FIELDS, Discs

BADOUEL, PLUECKER, MOELLER = 0, 1, 2
PRETESTS = {"none": None, "badouel": BADOUEL, "pluecker": PLUECKER, "moeller_trumbore": MOELLER}
MARGIN = 0.05  # of the radius, that the triangle's inner circle is larger
# An intersection is off by some 12 roundings of the coordinates / slope, and the disc test's by 8: "outside" is
# believed where 64 of them are less than the margin.
_BELIEVED = np.float32(64 * 2.0**-24)
_RADII = np.float32(64.0)  # margins: what the triangle itself adds to those coordinates, three radii
_FIELDS = (8, 18, 9)  # of a disc, by the numbers above
_DISC, _LINE = np.uint64(DISC_FIELDS * LANES), np.uint64(LINE_FIELDS * LANES)
_L1, _L2, _L3, _L4, _L5, _L6, _L7, _L8, _L9, _L10, _L11, _L12, _L13, _L14, _L15, _L16, _L17 = (
    np.uint64(k * LANES) for k in range(1, 18)
)


class Triangles(NamedTuple):
    """What one of the tests keeps of the triangle around each disc, in blocks as `crossing.Blocks`."""

    kind: int  # BADOUEL, PLUECKER or MOELLER
    data: np.ndarray  # (E / LANES * fields * LANES,) float32
    margin: np.float32  # [m]


def triangles(name: str, discs: Discs, rows: np.ndarray) -> Triangles | None:
    """Return what a test of PRETESTS needs of discs (n,), a multiple of LANES; a row of -1 is a filler."""
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
    """Return the rows that give a point of the plane its alpha and beta, looking along the normal's longest axis."""
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
def _badouel(data, j, x, y, z, nx, ny, nz, ox, oy, oz, dx, dy, dz, margin):
    """Badouel 1990: the point in the plane, its coordinates in the triangle projected along an axis."""
    slope = dx * nx + dy * ny + dz * nz
    ax, ay, az = x - ox, y - oy, z - oz
    t = (ax * nx + ay * ny + az * nz) / slope
    px, py, pz = t * dx - ax, t * dy - ay, t * dz - az
    alpha = data[j] * px + data[j + _L1] * py + data[j + _L2] * pz + data[j + _L6]
    beta = data[j + _L3] * px + data[j + _L4] * py + data[j + _L5] * pz + data[j + _L7]
    inside = (alpha >= 0) & (beta >= 0) & (alpha + beta <= 1)
    unsure = abs(slope) * margin <= _BELIEVED * (abs(ax) + abs(ay) + abs(az) + _RADII * margin)
    return (inside | unsure) & (slope != 0)


@inlined
def _pluecker(data, j, x, y, z, nx, ny, nz, ox, oy, oz, dx, dy, dz, margin):
    """Pluecker coordinates: on which side of each edge's line the line passes; inside, on the same of all three."""
    mx, my, mz = oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx
    a = dx * data[j + _L3] + dy * data[j + _L4] + dz * data[j + _L5]
    a += mx * data[j] + my * data[j + _L1] + mz * data[j + _L2]
    b = dx * data[j + _L9] + dy * data[j + _L10] + dz * data[j + _L11]
    b += mx * data[j + _L6] + my * data[j + _L7] + mz * data[j + _L8]
    c = dx * data[j + _L15] + dy * data[j + _L16] + dz * data[j + _L17]
    c += mx * data[j + _L12] + my * data[j + _L13] + mz * data[j + _L14]
    inside = ((a >= 0) & (b >= 0) & (c >= 0)) | ((a <= 0) & (b <= 0) & (c <= 0))
    slope = dx * nx + dy * ny + dz * nz
    far = abs(x) + abs(y) + abs(z) + abs(ox) + abs(oy) + abs(oz) + _RADII * margin
    return (inside | (abs(slope) * margin <= _BELIEVED * far)) & (slope != 0)


@inlined
def _moeller(data, j, x, y, z, nx, ny, nz, ox, oy, oz, dx, dy, dz, margin):
    """Moeller and Trumbore 1997: coordinates in the triangle without its plane."""
    e1x, e1y, e1z = data[j + _L3], data[j + _L4], data[j + _L5]
    e2x, e2y, e2z = data[j + _L6], data[j + _L7], data[j + _L8]
    ax, ay, az = x - ox, y - oy, z - oz
    tx, ty, tz = -ax - data[j], -ay - data[j + _L1], -az - data[j + _L2]
    px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    det = e1x * px + e1y * py + e1z * pz
    u = (tx * px + ty * py + tz * pz) / det
    qx, qy, qz = ty * e1z - tz * e1y, tz * e1x - tx * e1z, tx * e1y - ty * e1x
    v = (dx * qx + dy * qy + dz * qz) / det
    inside = (u >= 0) & (v >= 0) & (u + v <= 1)
    slope = dx * nx + dy * ny + dz * nz
    unsure = abs(slope) * margin <= _BELIEVED * (abs(ax) + abs(ay) + abs(az) + _RADII * margin)
    return (inside | unsure) & (slope != 0)


@inlined
def discs_left(pretest, data, block, ox, oy, oz, dx, dy, dz):
    """Return which discs of a block may be crossed by a line: a bit a lane."""
    kind, more, margin = pretest
    base, bits = np.uint64(block) * _DISC, np.uint32(0)
    if kind == BADOUEL:
        at = np.uint64(block) * np.uint64(_FIELDS[BADOUEL] * LANES)
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _badouel(
                more, at + lane, data[j], data[j + _L1], data[j + _L2], data[j + _L3], data[j + _L4], data[j + _L5],
                ox, oy, oz, dx, dy, dz, margin,
            )  # fmt: skip
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    elif kind == PLUECKER:
        at = np.uint64(block) * np.uint64(_FIELDS[PLUECKER] * LANES)
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _pluecker(
                more, at + lane, data[j], data[j + _L1], data[j + _L2], data[j + _L3], data[j + _L4], data[j + _L5],
                ox, oy, oz, dx, dy, dz, margin,
            )  # fmt: skip
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    else:
        at = np.uint64(block) * np.uint64(_FIELDS[MOELLER] * LANES)
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _moeller(
                more, at + lane, data[j], data[j + _L1], data[j + _L2], data[j + _L3], data[j + _L4], data[j + _L5],
                ox, oy, oz, dx, dy, dz, margin,
            )  # fmt: skip
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits


@inlined
def lines_left(pretest, lists, block, e, x, y, z, nx, ny, nz):
    """Return which lines of a block may cross the disc of entry e: a bit a lane."""
    kind, more, margin = pretest
    base, bits = np.uint64(block) * _LINE, np.uint32(0)
    own, lane_of_disc = np.uint64(e // LANES), np.uint64(e % LANES)
    if kind == BADOUEL:
        at = own * np.uint64(_FIELDS[BADOUEL] * LANES) + lane_of_disc
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _badouel(
                more, at, x, y, z, nx, ny, nz, lists[j], lists[j + _L1], lists[j + _L2], lists[j + _L3],
                lists[j + _L4], lists[j + _L5], margin,
            )  # fmt: skip
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    elif kind == PLUECKER:
        at = own * np.uint64(_FIELDS[PLUECKER] * LANES) + lane_of_disc
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _pluecker(
                more, at, x, y, z, nx, ny, nz, lists[j], lists[j + _L1], lists[j + _L2], lists[j + _L3],
                lists[j + _L4], lists[j + _L5], margin,
            )  # fmt: skip
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    else:
        at = own * np.uint64(_FIELDS[MOELLER] * LANES) + lane_of_disc
        for lane in range(np.uint64(LANES)):
            j = base + lane
            yes = _moeller(
                more, at, x, y, z, nx, ny, nz, lists[j], lists[j + _L1], lists[j + _L2], lists[j + _L3],
                lists[j + _L4], lists[j + _L5], margin,
            )  # fmt: skip
            bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits

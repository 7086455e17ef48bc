"""What few bounces bring to a receiver, averaged over those beside it, as far as these see the same.

Receivers beside each other follow different bounces (kinds of them, `shared_paths`), and each then has the mean of all,
as if it had followed several times as many (interleaved sampling: Keller & Heidrich 2001, Wald et al. 2002). How much
a neighbour counts is told by Ward's estimate (1988) of how different its light may be, from its distance in units of
that to the surfaces which the bounces meet, and from how its normal is turned, against what chance leaves of so many
bounces. So where a chair's leg meets the floor each counts for itself; and with many bounces everywhere: the limit
has no bias. Light straight from lamps is not to be averaged: it has edges.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.base.threads import run_ranges
from gi_core.geometry.mesh_neighbours import neighbours

KINDS = 4  # of 8 bounces 2 leave a sixth to a quarter more error, 8 a tenth
NEAR = 16  # receivers in a mean at most; 10 leave a twentieth more error, 20 a twentieth less
LOOKED_AT = 4 * NEAR  # along the mesh, of which those are the nearest
SAME_WAY = 0.9  # cosine between their normals, at least
CHANCE = 4.0  # times Ward's square and the bounces is 1: such a neighbour counts half; 2 to 8 are as good
GRAIN = 4096  # receivers a thread


class Beside(NamedTuple):
    """Receivers beside each receiver i, itself among them: of[first[i] : first[i + 1]]."""

    first: np.ndarray  # (n + 1,) int64
    of: np.ndarray  # (k,) int32
    apart: np.ndarray  # (k,) float64, distance squared [m2]
    turned: np.ndarray  # (k,) float64, 1 - cosine between the normals


def beside(positions: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> Beside:
    """Find the nearest to each receiver (n, 3) along the mesh; corners (m, 3) are those of faces, fronts and backs.

    Receivers of both sides of a crease are joined by no face, nor are those of the two sides of a sheet.
    """
    n = len(positions)
    room, count = np.empty((n, NEAR), np.int32), np.empty(n, np.int64)
    apart, turned = np.empty((2, n, NEAR))
    _find(*neighbours(corners, n), positions, normals, room, apart, turned, count)
    taken = np.arange(NEAR) < count[:, None]
    return Beside(np.concatenate([[0], np.cumsum(count)]), room[taken], apart[taken], turned[taken])


@allocating
def _find(first, of, positions, normals, room, apart, turned, count):
    n = len(positions)
    seen, found, distance = np.full(n, -1, np.int64), np.empty(LOOKED_AT, np.int64), np.empty(LOOKED_AT)
    for i in range(n):
        seen[i], found[0], distance[0], ends, at = i, i, 0.0, 1, 0
        while at < ends and ends < LOOKED_AT:
            near = found[at]
            at += 1
            for k in range(first[near], first[near + 1]):
                j = of[k]
                if seen[j] == i or ends == LOOKED_AT:
                    continue
                seen[j] = i
                if _cosine(normals, i, j) > SAME_WAY:
                    found[ends] = j
                    distance[ends] = _apart(positions, i, j)
                    ends += 1
        count[i] = min(ends, NEAR)
        for k in range(count[i]):
            least = k
            for other in range(k + 1, ends):
                if distance[other] < distance[least]:
                    least = other
            found[k], found[least] = found[least], found[k]
            distance[k], distance[least] = distance[least], distance[k]
            room[i, k], apart[i, k] = found[k], distance[k]
            turned[i, k] = max(0.0, 1.0 - _cosine(normals, i, found[k])) if found[k] != i else 0.0


@kernel
def _cosine(normals, i, j):
    return normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]


@kernel
def _apart(positions, i, j):
    x, y, z = (
        positions[i, 0] - positions[j, 0],
        positions[i, 1] - positions[j, 1],
        positions[i, 2] - positions[j, 2],
    )
    return x * x + y * y + z * z


def kinds(near: Beside) -> np.ndarray:
    """Return for each receiver which of KINDS bounces it follows, (n,) int64: those least found near it already."""
    out = np.full(len(near.first) - 1, -1, np.int64)
    _choose(near.first, near.of, near.apart, out)
    return out


@allocating
def _choose(first, of, apart, out):
    for i in range(len(out)):
        crowd = np.zeros(KINDS)
        for k in range(first[i], first[i + 1]):
            if out[of[k]] >= 0:
                crowd[out[of[k]]] += 1.0 / max(apart[k], 1e-30)
        out[i] = np.argmin(crowd)


@kernel
def closeness(bounces, distance, out):
    """Write 1 / the geometric mean of the distances to what each receiver's bounces meet [1/m].

    Ward takes the harmonic mean: of few bounces a single one that meets something close then decides, and hollows are
    left with their grain (error of bounces, 8 of them: living_room 5.0 for 4.6 %, cornell 2.9 for 2.6).
    """
    for row in range(len(out)):
        total = 0.0
        for k in range(row * bounces, (row + 1) * bounces):
            total += math.log(max(distance[k], 1e-30))
        out[row] = math.exp(-total / bounces)


def neighbour_mean(near: Beside, close: np.ndarray, bounces: int, light: np.ndarray, threads: int) -> np.ndarray:
    """Return means (n, 3) of light (n, 3) that so many bounces have brought; close (n,): closeness()."""
    out = np.empty_like(light)
    run_ranges(lambda _, a, b: _mean(*near, close, CHANCE * bounces, light, a, b, out), len(light), threads, GRAIN)
    return out


@kernel
def _mean(first, of, apart, turned, close, chance, light, start, stop, out):
    for i in range(start, stop):
        total = x = y = z = 0.0
        for k in range(first[i], first[i + 1]):
            j = of[k]
            c = max(close[i], close[j])
            w = 1.0 / (1.0 + chance * (apart[k] * c * c + turned[k]))
            total += w
            x, y, z = x + w * light[j, 0], y + w * light[j, 1], z + w * light[j, 2]
        out[i, 0], out[i, 1], out[i, 2] = x / total, y / total, z / total

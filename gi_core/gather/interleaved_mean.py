"""Interleaved sampling: bounced light of few paths, averaged over neighbouring receivers.

Neighbouring receivers trace different kinds of bounces (`shared_samples.py`), and each takes the weighted mean of all
kinds (Keller & Heidrich 2001, Wald et al. 2002). A neighbour's weight follows Ward's irradiance-cache error (1988):
distance over mean hit distance, plus the angle between normals. It is compared with the noise of that many bounces.
Near contacts each receiver therefore counts alone, and with many bounces everywhere: the limit is unbiased. Direct
light has edges and must not be averaged. Large receivers trace more bounces, as their noise is most of the error.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.base.threads import run_ranges
from gi_core.base.vec import difference, dot
from gi_core.geometry.mesh_neighbours import neighbours

KINDS = 4  # at 8 bounces, 2 kinds leave a sixth to a quarter more error, 8 kinds a tenth
NEAR = 16  # receivers per mean at most; 10 leave a twentieth more error, 20 a twentieth less
LOOKED_AT = 4 * NEAR  # receivers along the mesh, of which NEAR are taken
SAME_WAY = 0.9  # least cosine between normals
CHANCE = 4.0  # a neighbour has weight 1/2 where CHANCE x Ward's squared error x bounces = 1; 2 to 8 are as good
GRAIN = 512  # receivers per thread
LEAST, MOST, LEVELS = 0.5, 4.0, 4  # bounces of a receiver over the mean, and levels of these per doubling
HALVINGS = 40  # in the search for that mean


class NearReceivers(NamedTuple):
    """Receivers near each receiver i, including itself: of[first[i] : first[i + 1]]."""

    first: np.ndarray  # (n + 1,) int64
    of: np.ndarray  # (k,) int32
    apart: np.ndarray  # (k,) float64 [m2], squared distance
    turned: np.ndarray  # (k,) float64, 1 - cosine between the normals


def near_receivers(positions: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> NearReceivers:
    """Return the nearest receivers along the mesh; corners (m, 3): receivers of faces, fronts and backs.

    positions [m] and normals (n, 3). No face joins receivers across a crease or on the two sides of a sheet.
    """
    n = len(positions)
    room, count = np.empty((n, NEAR), np.int32), np.empty(n, np.int64)
    apart, turned = np.empty((2, n, NEAR))
    _find(*neighbours(corners, n), positions, normals, room, apart, turned, count)
    taken = np.arange(NEAR) < count[:, None]
    return NearReceivers(np.concatenate([[0], np.cumsum(count)]), room[taken], apart[taken], turned[taken])


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
                if dot(normals[i], normals[j]) > SAME_WAY:
                    found[ends] = j
                    off = difference(positions[i], positions[j])
                    distance[ends] = dot(off, off)
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
            turned[i, k] = max(0.0, 1.0 - dot(normals[i], normals[found[k]])) if found[k] != i else 0.0


def bounce_shares(areas: np.ndarray) -> np.ndarray:
    """Return the bounces (n,) of the receivers of a mobile over their mean, by areas (n,) [m2].

    They are in proportion to areas^(2/3), rounded to LEVELS per doubling, from LEAST to MOST, of a mean just below 1.
    Such shares make the error over the whole area least where each bounce has the same variance.
    """
    wanted = np.log2(np.maximum(areas / max(areas.mean(), 1e-300), 1e-30)) / 1.5
    low, high = -100.0, 100.0  # of the number that is added to all exponents
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _rounded(wanted + middle).mean() <= 1.0 else (low, middle)
    return _rounded(wanted + low)


def _rounded(exponents: np.ndarray) -> np.ndarray:
    return np.exp2(np.clip(np.rint(LEVELS * exponents) / LEVELS, math.log2(LEAST), math.log2(MOST)))


def kinds(near: NearReceivers) -> np.ndarray:
    """Return the kind of bounces (n,) int64 of each receiver: the one that is rarest among its neighbours so far."""
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
def closeness(first, distance, out):
    """Write 1 / the geometric mean of the hit distances of each receiver's bounces, first[i] to first[i + 1] [1/m].

    Ward takes the harmonic mean. With few bounces a single near hit then dominates, and hollows stay noisy: with 8
    bounces the error of bounced light is 5.0 % instead of 4.6 % in living_room, 2.9 % instead of 2.6 % in cornell.
    """
    for row in range(len(out)):
        total = 0.0
        for k in range(first[row], first[row + 1]):
            total += math.log(max(distance[k], 1e-30))
        out[row] = math.exp(-total / (first[row + 1] - first[row]))


def average_neighbours(
    near: NearReceivers, close: np.ndarray, bounces: np.ndarray, light: np.ndarray, threads: int
) -> np.ndarray:
    """Return means (n, 3) of light (n, 3) from bounces (n,) int64 of receivers; close (n,): closeness()."""
    out = np.empty_like(light)
    run_ranges(lambda _, a, b: _mean(*near, close, bounces, light, a, b, out), len(light), threads, GRAIN)
    return out


@kernel
def _mean(first, of, apart, turned, close, bounces, light, start, stop, out):
    for i in range(start, stop):
        total = x = y = z = 0.0
        for k in range(first[i], first[i + 1]):
            j = of[k]
            c = max(close[i], close[j])
            w = bounces[j] / (1.0 + CHANCE * bounces[j] * (apart[k] * c * c + turned[k]))
            total += w
            x, y, z = x + w * light[j, 0], y + w * light[j, 1], z + w * light[j, 2]
        out[i, 0], out[i, 1], out[i, 2] = x / total, y / total, z / total

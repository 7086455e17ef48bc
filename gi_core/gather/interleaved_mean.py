"""Interleaved sampling: bounced light of few paths, averaged over neighbouring receivers.

Neighbouring receivers trace different kinds of bounces, whose directions many receivers share. Each takes the weighted
mean of all kinds (Keller & Heidrich 2001, Wald et al. 2002). A neighbour's weight follows Ward's irradiance-cache error
(1988): distance over mean hit distance, plus the angle between normals. It is compared with the noise of that many
bounces. Near contacts each receiver therefore counts alone, and with many bounces everywhere: the limit is unbiased.
Direct light has edges and must not be averaged. Large receivers trace more bounces: their noise is most of the error.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import allocating, kernel
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.base.vec import difference, dot, weighted
from gi_core.bsdf import lambertian
from gi_core.gather.path_tracer import SCATTER_U, SCATTER_V
from gi_core.geometry.mesh_neighbours import SAME_WAY, neighbours

KINDS = 4  # at 8 bounces, 2 kinds leave a sixth to a quarter more error, 8 kinds a tenth
AVERAGED = 16  # receivers per mean at most; 10 leave a twentieth more error, 20 a twentieth less
LOOKED_AT = 4 * AVERAGED  # receivers along the mesh, of which AVERAGED are taken
CHANCE = 4.0  # a neighbour has weight 1/2 where CHANCE x Ward's squared error x bounces = 1; 2 to 8 are as good
LEAST_BOUNCES, MOST_BOUNCES = 0.5, 4.0  # of a receiver, over the mean
LEVELS = 4  # of these per doubling
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # of a full turn, between successive directions


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
    room, count = np.empty((n, AVERAGED), np.int32), np.empty(n, np.int64)
    apart, turned = np.empty((2, n, AVERAGED))
    _find(*neighbours(corners, n), positions, normals, room, apart, turned, count)
    taken = np.arange(AVERAGED) < count[:, None]
    return NearReceivers(np.concatenate([[0], np.cumsum(count)]), room[taken], apart[taken], turned[taken])


@allocating
def _find(first, of, positions, normals, room, apart, turned, count):
    n = len(positions)
    seen, queue, distance = np.full(n, -1, np.int64), np.empty(LOOKED_AT, np.int64), np.empty(LOOKED_AT)
    for i in range(n):
        seen[i], queue[0], distance[0], ends, at = i, i, 0.0, 1, 0
        while at < ends and ends < LOOKED_AT:
            near = queue[at]
            at += 1
            for k in range(first[near], first[near + 1]):
                j = of[k]
                if seen[j] == i or ends == LOOKED_AT:
                    continue
                seen[j] = i
                if dot(normals[i], normals[j]) > SAME_WAY:
                    queue[ends] = j
                    off = difference(positions[i], positions[j])
                    distance[ends] = dot(off, off)
                    ends += 1
        count[i] = min(ends, AVERAGED)
        for k in range(count[i]):
            least = k
            for other in range(k + 1, ends):
                if distance[other] < distance[least]:
                    least = other
            queue[k], queue[least] = queue[least], queue[k]
            distance[k], distance[least] = distance[least], distance[k]
            room[i, k], apart[i, k] = queue[k], distance[k]
            turned[i, k] = max(0.0, 1.0 - dot(normals[i], normals[queue[k]])) if queue[k] != i else 0.0


def bounce_shares(areas: np.ndarray) -> np.ndarray:
    """Return the bounces (n,) of the receivers of a mobile over their mean, by areas (n,) [m2].

    They are in proportion to areas^(2/3), rounded to LEVELS per doubling, from LEAST_BOUNCES to MOST_BOUNCES, of a
    mean just below 1. Such shares make the error over the whole area least where each bounce has the same variance.
    """
    wanted = np.log2(np.maximum(areas / max(areas.mean(), 1e-300), 1e-30)) / 1.5
    low, high = -100.0, 100.0  # of the number that is added to all exponents
    for _ in range(40):  # 40 halvings in the search for that mean
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _rounded(wanted + middle).mean() <= 1.0 else (low, middle)
    return _rounded(wanted + low)


def _rounded(exponents: np.ndarray) -> np.ndarray:
    return np.exp2(np.clip(np.rint(LEVELS * exponents) / LEVELS, math.log2(LEAST_BOUNCES), math.log2(MOST_BOUNCES)))


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
    # 512 receivers per thread
    run_ranges(lambda _, a, b: _mean(*near, close, bounces, light, a, b, out), len(light), threads, COSTLY)
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


def shared_directions(seed: int, count: int, kinds: int) -> np.ndarray:
    """Return unit directions (kinds, count, 3) float64, cosine-distributed about the third axis.

    Each kind is stratified over the hemisphere, and so are all kinds together.
    """
    out = np.empty((kinds, count, 3))
    _draw(seed, out)
    return out


@kernel
def _draw(seed, out):
    kinds, n = out.shape[:2]
    # A Fibonacci spiral with random rotation and shift stratifies few directions best (Marques et al. 2013). Each kind
    # is such a spiral, rotated so that the union is stratified too. Every fourth direction of one spiral would not be:
    # four golden steps are nearly half a turn.
    shift, turn = random_numbers.independent(seed, 0, 0, SCATTER_U), random_numbers.independent(seed, 0, 0, SCATTER_V)
    for j in range(n):
        for c in range(kinds):
            u, v = (kinds * j + c + shift) / (kinds * n), ((j + c / kinds) * GOLDEN + turn) % 1.0
            out[c, j, 0], out[c, j, 1], out[c, j, 2] = lambertian.sample(u, v)


@kernel
def bounces(directions, kinds, normals, first, out):
    """Write the bounces of the receivers that have P of them: those of its kind (kinds, P, 3), rotated to its normal.

    out (k, 3): those of receiver i are first[i] to first[i + 1].
    """
    for row in range(len(normals)):
        k = first[row]
        if first[row + 1] - k != directions.shape[1]:
            continue
        ax, ay, az, bx, by, bz = random_numbers.basis(normals[row, 0], normals[row, 1], normals[row, 2])
        for d in directions[kinds[row]]:
            out[k, 0], out[k, 1], out[k, 2] = weighted(d, (ax, ay, az), (bx, by, bz), normals[row])
            k += 1

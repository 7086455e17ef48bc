"""Bounce directions that many receivers share (common random numbers)."""

from __future__ import annotations

import math

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.vec import weighted
from gi_core.bsdf import lambertian
from gi_core.gather.path_tracer import SCATTER_U, SCATTER_V

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # of a full turn, between successive directions


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

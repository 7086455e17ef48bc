"""A fixed hierarchy of directions: the hemisphere as a square of equal-area cells (Shirley and Chiu 1997).

Four neighbouring cells have one parent, as in the QuadTree of report 2.10.1; the root is the hemisphere. A cell sums
its rays, `add_ray()`: light of three channels, weight times direction, and weight. A ray weighs its light / sqrt(cos),
between irradiance and radiance.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.random_numbers import basis
from gi_core.base.vec import dot

SIDE = 8  # cells along a side of the square: three divisions
CELLS = SIDE * SIDE
SUMS = 7  # of a cell: light red, green, blue; weight times direction x, y, z in the object's space; weight
GRAZING = 0.05  # least cosine of a direction
POINTS_PER_SIDE = 8  # points along a side of a cell, for its means
T0, T1, T2, T3, T4, T5, T6 = np.float32(  # of _turn()
    (1.2732346, -0.4242099, 0.2522009, -0.16849202, 0.10137978, -0.042786028, 0.0086729813)
)


@inlined
def cell_of(x, y, z):
    """Return the cell, row-major in the square, of a unit direction in the frame of a normal; z < 0 counts as 0.

    float32 and without a branch, so that LLVM vectorises loops over directions.
    """
    x, y, z = np.float32(x), np.float32(y), np.float32(z)
    # Equal-area disc of the hemisphere, then the concentric map from disc to square.
    wide = abs(x) >= abs(y)
    major, minor = (x, y) if wide else (y, x)
    t = minor / major if major != np.float32(0.0) else np.float32(0.0)
    r = math.copysign(math.sqrt(np.float32(1.0) - min(max(z, np.float32(0.0)), np.float32(1.0))), major)
    across = r * _turn(t)
    a, b = (r, across) if wide else (across, r)
    i = min(np.int32(np.float32(0.5 * SIDE) * (a + np.float32(1.0))), np.int32(SIDE - 1))
    j = min(np.int32(np.float32(0.5 * SIDE) * (b + np.float32(1.0))), np.int32(SIDE - 1))
    return np.int32(SIDE) * i + j


@inlined
def axes_of(n):
    """Return the axes of the frame of a normal: tangent, bitangent, normal."""
    ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
    return (ax, ay, az), (bx, by, bz), (n[0], n[1], n[2])


@inlined
def cell_towards(axes, d):
    """Return the cell of a unit direction in the space of the axes, and its cosine."""
    cosine = dot(d, axes[2])
    return cell_of(dot(d, axes[0]), dot(d, axes[1]), cosine), cosine


@inlined
def weight_of(light, cosine, least):
    """Return the weight of a ray of light, summed over channels; least: GRAZING in the type of the cosine."""
    return light / math.sqrt(max(cosine, least))


@inlined
def add_ray(cell, light, moment, weight):
    """Add a ray to the sums (SUMS,) of its cell: light of three channels, weight times direction, and weight."""
    cell[0] += light[0]
    cell[1] += light[1]
    cell[2] += light[2]
    cell[3] += moment[0]
    cell[4] += moment[1]
    cell[5] += moment[2]
    cell[6] += weight


@inlined
def _turn(t):
    """Return 4 / pi atan(t), -1 <= t <= 1, to 4e-7: a minimax polynomial."""
    s = t * t
    return t * (T0 + s * (T1 + s * (T2 + s * (T3 + s * (T4 + s * (T5 + s * T6))))))


@kernel
def direction_of(a, b):
    """Return the unit direction (x, y, z) of a point of the square [-1, 1]^2 in the frame of a normal."""
    r, x, y = 0.0, 0.0, 0.0
    if abs(a) >= abs(b):
        r = a
        turn = 0.25 * math.pi * b / a if a != 0.0 else 0.0
        x, y = r * math.cos(turn), r * math.sin(turn)
    else:
        r = b
        turn = 0.25 * math.pi * a / b
        x, y = r * math.sin(turn), r * math.cos(turn)
    flat = math.sqrt(max(0.0, 2.0 - r * r))
    return flat * x, flat * y, 1.0 - r * r


def even_light() -> np.ndarray:
    """Return the cells (CELLS, 6) float64 of a `GlossLight` under equal radiance from everywhere, normal z."""
    fine = (2 * (np.arange(SIDE * POINTS_PER_SIDE) + 0.5) / (SIDE * POINTS_PER_SIDE) - 1).reshape(SIDE, POINTS_PER_SIDE)
    points = np.stack(np.broadcast_arrays(fine[:, None, :, None], fine[None, :, None, :]), axis=-1)
    rays = directions(points.reshape(-1, 2)).reshape(CELLS, POINTS_PER_SIDE * POINTS_PER_SIDE, 3)
    cosine, weight = rays[:, :, 2], np.sqrt(rays[:, :, 2:])
    share = cosine.sum(axis=1) / cosine.sum()
    return np.c_[share, share, share, (weight * rays).sum(axis=1) / weight.sum(axis=1)]


def directions(square: np.ndarray) -> np.ndarray:
    """Return the unit directions (n, 3) of points (n, 2) of the square [-1, 1]^2."""
    out = np.empty((len(square), 3))
    _fill(square, out)
    return out


@kernel
def _fill(square, out):
    for k in range(len(square)):
        out[k, 0], out[k, 1], out[k, 2] = direction_of(square[k, 0], square[k, 1])


def disc_of(towards: np.ndarray) -> np.ndarray:
    """Return the places (n, 2) on the unit disc of unit directions (n, 3); equal solid angles have equal areas."""
    z = np.clip(towards[:, 2], 0, 1)
    across = np.sqrt(np.maximum((towards[:, :2] ** 2).sum(axis=1), 1e-18))
    return towards[:, :2] * (np.sqrt(1 - z) / across)[:, None]

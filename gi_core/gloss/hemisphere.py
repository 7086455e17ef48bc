"""A fixed hierarchy of directions: the hemisphere as a square of equal-area cells (Shirley and Chiu 1997).

Four neighbouring cells have one parent, as in the QuadTree of report 2.10.1; the root is the hemisphere.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import kernel

SIDE = 8  # cells along a side of the square: three divisions
CELLS = SIDE * SIDE
FINE = 8  # points along a side of a cell, for its means


@kernel
def cell_of(x, y, z):
    """Return the cell, row-major in the square, of a unit direction in the frame of a normal; z < 0 counts as 0."""
    # Equal-area disc of the hemisphere, then the concentric map from disc to square.
    r = math.sqrt(max(0.0, 1.0 - max(z, 0.0)))
    size = math.sqrt(x * x + y * y)
    if size > 0.0:
        x, y = x / size * r, y / size * r
    a, b = 0.0, 0.0
    if abs(x) >= abs(y):
        if x != 0.0:
            a = math.copysign(r, x)
            b = a * (4.0 / math.pi) * math.atan(y / x)
    else:
        b = math.copysign(r, y)
        a = b * (4.0 / math.pi) * math.atan(x / y)
    i = min(max(int(0.5 * (a + 1.0) * SIDE), 0), SIDE - 1)
    j = min(max(int(0.5 * (b + 1.0) * SIDE), 0), SIDE - 1)
    return SIDE * i + j


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


def centres() -> np.ndarray:
    """Return the directions (CELLS, 3) float64 of the middles of the cells."""
    a, b = ((2 * (m.reshape(-1) + 0.5) / SIDE - 1) for m in np.meshgrid(*[np.arange(SIDE)] * 2, indexing="ij"))
    return directions(np.stack([a, b], axis=1))


def even_light() -> np.ndarray:
    """Return the cells (CELLS, 6) float64 of a `GlossLight` under equal radiance from everywhere, normal z."""
    fine = (2 * (np.arange(SIDE * FINE) + 0.5) / (SIDE * FINE) - 1).reshape(SIDE, FINE)
    points = np.stack(np.broadcast_arrays(fine[:, None, :, None], fine[None, :, None, :]), axis=-1)
    rays = directions(points.reshape(-1, 2)).reshape(CELLS, FINE * FINE, 3)
    cosine, weight = rays[:, :, 2], np.sqrt(rays[:, :, 2:])
    share = cosine.sum(axis=1) / cosine.sum()
    return np.c_[share, share, share, (weight * rays).sum(axis=1) / weight.sum(axis=1)]


def on_disc(square: np.ndarray) -> np.ndarray:
    """Return the places (n, 2) on the unit disc of points (n, 2) of the square [-1, 1]^2: the concentric map."""
    a, b = square.T
    wide = np.abs(a) >= np.abs(b)
    r = np.where(wide, a, b)
    turn = np.pi / 4 * np.where(wide, b / np.where(a == 0, 1, a), a / np.where(b == 0, 1, b))
    x, y = np.where(wide, r * np.cos(turn), r * np.sin(turn)), np.where(wide, r * np.sin(turn), r * np.cos(turn))
    return np.stack([x, y], axis=1)


def directions(square: np.ndarray) -> np.ndarray:
    """Return the unit directions (n, 3) of points (n, 2) of the square [-1, 1]^2."""
    disc = on_disc(square)
    r2 = (disc * disc).sum(axis=1)
    return np.concatenate([disc * np.sqrt(np.maximum(2 - r2, 0))[:, None], 1 - r2[:, None]], axis=1)


def disc_of(towards: np.ndarray) -> np.ndarray:
    """Return the places (n, 2) on the unit disc of unit directions (n, 3); equal solid angles have equal areas."""
    z = np.clip(towards[:, 2], 0, 1)
    across = np.sqrt(np.maximum((towards[:, :2] ** 2).sum(axis=1), 1e-18))
    return towards[:, :2] * (np.sqrt(1 - z) / across)[:, None]

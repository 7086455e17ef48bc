"""The angle that the surface round a receiver covers in its tangent plane (report 2.9.1, fig. 2.10).

2 pi where faces surround the receiver, pi in the middle of a border, pi / 2 in the corner of a wall. Photons hit the
surface alone, so round a border they hit angle / 2 pi of a disc.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces

LEAST_SHARE = 0.01  # of a full turn: the tips of slivers would divide by next to nothing


def border_receivers(surfaces: Surfaces, count: int) -> np.ndarray:
    """Return (R,) bool: receivers at the end of an edge that only one face has.

    Creases split receivers, so the edge between two walls is one-faced on either side.
    """
    border = np.zeros(count, bool)
    for corners in (surfaces.corner_front, surfaces.corner_back[(surfaces.corner_back >= 0).all(axis=1)]):
        if not len(corners):
            continue
        edges = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edge = group_of(edges.T)
        border[edges[np.bincount(edge)[edge] == 1]] = True
    return border


def covered_share(surfaces: Surfaces, receivers: Receivers) -> np.ndarray:
    """Return alpha / 2 pi of each receiver, (R,) float64 in (0, 1], exactly 1 where it is not at a border.

    alpha is the sum of its faces' angles in projection on its tangent plane; receivers in object space.
    """
    alpha = np.zeros(len(receivers.areas))
    for corners in (surfaces.corner_front, surfaces.corner_back):
        rows = corners[(corners >= 0).all(axis=1)]
        if not len(rows):
            continue
        p = receivers.positions[rows]
        for k in range(3):
            at, n = rows[:, k], receivers.normals[rows[:, k]]
            u, v = (_projected(p[:, (k + j) % 3] - p[:, k], n) for j in (1, 2))
            cross = np.cross(u, v)
            angle = np.arctan2(np.sqrt((cross * cross).sum(axis=1)), (u * v).sum(axis=1))
            alpha += np.bincount(at, angle, len(alpha))
    share = np.clip(alpha / (2 * math.pi), LEAST_SHARE, 1.0)
    return np.where(border_receivers(surfaces, len(share)), share, 1.0)


def _projected(v: np.ndarray, n: np.ndarray) -> np.ndarray:
    return v - (v * n).sum(axis=1)[:, None] * n

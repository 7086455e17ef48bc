"""Evaluation points of the reference, one per receiver."""

from __future__ import annotations

import numpy as np

from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces

INWARD = 1e-2  # of the offset to the mean centroid of a receiver's faces: well inside a cell, far from the wall
EVALUATION_LIFT = 1e-3  # of the mean distance to those centroids: a tenth of INWARD, so edge points stay near the wall


def evaluation_points(surfaces: Surfaces, receivers: Receivers) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and normals, both (R, 3) float64.

    A vertex on an edge lies in the plane of the neighbouring wall, which blocks every ray. Each receiver therefore
    moves by INWARD of the offset to the mean centroid of its faces, and is lifted along its normal. On a convex surface
    the centroids lie below the tangent plane: there the offset is projected on that plane. Centroids are computed from
    receivers, so `receivers` may be at any poses. Receivers without faces (probes) do not move.
    """
    P, N = receivers.positions, receivers.normals
    way, distance, count = np.zeros_like(P), np.zeros(len(P)), np.zeros(len(P))
    for corners in (surfaces.corner_front, surfaces.corner_back[(surfaces.corner_back >= 0).all(axis=1)]):
        centroid = P[corners].mean(axis=1) if len(corners) else np.zeros((0, 3))
        for k in range(3):
            step = centroid - P[corners[:, k]]
            np.add.at(way, corners[:, k], step)
            np.add.at(distance, corners[:, k], np.sqrt((step * step).sum(axis=1)))
            np.add.at(count, corners[:, k], 1)
    way /= np.maximum(count, 1)[:, None]
    distance /= np.maximum(count, 1)
    below = np.minimum((way * N).sum(axis=1), 0)
    way -= below[:, None] * N
    return P + INWARD * way + (EVALUATION_LIFT * distance)[:, None] * N, N.copy()

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
    P, N, n = receivers.positions, receivers.normals, len(receivers.positions)
    front, back = surfaces.corner_front, surfaces.corner_back
    sides = front, back[(back >= 0).all(axis=1)]
    rows = np.concatenate([corners.T.reshape(-1) for corners in sides])
    step = np.concatenate([np.tile(P[corners].mean(axis=1), (3, 1)) for corners in sides]) - P[rows]
    count = np.maximum(np.bincount(rows, minlength=n), 1)
    way = np.stack([np.bincount(rows, each, n) for each in step.T], axis=1) / count[:, None]
    distance = np.bincount(rows, np.sqrt((step * step).sum(axis=1)), n) / count
    below = np.minimum((way * N).sum(axis=1), 0)
    way -= below[:, None] * N
    return P + INWARD * way + (EVALUATION_LIFT * distance)[:, None] * N, N.copy()

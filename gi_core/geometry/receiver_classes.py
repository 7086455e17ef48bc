"""Receiver classes of error statistics, and the border angle.

The border angle is the angle that the surface covers in a receiver's tangent plane (report 2.9.1, fig. 2.10): 2 pi
inside a surface, pi on a straight border, pi / 2 in the corner of a wall. Photons hit the surface only, so at a border
they reach angle / 2 pi of a disc.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.geometry.error import luminance
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces


def border_receivers(surfaces: Surfaces, count: int) -> np.ndarray:
    """Return (R,) bool: the receiver is an end of an edge with a single face.

    Creases split receivers, so an edge between two walls has a single face on either side.
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
    """Return alpha / 2 pi of each receiver, (R,) float64 in (0, 1], exactly 1 away from borders.

    alpha is the sum of the faces' angles, projected on the tangent plane. receivers: in object space.
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
    # 0.01 of a full turn: lower bound of the divisor at tips of slivers
    share = np.clip(alpha / (2 * math.pi), 0.01, 1.0)
    return np.where(border_receivers(surfaces, len(share)), share, 1.0)


def _projected(v: np.ndarray, n: np.ndarray) -> np.ndarray:
    return v - (v * n).sum(axis=1)[:, None] * n


AFFECTED = 0.01  # of mean luminance: least change that counts
CLASSES = ("untouched", "affected", "mobile", "border")


def receiver_classes(
    surfaces: Surfaces, receivers: Receivers, now: np.ndarray, background: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the members of each class, {name: (R,) bool}; each receiver is in exactly one class, the first of these.

    mobile: on a mobile. border: at a border or corner, where a disc hangs over an edge or into a wall. affected:
    mobiles change luminance by more than AFFECTED of its mean; `now` and `background` are irradiance (R, 3) with
    mobiles and of the static part alone (rows of mobiles are ignored). untouched: all others.
    """
    on_mobile = np.arange(len(receivers.areas)) >= surfaces.first_receiver[1]
    border = border_receivers(surfaces, len(receivers.areas)) & ~on_mobile
    light = luminance(now)
    w = receivers.areas
    mean = float((w * light).sum() / w.sum()) if w.sum() > 0 else 0.0
    changed = np.abs(light - luminance(background)) > AFFECTED * mean
    rest = ~on_mobile & ~border
    return {"untouched": rest & ~changed, "affected": rest & changed, "mobile": on_mobile, "border": border}

"""Sites of directional light: receivers that lie close together share the cells of one of them.

Gloss discs are many receivers wide on a fine mesh, so neighbours have nearly the same rays. Irradiance, eye and normal
stay those of each receiver.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.model import Model

SPACING = 0.7  # of the radius of a gloss disc, decision 35
TURN = 0.05  # of a normal, per component: flat surfaces share cells, a ball of 2,562 vertices none


def sites(model: Model, rows: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the receivers (m,) int64, ascending, that stand for receivers rows (n,), and the site (n,) int32 of each.

    radius [m]: of the gloss discs. Members of a site lie on the same side of one surface.
    """
    r = model.object_receivers
    box = np.floor(r.positions[rows] / (SPACING * radius)).astype(np.int64)
    turn = np.round(r.normals[rows] / TURN).astype(np.int64)
    group = group_of([model.receiver_sides[rows].astype(np.int64), *box.T, *turn.T])
    m = int(group.max(initial=-1)) + 1
    count = np.maximum(np.bincount(group, minlength=m), 1)
    middle = np.stack([np.bincount(group, r.positions[rows, c], m) for c in range(3)], axis=1) / count[:, None]
    off = ((r.positions[rows] - middle[group]) ** 2).sum(axis=1)
    order = np.lexsort((rows, off, group))
    owner = rows[order[np.flatnonzero(np.diff(group[order], prepend=-1))]]
    rank = np.argsort(np.argsort(owner))
    return np.sort(owner), rank[group].astype(np.int32)

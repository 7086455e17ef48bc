"""Directional light of a frame: cells of directions at glossy receivers."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.gloss.radiance import Directions
from gi_core.gloss.rays import RayTree

FIELDS = 6  # of a cell, see GlossLight

# Writes the cells (k, CELLS, 6) of receivers (k,), ascending, given their places (k,) in the resting light.
CellWriter = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]


class GlossLight(NamedTuple):
    """Directional light of a frame at n glossy receivers, held by m of them. The arrays are never written to again.

    A cell holds the share of irradiance that arrives through it, per channel, and the mean direction towards that light
    in the object's space: (red, green, blue, x, y, z). The mean is shorter than 1 where directions spread. Rays weigh
    flux / sqrt(cos), between irradiance and radiance.
    """

    rows: np.ndarray  # (n,) int64, receivers, ascending
    owners: np.ndarray  # (m,) int64, receivers whose cells these are, ascending
    place: np.ndarray  # (n,) int32 into owners
    resting: np.ndarray  # (m, CELLS, 6) float32, without mobiles; no light on mobiles, even light where probes show it
    changed: np.ndarray  # (k,) int64 into owners, ascending
    cells: np.ndarray  # (k, CELLS, 6) float32, in place of `resting`
    tree: RayTree | None = None  # the rays one by one, see `gi_core.gloss.rays`; None: cells alone
    opened: float = 0.0  # see Directions

    def directions(self, only: np.ndarray | None = None) -> Directions:
        """Return the light of all receivers, or `only` of some (k,), rows of `rows`: the rows of others are not to be
        read.
        """
        owners = slice(None) if only is None else np.unique(self.place[only])
        cells, place, tree = self.resting[owners], self.place, self.tree
        if only is None:
            cells = cells.copy()
            cells[self.changed] = self.cells
        else:
            _, here, now = np.intersect1d(owners, self.changed, assume_unique=True, return_indices=True)
            cells[here] = self.cells[now]
            place = np.zeros_like(place)
            place[only] = np.searchsorted(owners, self.place[only])
        if tree is None:
            return Directions(cells, np.zeros(1, np.int64), np.empty((0, FIELDS), np.float32), 0.0, place)
        return Directions(cells, tree.offsets, tree.rays, self.opened, place)


def settled(light: GlossLight, place: np.ndarray, cells: np.ndarray) -> GlossLight:
    """Return the light with other cells (n, CELLS, 6) of owners place (n,), ascending."""
    other = np.flatnonzero(~np.isin(light.changed, place))
    changed = np.concatenate([light.changed[other], place])
    order = np.argsort(changed)
    return light._replace(changed=changed[order], cells=np.concatenate([light.cells[other], cells])[order])

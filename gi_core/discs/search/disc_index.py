"""Disc index (report 2.7): one uniform grid over the discs, plus one per dense cluster.

Cells of a few radii are best, but memory bounds their number. A teapot in a stadium would then lie in a single cell.
Such clusters get separate grids, and a segment traverses each grid.

The cell size of a grid has the lowest predicted cost of traversal and disc tests. The report tuned the number of discs
per voxel by hand; the best number grows with the discs. In radii the best cells shrink, from 6 or 12 for sparse discs
to 2 for dense ones. Cells visited per metre of a random line are proportional to 1 / edge, so the mean over all cells
gives its cost.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from gi_core.base.grouping import components
from gi_core.discs.search.disc_grid import CELL_RADII, DiscGrid, box_of, cell_for, discs_in_cells
from gi_core.discs.search.predicate import LANES, Discs, Lines, to_list
from gi_core.photons.flux_sums import Sums

TRIED_CELL_RADII = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)  # radii
# Nanoseconds, of an Intel Xeon 2.1 GHz; only their ratios matter.
STEP_NS = 6.0  # traversal to the next cell
VISIT_NS = 20.0  # start of the tests of a cell with discs
BLOCK_NS = 12.0  # test of LANES discs


class DiscIndex:
    """Grids over discs; each disc is in one grid."""

    parts_share_lines = False

    def __init__(self, discs: Discs, pretest: str = "none", cell_radii: float | None = None):
        """cell_radii: edge of the cells in disc radii; None: chosen per grid."""
        self.discs = discs
        parts = _crowds(discs, np.flatnonzero(to_list(discs)), cell_radii or CELL_RADII)
        self.grids = [DiscGrid(discs, rows, pretest, cell_radii or best_cell_radii(discs, rows)) for rows in parts]

    def accumulate(self, lines: Lines, sign: int, sums: Sums, part: int = 0, parts: int = 1) -> int:
        """Add sign x flux of lines to the sums of the discs they cross; see `gi_core.discs.search`."""
        return sum(grid.accumulate(lines, sign, sums, part, parts) for grid in self.grids)

    def summary(self) -> str:
        """Return a summary of the grids."""
        return "disc_index: " + ", ".join(grid.summary() for grid in self.grids)


def _crowds(discs: Discs, rows: np.ndarray, cell_radii: float) -> list[np.ndarray]:
    """Return the rows (n,) of discs per grid."""
    least_crowd = 512  # discs: for fewer, clipping every segment against a grid does not pay
    low, extent = box_of(discs, rows)
    wanted = cell_radii * float(discs.radius)
    # grids with cells larger than 1.5 times the wanted one are searched for clusters
    if cell_for(extent, float(discs.radius), cell_radii) <= 1.5 * wanted or len(rows) < least_crowd:
        return [rows]
    edge = float(extent.max()) / 32  # 32 cells along the longest axis of the cluster search
    at = tuple(((discs.positions[rows] - low) / edge).astype(np.int64).T)
    held = np.zeros([int(a.max()) + 1 for a in at], np.int64)
    np.add.at(held, at, 1)
    crowd_of = _touching(held > 32)[at]  # 32 discs per such cell are a crowd
    size = np.bincount(crowd_of[crowd_of >= 0])
    parts, rest = [], np.ones(len(rows), bool)
    for crowd in np.argsort(-size)[:8]:  # 8 clusters at most
        inside = crowd_of == crowd
        # a cluster's box must be smaller than 0.5 of the box, so that the recursion ends
        if size[crowd] >= least_crowd and box_of(discs, rows[inside])[1].max() < 0.5 * extent.max():
            parts += _crowds(discs, rows[inside], cell_radii)
            rest &= ~inside
    return [*parts, rows[rest]] if rest.any() else parts


def _touching(crowded: np.ndarray) -> np.ndarray:
    """Return the cluster of each cell (X, Y, Z), -1 for cells with few discs.

    Cells that share a face, an edge or a corner belong to the same cluster.
    """
    crowd = np.full(np.array(crowded.shape) + 2, -1)  # a border, so that every cell has 26 neighbours
    cells = np.argwhere(crowded) + 1
    crowd[tuple(cells.T)] = np.arange(len(cells))
    pairs = []
    for step in itertools.product((-1, 0, 1), repeat=3):
        neighbour = crowd[tuple((cells + step).T)]
        pairs.append(np.stack([np.arange(len(cells)), neighbour], axis=1)[neighbour >= 0])
    crowd[tuple(cells.T)] = components(np.concatenate(pairs), len(cells))
    return crowd[1:-1, 1:-1, 1:-1]


def best_cell_radii(discs: Discs, rows: np.ndarray) -> float:
    """Return the cell edge in disc radii for a grid over discs `rows` (n,), by descent from CELL_RADII."""
    return _downhill(lambda radii: ns_per_metre(discs, rows, radii))


def _downhill(cost: Callable[[float], float]) -> float:
    """Return a local minimum over TRIED_CELL_RADII; each evaluation is a pass over the discs."""
    at = TRIED_CELL_RADII.index(CELL_RADII)
    costs = {at: cost(TRIED_CELL_RADII[at])}

    def better(k: int) -> bool:
        if not 0 <= k < len(TRIED_CELL_RADII):
            return False
        if k not in costs:
            costs[k] = cost(TRIED_CELL_RADII[k])
        return costs[k] < costs[at]

    for step in (1, -1):
        while better(at + step):
            at += step
    return TRIED_CELL_RADII[at]


def ns_per_metre(discs: Discs, rows: np.ndarray, cell_radii: float) -> float:
    """Return the predicted time per metre of line in a grid with such cells [ns]."""
    cell, _, shape, count = discs_in_cells(discs, rows, cell_radii)
    inside = float((shape - 2).prod())  # without the border
    blocks = (count + LANES - 1) // LANES
    return (STEP_NS + (VISIT_NS * float((count > 0).sum()) + BLOCK_NS * float(blocks.sum())) / inside) / cell

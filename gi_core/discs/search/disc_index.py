"""Disc index (report 2.7): one uniform grid over the discs, plus one per dense cluster.

Cells of a few radii are best, but memory bounds their number. A teapot in a stadium would then lie in a single cell.
Such clusters get separate grids, and a segment traverses each grid.
"""

from __future__ import annotations

import itertools

import numpy as np

from gi_core.base.grouping import components
from gi_core.discs.search.cell_size import best_cell_radii
from gi_core.discs.search.disc_grid import CELL_RADII, DiscGrid, box_of, cell_for
from gi_core.discs.search.predicate import Discs, Lines, to_list
from gi_core.photons.flux_sums import Sums

TOO_LARGE = 1.5  # times the wanted cell: grids with larger cells are searched for clusters
LEAST_CROWD = 512  # discs: for fewer, clipping every segment against a grid does not pay
MOST_CROWDS = 8
LOOK = 32  # cells along the longest axis of the cluster search
CROWDED = 32  # discs per such cell
SHRINKS = 0.5  # of the box: a cluster's box must be smaller, so that the recursion ends


class DiscIndex:
    """Grids over discs; each disc is in one grid."""

    parts_share_lines = False

    def __init__(self, discs: Discs, pretest: str = "none", cell_radii: float | None = None):
        """cell_radii: edge of the cells in disc radii; None: chosen per grid, see cell_size.py."""
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
    low, extent = box_of(discs, rows)
    wanted = cell_radii * float(discs.radius)
    if cell_for(extent, float(discs.radius), cell_radii) <= TOO_LARGE * wanted or len(rows) < LEAST_CROWD:
        return [rows]
    edge = float(extent.max()) / LOOK
    at = tuple(((discs.positions[rows] - low) / edge).astype(np.int64).T)
    held = np.zeros([int(a.max()) + 1 for a in at], np.int64)
    np.add.at(held, at, 1)
    crowd_of = _touching(held > CROWDED)[at]
    size = np.bincount(crowd_of[crowd_of >= 0])
    parts, rest = [], np.ones(len(rows), bool)
    for crowd in np.argsort(-size)[:MOST_CROWDS]:
        inside = crowd_of == crowd
        if size[crowd] >= LEAST_CROWD and box_of(discs, rows[inside])[1].max() < SHRINKS * extent.max():
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

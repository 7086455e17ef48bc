"""How large the cells of a disc grid should be: the size whose walks and tests are foretold to take least.

The report (2.7) found the number of discs a voxel that is best by hand, and that it grows with the discs. It does:
but in radii the best cells shrink, from 6 or 12 where discs lie apart to 2 where they crowd. A line that crosses the
grid at random meets 1 / edge cells a metre, so the mean over all cells tells what it has to do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gi_core.discs.search.disc_grid import CELL_RADII, discs_in_cells
from gi_core.discs.search.predicate import LANES, Discs

SIZES = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)  # radii
# Nanoseconds, of an Intel Xeon 2.1 GHz; only their ratios matter. See docs/measurements.md.
STEP_NS = 6.0  # to the next cell
VISIT_NS = 20.0  # to begin with the discs of a cell that has any
BLOCK_NS = 12.0  # to test LANES discs


def best_cell_radii(discs: Discs, rows: np.ndarray) -> float:
    """Return the edge of cells, in radii, for a grid over some discs (n,): downhill from CELL_RADII."""
    return _downhill(lambda radii: ns_a_metre(discs, rows, radii))


def _downhill(cost: Callable[[float], float]) -> float:
    """Return the best of SIZES as far as neighbours tell: each costs a pass over the discs."""
    at = SIZES.index(CELL_RADII)
    known = {at: cost(SIZES[at])}

    def better(k: int) -> bool:
        if not 0 <= k < len(SIZES):
            return False
        if k not in known:
            known[k] = cost(SIZES[k])
        return known[k] < known[at]

    for step in (1, -1):
        while better(at + step):
            at += step
    return SIZES[at]


def ns_a_metre(discs: Discs, rows: np.ndarray, cell_radii: float) -> float:
    """Return what a metre of a line is foretold to take in such a grid [ns]."""
    cell, _, shape, count = discs_in_cells(discs, rows, cell_radii)
    inside = float((shape - 2).prod())  # without the border
    blocks = (count + LANES - 1) // LANES
    return (STEP_NS + (VISIT_NS * float((count > 0).sum()) + BLOCK_NS * float(blocks.sum())) / inside) / cell

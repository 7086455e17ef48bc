"""Cell size of a disc grid: the size with the lowest predicted cost of traversal and disc tests.

The report (2.7) tuned the number of discs per voxel by hand; the best number grows with the discs. In radii the best
cells shrink, from 6 or 12 for sparse discs to 2 for dense ones. Cells visited per metre of a random line are
proportional to 1 / edge, so the mean over all cells gives its cost.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gi_core.discs.search.disc_grid import CELL_RADII, discs_in_cells
from gi_core.discs.search.predicate import LANES, Discs

SIZES = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)  # radii
# Nanoseconds, of an Intel Xeon 2.1 GHz; only their ratios matter. See docs/archive/measurements.md.
STEP_NS = 6.0  # traversal to the next cell
VISIT_NS = 20.0  # start of the tests of a cell with discs
BLOCK_NS = 12.0  # test of LANES discs


def best_cell_radii(discs: Discs, rows: np.ndarray) -> float:
    """Return the cell edge in disc radii for a grid over discs `rows` (n,), by descent from CELL_RADII."""
    return _downhill(lambda radii: ns_per_metre(discs, rows, radii))


def _downhill(cost: Callable[[float], float]) -> float:
    """Return a local minimum over SIZES; each evaluation is a pass over the discs."""
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


def ns_per_metre(discs: Discs, rows: np.ndarray, cell_radii: float) -> float:
    """Return the predicted time per metre of line in a grid with such cells [ns]."""
    cell, _, shape, count = discs_in_cells(discs, rows, cell_radii)
    inside = float((shape - 2).prod())  # without the border
    blocks = (count + LANES - 1) // LANES
    return (STEP_NS + (VISIT_NS * float((count > 0).sum()) + BLOCK_NS * float(blocks.sum())) / inside) / cell

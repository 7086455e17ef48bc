"""Every disc against every segment: the baseline of the other searches."""

from __future__ import annotations

import numpy as np

from gi_core.discs.search.disc_index import Visits, cross
from gi_core.discs.search.predicate import LANES, Discs, Lines, blocks, to_list
from gi_core.photons.flux_sums import Sums


class BruteForce:
    """Discs without a search structure."""

    def __init__(self, discs: Discs):
        self.discs = discs
        listed = np.flatnonzero(to_list(discs))
        rows = np.full(-(-len(listed) // LANES) * LANES, -1)
        rows[: len(listed)] = listed
        self.blocks = blocks(discs, rows)

    def accumulate(self, lines: Lines, sign: int, sums: Sums) -> int:
        n = len(lines.low)
        every = np.tile(np.array([0, len(self.blocks.front) // LANES], np.int32), (n, 1))
        visits = Visits.of(n)._replace(line=np.arange(n), blocks=every, low=lines.low, high=lines.high)
        return cross(n, visits, self.blocks, self.discs, lines, sign, sums)

    def summary(self) -> str:
        return f"brute_force: {len(self.blocks.front):,} discs, nothing over them"

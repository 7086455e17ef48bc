"""Every disc against every segment: the baseline of the other searches.

Candidates are handled here and in predicate.py: one inlined function for both made an estimate a fifth slower.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel, lowest_bit
from gi_core.base.vec import row
from gi_core.discs.search.predicate import (
    LANES,
    Discs,
    Lines,
    accepts,
    blocks,
    discs_crossed,
    receiver,
    record,
    share,
    to_list,
)
from gi_core.photons.flux_sums import CHUNK_BITS, Sums


class BruteForce:
    """Discs without a search structure."""

    parts_share_lines = False

    def __init__(self, discs: Discs):
        self.discs = discs
        listed = np.flatnonzero(to_list(discs))
        rows = np.full(-(-len(listed) // LANES) * LANES, -1)
        rows[: len(listed)] = listed
        self.blocks = blocks(discs, rows)

    def accumulate(self, lines: Lines, sign: int, sums: Sums, part: int = 0, parts: int = 1) -> int:
        """Add sign x flux of lines to the sums of the discs they cross; see `gi_core.discs.search`."""
        first, last = share(len(lines.low), part, parts)
        return _accumulate(self.blocks, self.discs, lines, first, last, sign, sums)

    def summary(self) -> str:
        """Return the number of discs, in words."""
        return f"brute_force: {len(self.blocks.front):,} discs, nothing over them"


@kernel
def _accumulate(blocks, discs, lines, first, last, sign, sums):
    r2 = discs.radius * discs.radius
    total = 0
    for k in range(first, last):
        origin, direction = row(lines.origin, k), row(lines.direction, k)
        for block in range(len(blocks.front) // LANES):
            bits = discs_crossed(blocks.data, block, origin, direction, lines.low[k], lines.high[k], r2)
            while bits != 0:
                i, centre, normal = receiver(blocks, block * LANES + lowest_bit(bits), direction)
                bits &= bits - np.uint32(1)
                if i >= 0 and accepts(discs, i, centre, normal, lines, k):
                    total += 1
                    for c in range(3):
                        sums.flux[i, 3 * lines.lamp[k] + c] += sign * lines.flux[k, c]
                    sums.touched[(sums.first + i) >> CHUNK_BITS] = True
                    if len(sums.log.line) > 0:
                        record(sums.log, k, i, centre, normal, lines)
    return total

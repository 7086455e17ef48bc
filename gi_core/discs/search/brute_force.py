"""Every disc against every segment: the search that the others are measured against.

What is done with a crossing found stands here and in disc_grid.py: one inlined function for both made
an estimate a fifth slower.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel
from gi_core.discs.search.accumulate import note
from gi_core.discs.search.predicate import (
    LANES,
    Discs,
    Lines,
    blocks,
    counts,
    crossed,
    lane_of,
    receiver,
    share,
    to_list,
)
from gi_core.discs.search.pretest import discs_left, triangles
from gi_core.photons.flux_sums import CHUNK_BITS, Sums


class BruteForce:
    """Discs with no structure over them."""

    parts_share_lines = False

    def __init__(self, discs: Discs, pretest: str = "none"):
        self.discs = discs
        listed = np.flatnonzero(to_list(discs))
        rows = np.full(-(-len(listed) // LANES) * LANES, -1)
        rows[: len(listed)] = listed
        self.blocks, self.pretest = blocks(discs, rows), triangles(pretest, discs, rows)

    def splat(self, lines: Lines, sign: int, sums: Sums, part: int = 0, parts: int = 1) -> int:
        """Add sign x flux of lines to the sums of the discs they cross; see `gi_core.discs.search`."""
        first, last = share(len(lines.low), part, parts)
        d = self.discs
        return _splat(*self.blocks, d.own, *d.regions[:2], d.radius, *lines, first, last, sign, *sums, self.pretest)

    def summary(self) -> str:
        """Return in words what was built."""
        return f"brute_force: {len(self.blocks.front):,} discs, nothing over them"


@kernel
def _splat(
    data, front, behind, own, row, reach, radius,
    origin, direction, low, stop, high, flux, patches, touches, first, last, sign, sums, touched, base, log,
    pretest,
):  # fmt: skip
    r2 = radius * radius
    total = 0
    for k in range(first, last):
        ox, oy, oz = origin[k, 0], origin[k, 1], origin[k, 2]
        dx, dy, dz = direction[k, 0], direction[k, 1], direction[k, 2]
        for block in range(len(front) // LANES):
            if pretest is not None:
                left = discs_left(pretest, data, block, ox, oy, oz, dx, dy, dz)
                if left == 0:
                    continue
            bits = crossed(data, block, ox, oy, oz, dx, dy, dz, low[k], high[k], r2)
            if pretest is not None:
                bits &= left
            while bits != 0:
                i, x, y, z, nx, ny, nz = receiver(data, front, behind, block * LANES + lane_of(bits), dx, dy, dz)
                bits &= bits - np.uint32(1)
                if i >= 0 and counts(
                    i, x, y, z, nx, ny, nz, k, ox, oy, oz, dx, dy, dz, stop[k], r2, own, row, reach, patches, touches
                ):
                    total += 1
                    for c in range(3):
                        sums[i, c] += sign * flux[k, c]
                    touched[(base + i) >> CHUNK_BITS] = True
                    if len(log.line) > 0:
                        note(log, k, i, x, y, z, nx, ny, nz, ox, oy, oz, dx, dy, dz)
    return total

"""Every disc against every segment: the search that the others are measured against."""

from __future__ import annotations

import numpy as np

from gi_core.disc_search.crossing import LANES, Discs, Lines, columns, counts, crossed
from gi_core.jit import kernel


class BruteForce:
    """Discs with no structure over them."""

    def __init__(self, discs: Discs):
        self.discs = discs
        rows = np.full(-(-len(discs.positions) // LANES) * LANES, -1)
        rows[: len(discs.positions)] = np.arange(len(discs.positions))
        self._columns = columns(discs.positions, discs.normals, rows)

    def splat(self, lines: Lines, first: int, last: int, sign: int, sums: np.ndarray) -> int:
        """Add sign x flux of lines first .. last - 1 to sums (R, 3) int64 of the discs they cross.

        Returns the number of crossings.
        """
        d = self.discs
        return _splat(*self._columns, d.own, *d.regions[:2], d.radius, *lines, first, last, sign, sums)


@kernel
def _splat(
    cx, cy, cz, nx, ny, nz, own, row, reach, radius,
    origin, direction, low, stop, high, flux, patches, touches, first, last, sign, sums,
):  # fmt: skip
    mask = np.zeros(len(cx), np.uint8)
    every = np.uint64(len(cx))
    r2 = radius * radius
    total = 0
    for k in range(first, last):
        ox, oy, oz = origin[k, 0], origin[k, 1], origin[k, 2]
        dx, dy, dz = direction[k, 0], direction[k, 1], direction[k, 2]
        n = crossed(cx, cy, cz, nx, ny, nz, np.uint64(0), every, ox, oy, oz, dx, dy, dz, low[k], high[k], r2, mask)
        if n == 0:
            continue
        for j in range(len(cx)):
            if mask[j] and counts(
                j, cx[j], cy[j], cz[j], nx[j], ny[j], nz[j], k, ox, oy, oz, dx, dy, dz, stop[k], r2,
                own, row, reach, patches, touches,
            ):  # fmt: skip
                total += 1
                for c in range(3):
                    sums[j, c] += sign * flux[k, c]
    return total

"""Every disc against every segment: the search that the others are measured against."""

from __future__ import annotations

import numpy as np

from gi_core.disc_search.crossing import Discs, Lines, counts, crossed
from gi_core.jit import kernel


class BruteForce:
    """Discs with no structure over them."""

    def __init__(self, discs: Discs):
        self.discs = discs
        p, n = discs.positions, discs.normals
        self._columns = tuple(np.ascontiguousarray(a[:, c]) for a in (p, n) for c in range(3))

    def splat(self, lines: Lines, first: int, last: int, sign: int, sums: np.ndarray) -> int:
        """Add sign x flux of lines first .. last - 1 to sums (R, 3) int64 of the discs they cross.

        Returns the number of crossings.
        """
        rules = tuple(self.discs.regions[:3])
        return _splat(*self._columns, self.discs.own, rules, self.discs.radius, *lines, first, last, sign, sums)


@kernel
def _splat(
    cx, cy, cz, nx, ny, nz, own, rules, radius,
    origin, direction, low, stop, high, flux, patches, touches, first, last, sign, sums,
):  # fmt: skip
    mask = np.zeros(len(cx), np.uint8)
    r2 = radius * radius
    total = 0
    for k in range(first, last):
        o, d = origin[k], direction[k]
        n = crossed(cx, cy, cz, nx, ny, nz, o[0], o[1], o[2], d[0], d[1], d[2], low[k], high[k], r2, mask)
        if n == 0:
            continue
        for j in range(len(cx)):
            if mask[j] and counts(
                j, cx[j], cy[j], cz[j], nx[j], ny[j], nz[j], o, d, stop[k], r2, own, rules, patches[k], touches[k]
            ):
                total += 1
                for c in range(3):
                    sums[j, c] += sign * flux[k, c]
    return total

"""The QuadTree of report 2.10.1 as it is written: float32 means of directions, updated by its formula.

A cell keeps up to CAPACITY rays one by one. One more, and they are summarised: one ray of their mean direction. From
then on the cell changes by R_new = (R + sum N / n - sum O / n) n / (n + n_n - n_o) until its last ray is removed.
"""

import numpy as np

from gi_core.gloss.hemisphere import CELLS

CAPACITY = 4


class QuadTree2003:
    """Rays at one receiver. A ray: key (int), cell (int), flux (3,) and direction (3,)."""

    def __init__(self) -> None:
        self._rays: list[dict[int, tuple[np.ndarray, np.ndarray]]] = [{} for _ in range(CELLS)]
        self._mean: list[np.ndarray | None] = [None] * CELLS  # direction of a summarised cell
        self._flux = np.zeros((CELLS, 3), np.float32)
        self._count = [0] * CELLS

    def update(self, removed, added) -> None:
        """Remove and add rays: lists of (key, cell, flux, direction)."""
        for cell in {ray[1] for ray in (*removed, *added)}:
            old, new = ([ray for ray in rays if ray[1] == cell] for rays in (removed, added))
            self._update_cell(cell, old, new)

    def _update_cell(self, cell: int, old, new) -> None:
        one, n, left = np.float32(1), np.float32(self._count[cell]), self._count[cell] + len(new) - len(old)
        self._count[cell] = left
        mean = self._mean[cell]
        if mean is None:
            rays = self._rays[cell]
            for key, *_ in old:
                del rays[key]
            for key, _, flux, direction in new:
                rays[key] = flux.astype(np.float32), direction.astype(np.float32)
            if left > CAPACITY:
                self._mean[cell] = sum((r[1] for r in rays.values()), np.zeros(3, np.float32)) * (
                    one / np.float32(left)
                )
                self._flux[cell] = sum((r[0] for r in rays.values()), np.zeros(3, np.float32))
                rays.clear()
            return
        if left <= 0:
            self._mean[cell], self._flux[cell] = None, 0.0
            return
        for sign, rays in ((one, new), (-one, old)):
            for _, _, flux, direction in rays:
                mean = mean + sign * direction.astype(np.float32) / n
                self._flux[cell] += sign * flux.astype(np.float32)
        self._mean[cell] = mean * (n / np.float32(left))

    def rays(self) -> np.ndarray:
        """Return flux and unit direction (m, 6) float32 of the rays and summaries."""
        out = [np.concatenate(ray) for rays in self._rays for ray in rays.values()]
        for mean, flux in zip(self._mean, self._flux, strict=True):
            if mean is not None:
                out.append(np.concatenate([flux, mean / max(float(np.sqrt(mean @ mean)), 1e-30)]))
        return np.array(out, np.float32).reshape(-1, 6)

    @property
    def needlessly_summarised(self) -> int:
        """Number of summaries of CAPACITY rays or fewer: information that a new tree would have."""
        return sum(mean is not None and n <= CAPACITY for mean, n in zip(self._mean, self._count, strict=True))

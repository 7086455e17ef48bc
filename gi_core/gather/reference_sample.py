"""Receivers drawn by area, at which the reference is gathered."""

from __future__ import annotations

import numpy as np


def draw_by_area(rows: np.ndarray, areas: np.ndarray, count: int, seed) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (n,), ascending, of `count` draws with replacement from `rows`, and how often each was drawn.

    A row's chance is its share of the areas (R,), so sums weighted by the counts (n,) float64 estimate sums weighted by
    area. Without replacement, few large receivers would count no more than many small ones.
    """
    share = areas[rows] / areas[rows].sum()
    drawn, times = np.unique(np.random.default_rng(seed).choice(rows, count, p=share), return_counts=True)
    return drawn, times.astype(np.float64)

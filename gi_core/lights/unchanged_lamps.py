"""Lamps that an edit of a scene leaves as they were: light and paths of these can be taken over."""

from __future__ import annotations

import numpy as np

from gi_core.lights.emission import PHOTOMETRIC, Emitters

TABLE = 11  # parameter of PHOTOMETRIC: start in `tables`


def unchanged_lamps(before: Emitters, now: Emitters) -> np.ndarray:
    """Return the number before of each lamp now (G,) int64, -1: it is new or emits otherwise.

    A lamp is unchanged if its name, its emitters in order, and their fluxes are the same; its share of the photons may
    differ.
    """
    numbers = {name: g for g, name in enumerate(before.lamps.names)}
    pairs = [numbers.get(name, -1) for name in now.lamps.names]
    alike = [g if g >= 0 and _alike(before, g, now, k) else -1 for k, g in enumerate(pairs)]
    return np.array(alike, np.int64)


def _alike(before: Emitters, g: int, now: Emitters, k: int) -> bool:
    a, b = np.flatnonzero(before.lamp == g), np.flatnonzero(now.lamp == k)
    if len(a) != len(b):
        return False
    known, here = before.parameters[a].copy(), now.parameters[b].copy()
    luminaires = before.kind[a] == PHOTOMETRIC
    starts = known[luminaires, TABLE].astype(int), here[luminaires, TABLE].astype(int)
    known[luminaires, TABLE] = here[luminaires, TABLE] = 0
    return (
        np.array_equal(before.kind[a], now.kind[b])
        and np.array_equal(known, here)
        and np.array_equal(before.flux[a], now.flux[b])
        and all(
            np.array_equal(_table(before.tables, i), _table(now.tables, j)) for i, j in {*zip(*starts, strict=True)}
        )
    )


def _table(tables: np.ndarray, start: int) -> np.ndarray:
    """Return one table of luminaires, see `photometric.py`."""
    rows, planes = tables[start : start + 2].astype(int)
    return tables[start : start + 2 + rows + planes + 2 * rows * planes + rows]

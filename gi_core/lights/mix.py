"""Light at levels of the lamps, from light per lamp (see `lamps.py`)."""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.threads import run_ranges

GRAIN = 4096  # receivers per thread


@inlined
def mixed(light, row, levels):
    """Return red, green and blue of a row of light per lamp (n, 3 G), at levels (G, 3)."""
    x = y = z = 0.0
    for g in range(len(levels)):
        x += levels[g, 0] * light[row, 3 * g]
        y += levels[g, 1] * light[row, 3 * g + 1]
        z += levels[g, 2] * light[row, 3 * g + 2]
    return x, y, z


def sum_of_lamps(light: np.ndarray) -> np.ndarray:
    """Return light (n, 3) of light per lamp (n, 3 G), at the levels of the scene file."""
    return light if light.shape[1] == 3 else light.reshape(len(light), light.shape[1] // 3, 3).sum(axis=1)


def mix(light: np.ndarray, levels: np.ndarray, threads: int = 1) -> np.ndarray:
    """Return light (n, 3) float64 of light per lamp (n, 3 G), at levels (G, 3)."""
    out = np.empty((len(light), 3))
    run_ranges(lambda _, first, last: _mix(light, levels, first, last, out), len(out), threads, GRAIN)
    return out


@kernel
def _mix(light, levels, first, last, out):
    for r in range(first, last):
        out[r, 0], out[r, 1], out[r, 2] = mixed(light, r, levels)

"""Light at levels of the lamps, from light per lamp (see `lamps.py`)."""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.threads import run_ranges

MIX_GRAIN = 4096  # receivers per thread


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
    return light if light.shape[1] == 3 else mix(light, np.ones((light.shape[1] // 3, 3)))


def mix(light: np.ndarray, levels: np.ndarray, threads: int = 1) -> np.ndarray:
    """Return light (n, 3) float64 of light per lamp (n, 3 G), at levels (G, 3)."""
    out = np.empty((len(light), 3))
    run_ranges(lambda _, first, last: _mix(light, levels, first, last, out), len(out), threads, MIX_GRAIN)
    return out


def irradiance_at(
    sums: np.ndarray, levels: np.ndarray, flux_unit: float, area: np.ndarray, threads: int = 1
) -> np.ndarray:
    """Return E (R, 3) [W/m2] at levels (G, 3), of sums (R, 3 G) of flux units [W] over areas (R,) [m2]."""
    out = np.empty((len(area), 3))
    run_ranges(lambda _, *rows: read_out(sums, levels, flux_unit, area, *rows, out), len(out), threads, MIX_GRAIN)
    return out


@kernel
def _mix(light, levels, first, last, out):
    for r in range(first, last):
        out[r, 0], out[r, 1], out[r, 2] = mixed(light, r, levels)


@kernel
def read_out(sums, levels, flux_unit, area, first, last, out):
    """Write irradiance of receivers first .. last - 1, as irradiance_at()."""
    for r in range(first, last):
        # Area 0: no light can reach the receiver, or it has no face.
        factor = flux_unit / area[r] if area[r] > 0.0 else 0.0
        x, y, z = mixed(sums, r, levels)
        out[r, 0], out[r, 1], out[r, 2] = x * factor, y * factor, z * factor

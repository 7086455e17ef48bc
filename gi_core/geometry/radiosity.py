"""Radiosity and exitant radiance: B = rho E, L = B / pi + Le (report Eq. 2.2, 3.4.2).

Irradiance is estimated once per receiver; faces of several colours share it.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import kernel


@kernel
def _read_out(sums, scale, area, out):
    for r in range(len(area)):
        # Area 0: no light can reach the receiver, or it has no face.
        factor = scale / area[r] if area[r] > 0.0 else 0.0
        for c in range(sums.shape[1]):
            out[r, c] = sums[r, c] * factor


def irradiance(sums: np.ndarray, flux_unit: float, area: np.ndarray) -> np.ndarray:
    """Return E (R, n) [W/m2] of sums (R, n) of flux units [W] over areas (R,) [m2]; 0 where the area is 0."""
    out = np.empty(sums.shape)
    _read_out(sums, flux_unit, area, out)
    return out


def radiosity(irradiance: np.ndarray, reflectance: np.ndarray | float) -> np.ndarray:
    """Return B (n, 3) [W/m2] of diffuse surfaces from E (n, 3) [W/m2] and rho (n, 3)."""
    return reflectance * irradiance


def exitant_radiance(
    irradiance: np.ndarray, reflectance: np.ndarray | float, emission: np.ndarray | float
) -> np.ndarray:
    """Return L (n, 3) [W/m2/sr] of diffuse surfaces, emission Le (n, 3) included."""
    return radiosity(irradiance, reflectance) / math.pi + emission

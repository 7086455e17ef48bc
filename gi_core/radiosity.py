"""From irradiance to what leaves a surface: B = rho E, L = B / pi + Le (report Eq. 2.2, 3.4.2).

Irradiance is estimated once a receiver; triangles of several colours share it.
"""

from __future__ import annotations

import math

import numpy as np


def radiosity(irradiance: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
    """Return B (n, 3) [W/m2] of diffuse surfaces from E (n, 3) [W/m2] and rho (n, 3)."""
    return reflectance * irradiance


def exitant_radiance(irradiance: np.ndarray, reflectance: np.ndarray, emission: np.ndarray) -> np.ndarray:
    """Return L (n, 3) [W/m2/sr] of diffuse surfaces, emission Le (n, 3) included."""
    return radiosity(irradiance, reflectance) / math.pi + emission

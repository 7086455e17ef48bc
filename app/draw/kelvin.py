"""Colour of light by its correlated colour temperature, in linear Rec. 709 RGB of luminance 1.

Chromaticity on the Planckian locus: Kim et al. 2002 (US patent 7,024,034), cubic in 1 / T, within 1e-3 of the locus
from 1667 to 25,000 K.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gi_core.geometry.error import REC709

COOLEST, HOTTEST = 1700.0, 20_000.0  # [K]
FROM_XYZ = np.array([(3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570)])

RGB = tuple[float, float, float]


def colour_of(kelvin: float) -> RGB:
    """Return the colour of a black body at a temperature [K], of luminance 1; channels are at least 0."""
    t = min(max(kelvin, COOLEST), HOTTEST)
    if t <= 4000:
        x = -0.2661239e9 / t**3 - 0.2343589e6 / t**2 + 0.8776956e3 / t + 0.179910
    else:
        x = -3.0258469e9 / t**3 + 2.1070379e6 / t**2 + 0.2226347e3 / t + 0.240390
    if t <= 2222:
        y = -1.1063814 * x**3 - 1.34811020 * x**2 + 2.18555832 * x - 0.20219683
    elif t <= 4000:
        y = -0.9549476 * x**3 - 1.37418593 * x**2 + 2.09137015 * x - 0.16748867
    else:
        y = 3.0817580 * x**3 - 5.87338670 * x**2 + 3.75112997 * x - 0.37001483
    return of_luminance_one(np.maximum(FROM_XYZ @ np.array([x / y, 1.0, (1 - x - y) / y]), 0.0))


def of_luminance_one(rgb: Sequence[float] | np.ndarray) -> RGB:
    """Return a colour scaled to luminance 1; white if it is black."""
    r, g, b = (float(c) for c in rgb)
    total = float(REC709 @ (r, g, b))
    return (r / total, g / total, b / total) if total > 0 else (1.0, 1.0, 1.0)


def kelvin_of(rgb: Sequence[float]) -> float:
    """Return the temperature [K] of the black body whose colour is nearest to an RGB colour."""
    temperatures = np.geomspace(COOLEST, HOTTEST, 200)
    wanted = np.array(of_luminance_one(rgb))
    apart = [np.abs(np.array(colour_of(t)) - wanted).sum() for t in temperatures]
    return float(temperatures[int(np.argmin(apart))])


def factor(kelvin: float, base: Sequence[float]) -> RGB:
    """Return the factors that turn light of colour `base` into that of a temperature, of the same luminance.

    A channel that `base` lacks stays black.
    """
    wanted = colour_of(kelvin)
    scaled = [w / b if b > 0 else 0.0 for w, b in zip(wanted, base, strict=True)]
    kept = float(REC709 @ np.multiply(scaled, base))
    of = float(REC709 @ np.asarray(base, np.float64))
    r, g, b = (s * of / kept if kept > 0 else 1.0 for s in scaled)
    return r, g, b

"""Colours: maps of numbers to display colours, and light by its correlated colour temperature, of luminance 1.

Maps are lines in Oklab (Ottosson 2020), a perceptually uniform space. Errors have a diverging one: blue below zero,
light grey at zero, red above. Both ends are equally dark, so neither sign looks worse; colour-blind readers can
distinguish blue and red. Irradiance has a sequential one, ever lighter. Chromaticity on the Planckian locus: Kim et al.
2002 (US patent 7,024,034), cubic in 1 / T, within 1e-3 of the locus from 1667 to 25,000 K.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.draw.tonemap import UNLIT, srgb_encode
from gi_core.geometry.error import REC709

ZERO = (0.93, 0.0, 0.0)  # Oklab L, a, b
VIRIDIS = np.array(  # Oklab of five colours of viridis (Smith and van der Walt 2015): violet, blue, teal, green, yellow
    [
        [0.285, 0.102, -0.091],
        [0.448, -0.007, -0.098],
        [0.597, -0.094, -0.017],
        [0.749, -0.141, 0.101],
        [0.918, -0.039, 0.182],
    ]
)
SEQUENTIAL_STEPS = 32  # of the table, whose colours are interpolated as display values
UNKNOWN_COLOUR = UNLIT  # display colour of nan, darker than the map

_CUBE_ROOTS = np.array(
    [[1, 0.3963377774, 0.2158037573], [1, -0.1055613458, -0.0638541728], [1, -0.0894841775, -1.2914855480]]
)
_LINEAR = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)


def signed_colours(values: np.ndarray) -> np.ndarray:
    """Return display colours (n, 3) float32 in 0 .. 1 for values (n,), cut off at -1 and 1; nan is UNKNOWN_COLOUR."""
    x = np.clip(np.asarray(values, np.float64), -1, 1)[:, None]
    finite = ~np.isnan(x[:, 0])
    zero, end = np.array(ZERO), np.where(x < 0, (0.44, -0.028, -0.165), (0.44, 0.155, 0.075))  # at -1 and +1
    rgb = from_oklab(zero + np.abs(np.nan_to_num(x)) * (end - zero))
    rgb[~finite] = UNKNOWN_COLOUR
    return rgb.astype(np.float32)


def from_oklab(lab: np.ndarray) -> np.ndarray:
    """Return display colours (n, 3) in 0 .. 1 of Oklab colours (n, 3)."""
    return srgb_encode(np.clip((lab @ _CUBE_ROOTS.T) ** 3 @ _LINEAR.T, 0, 1))


def sequential_colours(t: np.ndarray) -> np.ndarray:
    """Return display colours (n, 3) in 0 .. 1 of positions (n,) in 0 .. 1 on a scale, as surface.frag does."""
    places = np.linspace(0, 1, SEQUENTIAL_STEPS + 1)
    return np.stack([np.interp(t, places, SEQUENTIAL[:, k]) for k in range(3)], axis=1)


def _sequential() -> np.ndarray:
    """Return the table (SEQUENTIAL_STEPS + 1, 3) of display colours."""
    places, stops = np.linspace(0, 1, SEQUENTIAL_STEPS + 1), np.linspace(0, 1, len(VIRIDIS))
    return from_oklab(np.stack([np.interp(places, stops, VIRIDIS[:, k]) for k in range(3)], axis=1))


SEQUENTIAL = _sequential()


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

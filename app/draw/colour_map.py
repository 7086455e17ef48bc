"""Colour maps of lines in Oklab (Ottosson 2020), a perceptually uniform space.

Errors have a diverging map: blue below zero, light grey at zero, red above. Both ends are equally dark, so neither sign
looks worse; colour-blind readers can distinguish blue and red. Irradiance has a sequential one, ever lighter.
"""

from __future__ import annotations

import math

import numpy as np

ZERO = (0.93, 0.0, 0.0)  # Oklab L, a, b
BELOW = (0.44, -0.028, -0.165)  # at -1
ABOVE = (0.44, 0.155, 0.075)  # at +1
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
SHARE = 0.95  # of the weight of values: within the end of their scale
UNKNOWN_COLOUR = (0.24, 0.245, 0.255)  # display colour of nan, darker than the map

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
    zero, end = np.array(ZERO), np.where(x < 0, BELOW, ABOVE)
    rgb = from_oklab(zero + np.abs(np.nan_to_num(x)) * (end - zero))
    rgb[~finite] = UNKNOWN_COLOUR
    return rgb.astype(np.float32)


def from_oklab(lab: np.ndarray) -> np.ndarray:
    """Return display colours (n, 3) in 0 .. 1 of Oklab colours (n, 3)."""
    linear = np.clip((lab @ _CUBE_ROOTS.T) ** 3 @ _LINEAR.T, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def sequential_colours(t: np.ndarray) -> np.ndarray:
    """Return display colours (n, 3) in 0 .. 1 of positions (n,) in 0 .. 1 on a scale, as surface.frag does."""
    places = np.linspace(0, 1, SEQUENTIAL_STEPS + 1)
    return np.stack([np.interp(t, places, SEQUENTIAL[:, k]) for k in range(3)], axis=1)


def _sequential() -> np.ndarray:
    """Return the table (SEQUENTIAL_STEPS + 1, 3) of display colours."""
    places, stops = np.linspace(0, 1, SEQUENTIAL_STEPS + 1), np.linspace(0, 1, len(VIRIDIS))
    return from_oklab(np.stack([np.interp(places, stops, VIRIDIS[:, k]) for k in range(3)], axis=1))


SEQUENTIAL = _sequential()


def round_scale(values: np.ndarray, weights: np.ndarray) -> float:
    """Return a round number (1, 2 or 5 times a power of ten) that SHARE of the weight of |values| stays within.

    For the end of a scale: nan values do not count; 1 without values.
    """
    magnitude = np.abs(values)
    counted = np.isfinite(magnitude) & (weights > 0)
    if not counted.any() or not magnitude[counted].any():
        return 1.0
    order = np.argsort(magnitude[counted])
    sorted_weights = np.cumsum(np.asarray(weights, np.float64)[counted][order])
    at = float(magnitude[counted][order][np.searchsorted(sorted_weights, SHARE * sorted_weights[-1])])
    if at <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(at))
    return next(step * power for step in (1, 2, 5, 10) if at <= step * power * (1 + 1e-9))

"""False colours of irradiance or illuminance: scale, ticks, and the map from values to colours."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.draw.colour_map import sequential_colours
from gi_core.geometry.error import luminance

if TYPE_CHECKING:
    from app.draw.units import Units

QUANTILES = 0.02, 0.98  # of the visible surface: shadows in corners and spots at lamps exceed the scale
LOGARITHMIC = 30.0  # least ratio of the quantiles for a logarithmic scale
MOST_DECADES = 4
STEPS = (1.0, 2.0, 5.0, 10.0)  # round numbers of a decade
LABEL = 0.09  # of the scale: least distance of ticks from its ends, for their labels
LEAST_TICKS = 4  # intervals of a linear scale, at least


class Scale(NamedTuple):
    """Ends and kind of a scale of irradiance [W/m2] or illuminance [lx]."""

    low: float  # over 0 if logarithmic
    high: float
    logarithmic: bool

    @property
    def ticks(self) -> list[float]:
        """Round numbers from low to high, and the ends."""
        if self.logarithmic:
            decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
            many = math.log10(self.high / self.low) > 2.5
            inner = [s * 10.0**k for k in decades for s in ((1.0,) if many else STEPS[:3])]
        else:
            step = _step(self.high - self.low)
            inner = [k * step for k in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]
        inner = [t for t in inner if LABEL < self.position(np.array([t]))[0] < 1 - LABEL]
        return [self.low, *inner, self.high]

    @property
    def labels(self) -> list[tuple[float, str]]:
        """Positions from 0 to 1 and texts of the ticks; the ends include all values beyond."""
        values = self.ticks
        texts = [f"{t:g}" for t in values]
        texts[-1] += " or more"
        texts[0] += " or less" if self.low > 0 else ""
        return list(zip(self.position(np.array(values)).tolist(), texts, strict=True))

    def title(self, units: Units) -> list[str]:
        """Return the lines above a legend."""
        return [f"{units.on_surface} [{units.per_area}]", "logarithmic" if self.logarithmic else "linear"]

    def text(self, units: Units) -> str:
        """Return the scale as one line, for metadata."""
        kind = "logarithmic" if self.logarithmic else "linear"
        return f"{units.on_surface} in {units.per_area}, {self.low:g} to {self.high:g}, {kind}, viridis"

    def position(self, values: np.ndarray) -> np.ndarray:
        """Return the position (n,) in 0 .. 1 of values (n,) on the scale; nan stays nan."""
        if self.logarithmic:
            t = np.log(np.maximum(values, 1e-30) / self.low) / math.log(self.high / self.low)
        else:
            t = (values - self.low) / (self.high - self.low)
        return np.clip(t, 0.0, 1.0)


def fixed_scale(low: float, high: float) -> Scale:
    """Return the scale between two values, logarithmic if they are far apart."""
    return Scale(low, high, low > 0 and high >= LOGARITHMIC * low)


def automatic_scale(values: np.ndarray) -> Scale:
    """Return a scale with round ends for irradiance (n,) of the visible surface, as of `raycast.visible_irradiance`.

    A linear scale starts at 0; a logarithmic one is for a wide range of values.
    """
    values = values[np.isfinite(values)]
    low, high = np.quantile(values, QUANTILES).tolist() if len(values) else (0.0, 0.0)
    if high <= 0:
        return Scale(0.0, 1.0, False)
    if low * LOGARITHMIC <= high:
        return Scale(*_round_ends(max(low, high / 10.0**MOST_DECADES), high), True)
    step = _step(high)
    return Scale(0.0, _rounded(step * math.ceil(high / step - 1e-9)), False)


def false_colours(radiance: np.ndarray, scale: Scale) -> np.ndarray:
    """Return display colours (n, 3) uint8 of surfaces that show E / pi (n, 3)."""
    t = scale.position(math.pi * luminance(radiance))
    return np.round(255 * sequential_colours(t)).astype(np.uint8)


def _rounded(value: float) -> float:
    """Return 1.2 for 6 times 0.2."""
    return float(f"{value:.6g}")


def _step(length: float) -> float:
    """Return the largest round number of which LEAST_TICKS fit into a length."""
    most = length / LEAST_TICKS
    power = 10.0 ** math.floor(math.log10(most))
    return max(s * power for s in STEPS if s * power <= most * (1 + 1e-9))


def _round_ends(low: float, high: float) -> tuple[float, float]:
    """Return the next round numbers below and above."""
    down, up = (10.0 ** math.floor(math.log10(x)) for x in (low, high))
    return (
        max(s * down for s in STEPS if s * down <= low * (1 + 1e-9)),
        min(s * up for s in STEPS if s * up >= high * (1 - 1e-9)),
    )

"""False colours of illuminance or luminance: scale, ticks, isolines, and the map from values to colours."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from app.draw.colour_map import sequential_colours
from app.draw.tonemap import NEUTRAL, Gains, to_display
from app.settings import DEFAULT_TONE_MAP, ILLUMINANCE, LUMINANCE
from app.values import MOST_ISOLINES
from gi_core.geometry.error import luminance
from gi_core.scene.types import Units

SHARE = 0.95  # of the weight of values: within the end of their scale
LOGARITHMIC = 30.0  # least ratio of the quantiles for a logarithmic scale
ROUND_STEPS = (1.0, 2.0, 5.0, 10.0)  # round numbers of a decade
LINE_PIXELS = 1.5  # width of isolines, at 96 dots per inch
LINE_OPACITY = 0.85
LIGHT_FROM = 0.55  # of the scale: from there on lines are black, below white


class Scale(NamedTuple):
    """Ends and kind of a scale of illuminance [W/m2 or lx] or luminance [W/m2/sr or cd/m2]."""

    low: float  # over 0 if logarithmic
    high: float
    logarithmic: bool
    lines: tuple[float, ...] = ()  # values of the isolines, ascending
    quantity: str = ILLUMINANCE  # or LUMINANCE

    def with_lines(self, values: tuple[float, ...] | None) -> Scale:
        """Return the scale with isolines at these values, at most MOST_ISOLINES; (): round ones; None: without."""
        if values is None:
            return self._replace(lines=())
        if not values:
            values = tuple(v for v in self._round_numbers(MOST_ISOLINES) if self.low < v <= self.high)
        return self._replace(lines=tuple(sorted(set(values)))[:MOST_ISOLINES])

    def _round_numbers(self, most: int) -> list[float]:
        """Return round numbers of the scale; of a logarithmic one powers of ten alone if there are more than `most`."""
        if not self.logarithmic:
            step = round_below((self.high - self.low) / 4)
            ends = math.ceil(self.low / step), math.floor(self.high / step * (1 + 1e-9))
            return [_rounded(k * step) for k in range(ends[0], ends[1] + 1)]
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        numbers: list[float] = []
        for steps in (ROUND_STEPS[:3], ROUND_STEPS[:1]):
            numbers = [v for k in decades for s in steps if self.low < (v := _rounded(s * 10.0**k)) <= self.high]
            if len(numbers) <= most:
                break
        return numbers

    @property
    def ticks(self) -> list[float]:
        """Values of the isolines, else round numbers from low to high, and the ends."""
        # Of the scale: least distance of ticks from its ends, and of isolines, for their labels.
        label, apart = 0.09, 0.06 if self.lines else 0.0
        inner, last = [], label - apart
        for t in self.lines or self._round_numbers(7):
            at = float(self.position(np.array([t]))[0])
            if last + apart <= at < 1 - label:
                inner.append(t)
                last = at
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
        name, unit = self._named(units)
        return [f"{name} [{unit}]", "logarithmic" if self.logarithmic else "linear"]

    def text(self, units: Units) -> str:
        """Return the scale as one line, for metadata."""
        kind = "logarithmic" if self.logarithmic else "linear"
        name, unit = self._named(units)
        text = f"{name} in {unit}, {self.low:g} to {self.high:g}, {kind}, viridis"
        return f"{text}, isolines at {', '.join(f'{v:g}' for v in self.lines)}" if self.lines else text

    def _named(self, units: Units) -> tuple[str, str]:
        if self.quantity == LUMINANCE:
            return units.from_surface.capitalize(), units.per_solid_angle
        return units.on_surface, units.per_area

    def position(self, values: np.ndarray) -> np.ndarray:
        """Return the position (n,) in 0 .. 1 of values (n,) on the scale; nan stays nan."""
        if self.logarithmic:
            t = np.log(np.maximum(values, 1e-30) / self.low) / math.log(self.high / self.low)
        else:
            t = (values - self.low) / (self.high - self.low)
        return np.clip(t, 0.0, 1.0)


def fixed_scale(low: float, high: float, quantity: str = ILLUMINANCE) -> Scale:
    """Return the scale between two values, logarithmic if they are far apart."""
    return Scale(low, high, low > 0 and high >= LOGARITHMIC * low, (), quantity)


def per_radiance(quantity: str) -> float:
    """Return the value of a quantity per radiance of the picture: that of illuminance shows E / pi."""
    return 1.0 if quantity == LUMINANCE else math.pi


def automatic_scale(values: np.ndarray, quantity: str = ILLUMINANCE) -> Scale:
    """Return a scale with round ends for light (n,) of the visible surface, as of `raycast.visible_light`.

    A linear scale starts at 0; a logarithmic one is for a wide range of values.
    """
    values = values[np.isfinite(values)]
    # Quantiles of the visible surface: shadows in corners and spots at lamps exceed the scale
    low, high = np.quantile(values, (0.02, 0.98)).tolist() if len(values) else (0.0, 0.0)
    if high <= 0:
        return Scale(0.0, 1.0, False, (), quantity)
    if low * LOGARITHMIC <= high:
        return Scale(round_below(max(low, high / 1e4)), round_above(high), True, (), quantity)
    step = round_below(high / 4)
    return Scale(0.0, _rounded(step * math.ceil(high / step - 1e-9)), False, (), quantity)


def false_colours(
    radiance: np.ndarray, scale: Scale, gradient: np.ndarray | None = None, to_middle: np.ndarray | None = None
) -> np.ndarray:
    """Return display colours (n, 3) uint8 of radiance (n, 3), E / pi for illuminance, as surface.frag does.

    gradient (n, 2): change of its luminance per pixel right and down, for isolines; None: without. to_middle
    (n, 2): offset to the middle of the pixel, where a line is drawn or not; None: 0.
    """
    factor = per_radiance(scale.quantity)
    E = factor * luminance(radiance)
    t = scale.position(E)
    colours = sequential_colours(t)
    if scale.lines and gradient is not None:
        change = factor * gradient
        slope = np.sqrt((change * change).sum(axis=1))
        at_middle = E if to_middle is None else E + (change * to_middle).sum(axis=1)
        off = np.abs(at_middle[:, None] - scale.lines).min(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            covered = np.clip(0.5 * LINE_PIXELS + 0.5 - off / slope, 0, 1)
        covered = np.where(slope > 0, covered, 0.0)[:, None] * LINE_OPACITY
        colours += covered * ((t < LIGHT_FROM)[:, None] - colours)
    return np.round(255 * colours).astype(np.uint8)


class Display(NamedTuple):
    """The map from radiance to display colours: a tone map, or false colours."""

    exposure: float  # [EV]
    tone_map: str = DEFAULT_TONE_MAP
    gains: Gains = NEUTRAL  # of the white balance
    scale: Scale | None = None  # None: the tone map

    def colours(
        self, radiance: np.ndarray, gradient: np.ndarray | None = None, to_middle: np.ndarray | None = None
    ) -> np.ndarray:
        """Return display colours (n, 3) uint8 of radiance (n, 3); gradient, to_middle: as for false_colours()."""
        if self.scale is None:
            return to_display(radiance, self.exposure, self.tone_map, self.gains)
        return false_colours(radiance, self.scale, gradient, to_middle)


def _rounded(value: float) -> float:
    """Return 1.2 for 6 times 0.2."""
    return float(f"{value:.6g}")


def round_below(value: float) -> float:
    """Return the largest round number (1, 2 or 5 times a power of ten) up to a value over 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(s * power for s in ROUND_STEPS if s * power <= value * (1 + 1e-9))


def round_above(value: float) -> float:
    """Return the smallest round number from a value over 0 on."""
    power = 10.0 ** math.floor(math.log10(value))
    return min(s * power for s in ROUND_STEPS if s * power >= value * (1 - 1e-9))


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
    return round_above(at)

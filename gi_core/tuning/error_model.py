"""Error model fitted to trials of a few settings, and the best setting for a given time or error.

With N photons the squared error of a setting is A / N + B^2: variance, and squared bias. A frame of n of the N photons
with the static light of all (`control_variate.py`) adds M (1 / n - 1 / N). Its time is s + c n. The five parameters are
fitted to the trials of each radius. Over radii each is a fitted power law: A should fall as r^-2, B grow as r^2 in
smooth light and as r at edges of shadows. No parameter is preset for a scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.fixed_point import MAX_PHOTONS
from gi_core.estimators.setting import Setting
from gi_core.tuning.setting_trials import Trial

FINE = 16  # radii evaluated, from the smallest to the largest tried
LEAST = {
    "noise": 1e-6,
    "moving": 1e-6,
    "bias": 3e-3,
    "start": 1e-5,
    "slope": 1e-12,
}  # lower bounds: smaller values are within noise of 0
FEWEST = 1024  # photons of a frame
EXPONENTS = {"noise": "A", "moving": "M", "bias": "B", "start": "s", "slope": "c"}


class Law(NamedTuple):
    """What a setting will do."""

    setting: Setting
    noise: float  # A
    moving: float  # M
    bias: float  # B
    start: float  # s [s]
    slope: float  # c [s] a photon

    def error(self, photons: float, frame: float | None = None) -> float:
        """Return the relative l1 error of so many photons, or of a frame of fewer of them."""
        more = self.moving * max(1 / frame - 1 / photons, 0.0) if frame else 0.0
        return math.sqrt(self.noise / photons + more + self.bias**2)

    def seconds(self, photons: float) -> float:
        """Return how long a frame takes [s]."""
        return self.start + self.slope * photons

    def photons_within(self, seconds: float) -> float:
        """Return how many photons a frame has time for."""
        return max((seconds - self.start) / max(self.slope, 1e-15), 0.0)

    def photons_for(self, error: float) -> float:
        """Return how many photons bring the error down so far; inf if none do."""
        left = error**2 - self.bias**2
        return self.noise / left if left > 0 else math.inf


class TunedChoice(NamedTuple):
    """The setting chosen and what is expected of it."""

    setting: Setting
    photons: int  # at rest
    frame: int  # photons of a frame while something moves
    error: float  # at rest, where the mobiles change something
    moving_error: float  # the same while something moves
    seconds: float  # [s] a frame of `frame` photons
    met: bool  # whether the time or the error asked for is kept


def law_of(trial: Trial) -> Law:
    """Return what fits a trial best, in least squares of squared errors and of times."""
    inverse = 1 / trial.photons
    noise, bias2 = _line(inverse, trial.alone)
    apart = inverse - inverse[-1]
    more = trial.moving - trial.alone[-1]
    moving = max(float((apart * more).sum() / max((apart * apart).sum(), 1e-300)), 0.0) if len(apart) > 1 else noise
    slope, start = _line(trial.photons.astype(float), trial.seconds)
    if slope == 0:  # all as fast as the slowest: something else took the time
        slope, start = float(trial.seconds[-1] / trial.photons[-1]), 0.0
    return Law(trial.setting, noise, moving, math.sqrt(bias2), start, slope)


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return slope and intercept, both >= 0, of the line nearest to points in relative distance."""
    if len(x) == 1:
        return float(y[0] / x[0]), 0.0
    weight = 1 / np.maximum(y, 1e-3 * max(float(y.max()), 1e-30))
    columns = np.stack([x, np.ones(len(x))], axis=1) * weight[:, None]
    (slope, intercept), *_ = np.linalg.lstsq(columns, y * weight, rcond=None)
    if slope < 0:
        return 0.0, float(np.average(y, weights=weight))
    if intercept < 0:
        return float((columns[:, 0] * y * weight).sum() / (columns[:, 0] ** 2).sum()), 0.0
    return float(slope), float(intercept)


def between_radii(laws: Sequence[Law]) -> tuple[list[Law], dict[str, dict[str, float]]]:
    """Return laws at FINE radii for estimators tried at several, the other laws as they are; and exponents.

    exponents: by estimator, as over_radii() returns them.
    """
    made: list[Law] = []
    exponents = {}
    for name in dict.fromkeys(law.setting.estimator for law in laws):
        own = [law for law in laws if law.setting.estimator == name]
        if len({law.setting.radius for law in own}) > 1:
            own, exponents[name] = over_radii(own)
        made += own
    return made, exponents


def over_radii(laws: Sequence[Law]) -> tuple[list[Law], dict[str, float]]:
    """Return laws at FINE radii between those of `laws` (one a radius), and the exponent of the radius in each part."""
    if len(laws) < 2:
        return list(laws), {}
    tried = np.log([law.setting.radius for law in laws])
    fine = np.linspace(tried.min(), tried.max(), FINE)
    parts, exponents = {}, {}
    for name, letter in EXPONENTS.items():
        values = np.log(np.maximum([getattr(law, name) for law in laws], LEAST[name]))
        exponents[letter], level = (float(v) for v in np.polyfit(tried, values, 1))
        parts[name] = np.exp(level + exponents[letter] * fine)
    setting = laws[0].setting
    made = [
        Law(setting._replace(radius=float(f"{math.exp(r):.3g}")), **{name: float(v[i]) for name, v in parts.items()})
        for i, r in enumerate(fine)
    ]
    return made, exponents


def within_time(laws: Sequence[Law], seconds: float, photons: int) -> TunedChoice:
    """Choose the least error of a moving frame that takes no longer, with `photons` at rest."""

    def found(law: Law) -> TunedChoice:
        room = law.photons_within(seconds)
        return _choice(law, photons, min(max(room, FEWEST), photons), room >= FEWEST)

    return max(map(found, laws), key=lambda choice: (choice.met, -choice.moving_error))


def within_error(laws: Sequence[Law], error: float, seconds: float, most: int) -> TunedChoice:
    """Choose the least time of a frame of all photons with no more error, or the least error of `most` photons.

    seconds: what a frame may take while something moves, with as many of the photons as fit.
    """
    most = min(most, MAX_PHOTONS)

    def found(law: Law) -> TunedChoice:
        needed = law.photons_for(error)
        photons = max(math.ceil(min(needed, most)), FEWEST)
        return _choice(law, photons, min(max(law.photons_within(seconds), FEWEST), photons), needed <= most)

    def order(pair: tuple[Law, TunedChoice]) -> tuple:
        law, choice = pair
        return choice.met, -law.seconds(choice.photons) if choice.met else -choice.error

    return max(((law, found(law)) for law in laws), key=order)[1]


def _choice(law: Law, photons: int, frame: float, met: bool) -> TunedChoice:
    return TunedChoice(
        law.setting, int(photons), int(frame), law.error(photons), law.error(photons, frame), law.seconds(frame), met
    )

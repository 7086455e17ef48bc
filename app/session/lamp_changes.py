"""Changes of the lamps in the settings: the levels that are due, at once or in a cross-fade."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from app.settings import Settings

if TYPE_CHECKING:
    from gi_core.lights.emission import Emitters

FADE = 1.0  # s of a cross-fade between light scenes
MUCH = 4.0  # times the flux of the lamps: two stops

Levels = dict[str, tuple[float, float, float]]


class LampChanges:
    """Levels of an open scene's lamps follow its settings."""

    def __init__(self, settings: Settings, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.held = False  # the panel holds a lamp's slider
        self._followed = settings.lamps, settings.solo  # in the light on show, or asked for
        self._start: tuple[Mapping[str, Sequence[float]], float] | None = None  # of a cross-fade: levels, and time

    def adopt(self, settings: Settings) -> None:
        """Begin with the light of a solver of these settings; it knows no solo."""
        self._followed = settings.lamps, ""

    def fade(self, shown: Mapping[str, Sequence[float]]) -> None:
        """Reach the next levels within FADE, from those on show, (3,) by lamp."""
        self._start = shown, self._clock()

    def due(self, settings: Settings, names: Sequence[str]) -> Levels | None:
        """Return the levels for this frame, None where the light has them."""
        asked = settings.lamps, settings.solo
        if self._start is None and asked == self._followed:
            return None
        self._followed = asked
        levels = {name: level for name, level in settings.levels(names).items() if name in names}  # the others: removed
        if self._start is not None:
            shown, since = self._start
            t = min((self._clock() - since) / FADE, 1.0)
            levels = {n: _between(shown[n], level, t) for n, level in levels.items()}
            self._start = self._start if t < 1 else None
        return levels


def _between(start: Sequence[float], end: Sequence[float], t: float) -> tuple[float, float, float]:
    r, g, b = ((1 - t) * x + t * y for x, y in zip(start, end, strict=True))
    return r, g, b


def changes_exposure(emitters: Emitters, was: Settings, now: Settings) -> bool:
    """Return whether the light needs another exposure: of one lamp alone, or MUCH more or less flux."""
    from gi_core.geometry.error import luminance

    fluxes = []
    for levels in (was.levels(emitters.lamps.names), now.levels(emitters.lamps.names)):
        lit = [flux * levels[name] for name, flux in zip(emitters.lamps.names, emitters.flux_of_lamps, strict=True)]
        fluxes.append(float(luminance(sum(lit))))
    return now.solo != was.solo or max(fluxes) > MUCH * min(fluxes) > 0

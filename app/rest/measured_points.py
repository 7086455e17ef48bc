"""Points of the error chart: settings with measured error and frame time."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from gi_core.estimators.setting import Setting

MOST_POINTS = 200


class MeasuredPoint(NamedTuple):
    """A setting and its measurement at rest."""

    setting: Setting
    photons: int
    seconds: float  # of a GI frame of all photons
    error: float  # relative, l1, total
    reference_noise: float  # of the reference

    @property
    def label(self) -> str:
        """Return the setting, one line per field."""
        s = self.setting
        lines = [s.estimator.replace("_", " "), f"{self.photons:,} photons", f"radius {s.radius:.3g} m"]
        for name, value in s._asdict().items():
            if name not in ("estimator", "radius") and value not in (False, None):
                lines.append(name if value is True else f"{name} {value}")
        return "\n".join(lines)


class MeasuredPoints:
    """One point per setting, the newest."""

    def __init__(self) -> None:
        self.all: tuple[MeasuredPoint, ...] = ()  # oldest first
        self._newest: MeasuredPoint | None = None

    def add(self, point: MeasuredPoint | None) -> None:
        """Add the newest point; the same again, or None, changes nothing."""
        if point is not None and point is not self._newest:
            self._newest = point
            self.all = (*[p for p in self.all if p[:2] != point[:2]][-MOST_POINTS + 1 :], point)

    def clear(self) -> None:
        self.all = ()

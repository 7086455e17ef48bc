"""Settings measured so far, each with its error and the time of its frames: the points of the chart."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from gi_core.estimators.setting import Setting

KEPT = 200


class MeasuredPoint(NamedTuple):
    """A setting, as measured at rest."""

    setting: Setting
    photons: int
    seconds: float  # of a GI frame of all photons
    error: float  # relative, l1, total
    truth_noise: float  # of the reference that it was measured against

    @property
    def label(self) -> str:
        """Return a line for each thing that makes this setting what it is."""
        s = self.setting
        photons = f"{self.photons:,} photons".replace(",", " ")
        lines = [s.estimator.replace("_", " "), photons, f"radius {s.radius:.3g} m"]
        for name, value in s._asdict().items():
            if name not in ("estimator", "radius") and value not in (False, None):
                lines.append(name if value is True else f"{name} {value}")
        return "\n".join(lines)


class MeasuredPoints:
    """One entry a setting: measured again, it is replaced. Read by the window's thread, added to by the solver's."""

    def __init__(self) -> None:
        self.all: tuple[MeasuredPoint, ...] = ()  # oldest first

    def add(self, point: MeasuredPoint) -> None:
        others = [p for p in self.all if p[:2] != point[:2]]
        self.all = (*others[-KEPT + 1 :], point)

    def clear(self) -> None:
        self.all = ()

"""Results of work at rest: immutable records, made on the solver's thread and read by the window."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from app.draw.draw_mesh import DrawMesh
from app.rest.calculation_surface import SurfaceLight
from app.rest.hold import HeldResult
from app.settings import Pin
from gi_core.display.dilation import Drawn
from gi_core.display.fine_points import FineLight
from gi_core.estimators.base import Setting
from gi_core.gather.origins import Origins


class GatherProgress(NamedTuple):
    """Progress of gathered light."""

    fraction: float = 0.0  # 0 .. 1
    error: float = math.inf  # relative l1, bias included; inf: unknown
    used: bool = False  # the picture shows it


class Report(NamedTuple):
    """Error of the light, relative l1; nan: unknown."""

    total: float  # without the reference's noise; nan while that hides it
    noise: float
    bias: float
    clouds: tuple[float, float]  # local deviation, median and 90th percentile
    reference_noise: float
    receivers: int  # in the measurement
    of: int  # receivers in all
    paths: float  # of the reference, per receiver
    done: bool  # the reference has little enough noise


class MeasuredPoint(NamedTuple):
    """A point of the error chart: a setting and its measurement at rest."""

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


class ReferencePicture(NamedTuple):
    """The reference at all receivers and the poses of the light."""

    drawn: Drawn  # irradiance nan where unknown
    noise: float  # relative l1
    paths: float  # per receiver, on average
    seen: float  # share of receivers with at least one round, 0 .. 1


class Change(NamedTuple):
    """The change since light A; both lights are of the same photons and paths."""

    before: np.ndarray  # (R, 3) [W/m2], light A
    now: np.ndarray  # (R, 3) [W/m2]
    deviation: np.ndarray  # (R,) [W/m2], standard error of the change of luminance; nan: unknown


class FinePicture(NamedTuple):
    """Fine points of the picture."""

    light: FineLight  # of the frame
    meshes: tuple[DrawMesh, ...]  # of all objects, with these points


class Asked(NamedTuple):
    """The light at a pin by its origins."""

    pin: Pin
    origins: Origins
    is_current: bool  # False: the light has changed since


class RestResults(NamedTuple):
    """Results for the light of one snapshot."""

    gathered: GatherProgress  # of the static part
    error: float = math.nan  # of the light on show, as it states itself: Solver.error; nan: unknown
    at_poses: GatherProgress | None = None  # with mobiles in place; None: not begun
    report: Report | None = None
    point: MeasuredPoint | None = None  # of the error chart
    reference: ReferencePicture | None = None  # None: unknown or not wanted
    surfaces: tuple[SurfaceLight, ...] = ()  # those that are measured so far
    fine: FinePicture | None = None  # None: the picture has receivers alone
    held: HeldResult | None = None  # None: lamps hold no targets
    finding: float = 0.0  # share of the search for levels that is done
    asked: Asked | None = None  # None: no pin is asked, or nothing is known yet
    change: Change | None = None  # since light A; None: not asked for, not known yet, or of another scene

    def looks_like(self, other: RestResults) -> bool:
        """Return whether both change a picture in the same way."""
        names = "reference", "change"
        return all(getattr(self, name) is getattr(other, name) for name in names)


class MeasuredPoints:
    """One point per setting, the newest."""

    def __init__(self) -> None:
        self.all: tuple[MeasuredPoint, ...] = ()  # oldest first
        self._newest: MeasuredPoint | None = None

    def add(self, point: MeasuredPoint | None) -> None:
        """Add the newest point; the same again, or None, changes nothing."""
        if point is not None and point is not self._newest:
            self._newest = point
            self.all = (*[p for p in self.all if p[:2] != point[:2]][-199:], point)

    def clear(self) -> None:
        self.all = ()

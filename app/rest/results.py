"""Results of work at rest: immutable records, made on the solver's thread and read by the window."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np

    from app.rest.measured_points import MeasuredPoint
    from app.rest.measuring_plane import PlaneLight
    from gi_core.display.dilation import Drawn


class GatherProgress(NamedTuple):
    """Progress of gathered light."""

    fraction: float = 0.0  # 0 .. 1
    error: float = math.inf  # relative l1, bias included; inf: unknown
    used: bool = False  # the picture shows it


class Report(NamedTuple):
    """Error of the light, relative l1; nan: unknown."""

    total: float
    noise: float
    bias: float
    reference_noise: float
    receivers: int  # in the measurement
    of: int  # receivers in all
    paths: float  # of the reference, per receiver
    done: bool  # the reference has little enough noise


class ReferencePicture(NamedTuple):
    """The reference at all receivers and the poses of the light."""

    drawn: Drawn  # irradiance nan where unknown
    noise: float  # relative l1
    paths: float  # per receiver, on average
    seen: float  # share of receivers with at least one round, 0 .. 1


class Comparison(NamedTuple):
    """The same light by another estimator."""

    estimator: str
    photons: int
    irradiance: np.ndarray  # (R, 3) [W/m2]
    drawn: Drawn


class RestResults(NamedTuple):
    """Results for the light of one snapshot."""

    gathered: GatherProgress  # of the static part
    at_poses: GatherProgress | None = None  # with mobiles in place; None: not begun
    report: Report | None = None
    point: MeasuredPoint | None = None  # of the error chart
    reference: ReferencePicture | None = None  # None: unknown or not wanted
    comparison: Comparison | None = None
    plane: PlaneLight | None = None  # None: not wanted, or not yet known

    def looks_like(self, other: RestResults) -> bool:
        """Return whether both change a picture in the same way."""
        return self.reference is other.reference and self.comparison is other.comparison

"""The frame on show and the results at rest that belong to it: all that the window reads of a solver."""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np

    from app.rest.results import RestResults
    from app.rest.scheduler import RestWork
    from gi_core.discs.stale_receivers import ControlFacts
    from gi_core.display.dilation import Drawn
    from gi_core.estimators.base import Setting
    from gi_core.frames.frame import Changes
    from gi_core.gather.estimate import Source
    from gi_core.gloss.light import GlossLight
    from gi_core.scene import Pose
    from gi_core.solver import Solver


class Snapshot(NamedTuple):
    """Poses and the light that belongs to them. The arrays are never written to again."""

    poses: dict[str, Pose]
    irradiance: np.ndarray  # (R, 3) [W/m2]
    drawn: Drawn  # the same for pictures, with dilation weights
    gloss: GlossLight | None  # directions of the light at glossy receivers; None: there are none
    deviation: np.ndarray | None  # (R,) [W/m2], as of Solver.deviation; None in motion
    source: Source  # of the light of the static part; photons change it
    photons: int
    photons_at_rest: int
    paths: int  # per receiver of mobiles
    paths_at_rest: int
    setting: Setting
    timings: Mapping[str, float]  # stage -> seconds, of the last move
    changes: Changes
    levels: np.ndarray  # (G, 3), of the lamps
    effective_photons: int  # of `photons`
    probes: dict[str, np.ndarray]  # name -> irradiance (3,)
    segments: int
    control: ControlFacts
    search_summary: str
    rest: RestResults

    @property
    def partial(self) -> bool:
        """Whether the frame has fewer photons or paths than at rest."""
        fewer = self.photons < self.photons_at_rest or self.paths < self.paths_at_rest
        return self.photons > 0 and fewer  # before the first frame a move changes nothing


def snapshot_of(s: Solver, work: RestWork) -> Snapshot:
    """Return the snapshot of a solver's frame; call it on the solver's thread."""
    return Snapshot(
        poses=dict(s.poses),
        irradiance=s.irradiance,
        drawn=s.drawn(s.irradiance),
        gloss=s.frame.gloss,
        deviation=None if s.frame.photons < max(s.frame.subsets, default=0) else s.deviation,
        source=s.frame_light.source,
        photons=s.frame.photons,
        photons_at_rest=max(s.frame.subsets, default=s.frame.photons),
        paths=s.frame.paths,
        paths_at_rest=s.paths_at_rest,
        setting=s.setting,
        timings=s.frame.timings,
        changes=s.frame.changes,
        levels=s.frame.levels,
        effective_photons=s.frame.effective_photons,
        probes=s.frame.probe_irradiance,
        segments=s.frame.segments,
        control=s.frame.control_facts,
        search_summary=s.frame.search_summary,
        rest=work.results(),
    )


class MovingMedian:
    """The median of the last 31 displayed times, insensitive to one slow frame."""

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=31)

    def add(self, value: float) -> None:
        self._values.append(value)

    @property
    def value(self) -> float:
        return statistics.median(self._values) if self._values else 0.0

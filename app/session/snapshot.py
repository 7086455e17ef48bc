"""The frame on show: all that the window reads of a solver."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np

    from gi_core.discs.contact.stale_receivers import ControlFacts
    from gi_core.display.dilation import Drawn
    from gi_core.scene import Pose
    from gi_core.solver import Changes, Solver


class Snapshot(NamedTuple):
    """Poses and the light that belongs to them. The arrays are never written to again."""

    poses: dict[str, Pose]
    irradiance: np.ndarray  # (R, 3) [W/m2]
    drawn: Drawn  # the same for pictures, with dilation weights
    photons: int
    photons_at_rest: int
    paths: int  # per receiver of mobiles
    paths_at_rest: int
    estimator: str
    radius: float  # [m]
    neighbours: int
    timings: dict[str, float]  # stage -> seconds, of the last move
    changes: Changes
    probes: dict[str, np.ndarray]  # name -> irradiance (3,)
    segments: int
    control: ControlFacts
    search_summary: str

    @property
    def partial(self) -> bool:
        """Whether the frame has fewer photons or paths than at rest."""
        return self.photons < self.photons_at_rest or self.paths < self.paths_at_rest


def snapshot_of(s: Solver) -> Snapshot:
    """Return the snapshot of a solver's frame; call it on the solver's thread."""
    return Snapshot(
        poses=dict(s.poses),
        irradiance=s.irradiance,
        drawn=s.as_drawn(s.irradiance),
        photons=s.photons_traced,
        photons_at_rest=max(s.prefixes, default=s.photons_traced),
        paths=s.paths_gathered,
        paths_at_rest=s.paths_at_rest,
        estimator=s.estimator,
        radius=s.radius,
        neighbours=s.neighbours,
        timings=s.timings,
        changes=s.changes,
        probes=s.probe_irradiance,
        segments=s.segments_total,
        control=s.control_facts,
        search_summary=s.search_summary,
    )

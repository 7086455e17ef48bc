"""What the panel tells beside the settings; everything is measured elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.rest.live_error import Report
    from app.rest.measured_points import MeasuredPoint
    from app.rest.static_job import Gathered
    from app.session.reload import Succession
    from app.session.session import Session
    from gi_core.discs.contact.stale_receivers import ControlFacts


@dataclass(frozen=True)
class Facts:
    """One frame's."""

    estimators: Mapping[str, str]  # key -> what it is
    scene_size: float  # [m]
    photometric: bool
    gi_seconds: float
    frame_seconds: float
    timings: Mapping[str, float]  # stage -> seconds
    photons_shown: int  # that the picture is made of
    photons_traced: int  # that it is made of at rest
    photons_goal: int
    paths_shown: int  # that a vertex of a mobile has gathered; 0: its light is the photons'
    moving: bool  # something is dragged or played
    segments: int
    control: ControlFacts  # whom artifact control concerns
    photons_cut: int
    old_segments: int
    new_segments: int
    triangles: int
    receivers: int
    mobiles: int
    playing: bool
    metered: float  # EV at load
    probes: Mapping[str, object] = field(default_factory=dict)  # name -> irradiance (3,)
    notes: tuple[str, ...] = ()
    report: Report | None = None  # of errors; None while nothing is known
    points: tuple[MeasuredPoint, ...] = ()  # settings tried
    gathered: Gathered | None = None  # how far the static light is; None: not asked for
    search_summary: str = ""  # what the disc search built; "" where there is none
    coming: tuple[str, float | None] | None = None  # what a scene that is being opened is at, and how far
    load_problem: str = ""  # why the last one could not be opened


def facts_of(
    session: Session,
    succession: Succession,
    estimators: Mapping[str, str],
    frame_seconds: float,
    metered: float,
) -> Facts:
    """Collect them from a session that is ready."""
    solver = session.solver
    told, appraisal = session.light.snapshot, session.appraisal
    report = appraisal.report if appraisal is not None else None
    return Facts(
        estimators=estimators,
        scene_size=solver.scene_size,
        photometric=solver.scene.units == "photometric",
        gi_seconds=session.light.gi_seconds.value,
        frame_seconds=frame_seconds,
        timings=told.timings,
        photons_shown=session.light.photons_shown,
        photons_traced=session.light.photons_there,
        photons_goal=solver.photons,
        paths_shown=session.light.paths_shown,
        moving=session.dragging or session.playing,
        segments=told.segments,
        control=told.control,
        photons_cut=told.changes.photons_cut,
        old_segments=told.changes.old_segments,
        new_segments=told.changes.new_segments,
        triangles=sum(len(mesh.triangles) for mesh in session.meshes),
        receivers=len(solver.irradiance),
        mobiles=len(solver.scene.mobiles),
        playing=session.playing,
        metered=metered,
        probes=told.probes,
        notes=solver.scene.notes,
        report=report if report is not None and report.version == session.light.version else None,
        points=appraisal.points.all if appraisal is not None else (),
        gathered=session.gathering.told if solver.light == "best" else None,
        search_summary=solver.search_summary,
        coming=succession.told,
        load_problem=succession.problem,
    )

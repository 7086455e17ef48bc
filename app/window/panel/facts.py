"""The numbers of a frame that the panel shows beside the settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from app.draw.false_colour import Scale
    from app.draw.readout import Pinned
    from app.rest.measured_points import MeasuredPoint
    from app.rest.measuring_plane import Level, PlaneLight
    from app.rest.results import GatherProgress, Report
    from app.session.lights import LightId
    from app.session.reload import Reload
    from app.session.session import Session
    from app.settings import LampSetting
    from gi_core.discs.contact.stale_receivers import ControlFacts
    from gi_core.scene import Pose
    from gi_core.scene.types import Light


@dataclass(frozen=True)
class Facts:
    """Numbers of one frame."""

    estimators: Mapping[str, str]  # key -> description
    scene_size: float  # [m]
    photometric: bool
    gi_seconds: float
    frame_seconds: float
    timings: Mapping[str, float]  # stage -> seconds
    photons_shown: int  # in the current picture
    photons_traced: int  # in the picture at rest
    photons_goal: int
    photons_chosen: int  # by the scene, or --photons
    paths_shown: int  # per mobile vertex; 0: photons light the mobiles
    segments: int
    control: ControlFacts
    photons_cut: int
    old_segments: int
    new_segments: int
    triangles: int
    receivers: int
    mobiles: tuple[str, ...]  # names
    poses: Mapping[str, Pose]
    selection: tuple[str, ...]  # names of objects, the last selected one last
    playing: bool
    moving: bool  # objects are in motion, or their light is
    refined: float  # share of the photons at the settings asked for; below 1 the picture may be that of earlier ones
    all_done: bool  # no work is left at rest
    metered: float  # EV at load
    lamps: tuple[str, ...]  # names
    light_scenes: Mapping[str, tuple[LampSetting, ...]]  # by name, the scene file's and those kept
    lamp_flux: tuple[float, ...]  # of each at full level, luminance [W], or [lm] in photometric scenes
    lamp_colours: tuple[tuple[float, float, float], ...]  # of each in the scene file, of luminance 1
    effective: int  # photons of equal flux that would have as little noise
    probes: Mapping[str, np.ndarray] = field(default_factory=dict)  # name -> irradiance (3,)
    pinned: tuple[Pinned, ...] = ()  # light at the pins
    level: Level | None = None  # for measuring planes
    plane: PlaneLight | None = None  # None: not yet known
    notes: tuple[str, ...] = ()
    report: Report | None = None  # of errors; None until measured
    points: tuple[MeasuredPoint, ...] = ()  # of the error chart
    gathered: GatherProgress | None = None  # progress of the static light; None: photons only
    at_poses: GatherProgress | None = None  # progress of the light at these poses; None: not begun
    scale: Scale | None = None  # of false colours on show
    search_summary: str = ""  # size of the disc search's index; "": the estimator has none
    loading: tuple[str, float | None] | None = None  # phase and fraction of the scene being opened
    load_problem: str = ""  # of the last scene that failed to open
    surface: str = ""  # the mobile selected, or the material clicked; "": none
    parts: tuple[str, ...] = ()  # of that mobile, by material; () for a material of the static part
    part: str = ""  # the one clicked, else the first
    material: tuple[tuple[str, Any], ...] = ()  # of that surface or part, as `gi_core.files.edits.Finish` has it
    darkened: str = ""  # where and why its model is darkened in the scene on show
    textured: bool = False  # its colour is a texture, or several colours
    glossy: bool = False  # a face of the scene has gloss
    piece: bool = False  # a place of the static part has been clicked
    lights: Mapping[LightId, Light] = field(default_factory=dict)
    lamp: LightId | None = None  # the selected one, by one of its lights; one of surfaces has none
    light_file: str = ""  # photometric, of that light by an edit
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)

    @property
    def selected(self) -> str:
        """The object selected last, "" for none."""
        return self.selection[-1] if self.selection else ""


def facts_of(
    session: Session,
    reload: Reload,
    estimators: Mapping[str, str],
    frame_seconds: float,
    metered: float,
    scale: Scale | None = None,
    selection: tuple[str, ...] = (),
    pinned: tuple[Pinned, ...] = (),
    clicked: str = "",
    part: str = "",
    lamp: LightId | None = None,
) -> Facts:
    """Return the facts of a ready session.

    clicked: the material of the static part clicked last, "" for none; part: that of a mobile; lamp: the selected one.
    """
    from app.draw.kelvin import of_luminance_one
    from gi_core.geometry.error import luminance

    snapshot, emitters = session.light.snapshot, session.model.emitters
    surface = clicked or (selection[-1] if selection else "")
    parts = () if clicked or not surface else session.parts_of(surface)
    part = part if part in parts or not parts else parts[0]
    finish = session.finish_of(surface, bool(clicked), part if parts else "")
    return Facts(
        estimators=estimators,
        scene_size=session.chosen.scene_size,
        photometric=session.scene.units == "photometric",
        gi_seconds=session.light.gi_seconds.value,
        frame_seconds=frame_seconds,
        timings=snapshot.timings,
        photons_shown=snapshot.photons,
        photons_traced=snapshot.photons_at_rest,
        photons_goal=session.settings.photons,
        photons_chosen=max(session.chosen.photons, 1),
        paths_shown=snapshot.paths,
        segments=snapshot.segments,
        control=snapshot.control,
        photons_cut=snapshot.changes.photons_cut,
        old_segments=snapshot.changes.old_segments,
        new_segments=snapshot.changes.new_segments,
        triangles=sum(len(mesh.triangles) for mesh in session.meshes),
        receivers=len(snapshot.irradiance),
        glossy=snapshot.gloss is not None,
        mobiles=tuple(m.name for m in session.scene.mobiles),
        poses=session.poses,
        selection=selection,
        playing=session.playing,
        moving=session.playing or session.dragging or session.light.is_moving or session.light.partial,
        refined=session.refined,
        all_done=session.light.all_done and not session.refining,
        metered=metered,
        lamps=emitters.lamps.names,
        light_scenes={
            **{s.name: tuple(LampSetting(*lamp) for lamp in s.levels) for s in session.scene.light_scenes},
            **dict(session.settings.light_scenes),
        },
        lamp_flux=tuple(float(f) for f in luminance(emitters.flux_of_lamps)),
        lamp_colours=tuple(of_luminance_one(flux) for flux in emitters.flux_of_lamps),
        effective=snapshot.effective_photons,
        probes=snapshot.probes,
        pinned=pinned,
        level=session.level,
        plane=snapshot.rest.plane,
        notes=session.scene.notes,
        report=snapshot.rest.report,
        points=session.points.all,
        gathered=snapshot.rest.gathered if session.settings.of_solver["light"] == "best" else None,
        at_poses=snapshot.rest.at_poses,
        scale=scale,
        search_summary=snapshot.search_summary,
        loading=reload.progress,
        load_problem=reload.problem,
        surface=surface,
        parts=parts,
        part=part if parts else "",
        material=finish.values,
        darkened=finish.darkened,
        textured=finish.textured,
        piece=bool(clicked),
        lights=session.lights,
        lamp=lamp,
        light_file=session.file_of(lamp) if lamp is not None else "",
        up=session.scene.up,
    )

"""Settings: one frozen record that the command line, the panel and the commands share.

Only the standard library is imported at the top, so that `--help` and `--version` stay instant.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from gi_core.files.edits import Edit
    from gi_core.frames.background import Photons
    from gi_core.scene import Pose, Scene
    from gi_core.solver import Solver

SOLVER_SETTINGS = (
    "estimator", "photons", "radius", "neighbours", "control", "search", "border_correction", "textbook",
    "light", "gloss",
)  # fmt: skip
UNITS = ("photometric", "radiometric")  # those of gi_core.scene.Scene
LIGHTS = ("best", "photons")  # those of gi_core.frames.light_setting
GLOSS = ("quadtree", "list", "all_rays")  # those of gi_core.gloss.source
REFERENCE = "reference"  # beside estimators, a choice of the wipe
TONE_MAPS = ("aces", "reinhard", "clip")
ILLUMINANCE = "illuminance"
LUMINANCE = "luminance"
FALSE_COLOURS = ILLUMINANCE, LUMINANCE
SHOWS = ("radiance", "irradiance", *FALSE_COLOURS)
POINTED, CLICKED = "pointed", "clicked"  # the ray under the cursor; that of the last click, which stays
ERROR_RANGES = (0.1, 0.3, 1.0)
ERRORS = "error"  # one more in the window: needs the reference, see app/rest/live_error.py
SIZE = (1280, 800)
MOST_PIXELS = 16384  # per side of a picture
BUDGET = 16.0  # [ms]: 60 frames per second
PICTURE_SCALES = (1, 2, 4)
SECONDS = 20.0  # for gathering light before a picture without a window
STEP = 0.015  # of the scene size: motion of a mobile per timed frame, as in the report


class LampSetting(NamedTuple):
    """Level of a lamp: its light is that of the scene file times `dim` and `colour`."""

    name: str
    dim: float = 1.0
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    on: bool = True


class Pin(NamedTuple):
    """A read-out pinned to a point of a surface."""

    name: str
    position: tuple[float, float, float]  # [m], in the scene, or in the space of `object`
    normal: tuple[float, float, float]  # of the side that is read
    object: str = ""  # a mobile; "": the static part


class MeasuringPlane(NamedTuple):
    """A horizontal grid of points; see `app.rest.measuring_plane`."""

    low: tuple[float, float]  # [m] along the two horizontal axes
    high: tuple[float, float]
    height: float  # [m] above the floor
    points: tuple[int, int] | None = None  # along the two axes; None: by EN 12464-1


class UsageError(ValueError):
    """A wrong value on the command line that only the loaded program can detect (exit code 2)."""


@dataclass(frozen=True)
class Settings:
    """Settings by group, as `--help` shows them. None: the scene file decides, else `gi_core.defaults.choose`."""

    # Scene
    scene: str = "cornell"  # a shipped name, a scene file (.toml) or a mesh file
    mobiles: tuple[str, ...] = ()  # mesh files that become mobiles
    poses: tuple[tuple[str, tuple[float, ...]], ...] = ()  # (mobile, 3 or 7 numbers: x y z [w x y z])
    edits: tuple[Edit, ...] = ()  # of the scene, in order, see gi_core.files.edits
    camera: tuple[float, ...] | None = None  # eye, target [m], vertical field of view [degrees]; None: the scene's
    max_edge: float | None = None  # edges longer than this are split [m]
    up: str | None = None  # "x", "y" or "z"
    units: str | None = None  # one of UNITS: those in which the numbers of the files are read
    allow_outside: bool = False  # the scene may name files outside its folder
    document: str = ""  # the saved scene that these settings come from and are saved to; "": none

    # Light
    estimator: str | None = None  # a key of gi_core.estimators.ESTIMATORS
    photons: int | None = None
    radius: float | None = None  # [m]
    neighbours: int | None = None
    control: bool = True  # artifact control of tangent_plane, see gi_core/discs/region.py
    border_correction: bool = True  # photon_map at borders: alpha / 2 pi of a disc
    textbook: bool = False  # photon_map counts the k-th hit too
    search: str = "disc_index"  # a key of gi_core.discs.search.SEARCHES; pictures do not depend on it
    light: str | None = None  # one of LIGHTS; None: see `light_chosen`
    gloss: str = "quadtree"  # one of GLOSS: how rays at glossy receivers are kept
    rays: str | None = None  # a key of gi_core.rays.structures.STRUCTURES; None: embree, else bvh
    seed: int = 0
    lamps: tuple[LampSetting, ...] = ()  # those that differ from the scene file
    solo: str = ""  # the only lamp that is on; "": all that are on
    light_scenes: tuple[tuple[str, tuple[LampSetting, ...]], ...] = ()  # by name, besides the scene file's

    # Picture
    size: tuple[int, int] = SIZE  # pixels
    exposure: float | None = None  # [EV]; None: metered once
    white_balance: bool = True  # the light of the lamps is drawn neutral
    tone_map: str = "aces"  # one of TONE_MAPS
    show: str = "radiance"  # one of SHOWS: with reflectance, E / pi alone, false colours; in the window ERRORS too
    illuminance_range: tuple[float, float] | None = None  # of the false colours [lx or W/m2]; None: of the view
    luminance_range: tuple[float, float] | None = None  # the same [cd/m2 or W/m2/sr]
    isolines: tuple[float, ...] | None = None  # of illuminance [lx or W/m2]; (): at round values; None: without
    error_range: float | None = None  # ends of the error map, relative; None: of the view; see ERROR_RANGES
    cull: bool = True  # the backs of one-sided faces are not drawn: rooms can be seen from outside

    # Window
    reference: bool = False  # show the reference instead of the estimate
    compare: str = ""  # right side of the wipe: an estimator, REFERENCE, or nothing
    measure_errors: bool = True  # measure errors at rest
    cells: str = ""  # draw leaf cells of the structure of rays, and those on a ray: POINTED, CLICKED; "": none
    show_paths: bool = False  # draw paths of some photons
    show_disc: bool = False  # draw what the estimator counts at the receiver under the cursor
    show_recomputed: bool = False  # colour receivers by what the last frame computed again
    pins: tuple[Pin, ...] = ()  # read-outs
    cameras: tuple[tuple[str, tuple[float, ...]], ...] = ()  # bookmarks by name; numbers as of `camera`
    plane: MeasuringPlane | None = None  # None: nothing is measured
    picture_scale: int = 1  # times the viewport's pixels per side, of saved pictures; one of PICTURE_SCALES
    budget: float = BUDGET  # [ms] for light per frame in motion; 0: always all photons
    fallback: bool = True  # without a window, render to a file instead of failing

    @property
    def of_solver(self) -> dict[str, object]:
        """Settings of the solver. While two estimators are compared, each shows the light of its own photons."""
        values = {name: getattr(self, name) for name in SOLVER_SETTINGS}
        return values | {"light": "photons" if self.compare not in ("", REFERENCE) else self.light_chosen}

    def in_light_scene(self, lamps: tuple[LampSetting, ...]) -> Settings:
        """Return settings of these lamps; all others are as in the scene file."""
        return replace(self, lamps=tuple(lamp for lamp in lamps if lamp != LampSetting(lamp.name)), solo="")

    def without_solo(self, names: Iterable[str]) -> Settings:
        """Return settings of the same levels of these lamps, in which none is alone."""
        if not self.solo:
            return self
        given = {name: LampSetting(name) for name in names} | {lamp.name: lamp for lamp in self.lamps}
        lit = (lamp._replace(on=lamp.on and name == self.solo) for name, lamp in given.items())
        return replace(self, lamps=tuple(lit), solo="")

    def with_light_scene(self, name: str, names: Iterable[str]) -> Settings:
        """Return settings that keep the present levels of these lamps as a light scene."""
        now = self.without_solo(names).lamps
        return replace(self, light_scenes=tuple({**dict(self.light_scenes), name: now}.items()))

    def levels(self, names: Iterable[str]) -> dict[str, tuple[float, float, float]]:
        """Return the level per channel of each of these lamps, and of those that are set."""
        given = {name: LampSetting(name) for name in names} | {lamp.name: lamp for lamp in self.lamps}
        lit = {name: lamp.on and self.solo in ("", name) for name, lamp in given.items()}
        return {
            name: tuple(lamp.dim * c * lit[name] for c in lamp.colour)  # type: ignore[misc]
            for name, lamp in given.items()
        }

    @property
    def shows_radiance(self) -> bool:
        """Whether the picture has reflectance, textures and gloss: as radiance, or as false colours of luminance."""
        return self.show in ("radiance", LUMINANCE)

    @property
    def false_colour_range(self) -> tuple[float, float] | None:
        """Ends of the false colours on show; None: those of the view."""
        return self.luminance_range if self.show == LUMINANCE else self.illuminance_range

    @property
    def false_colour_lines(self) -> tuple[float, ...] | None:
        """Isolines on show: luminance has none, textures would tear them."""
        return self.isolines if self.show == ILLUMINANCE else None

    @property
    def light_chosen(self) -> str:
        """The light chosen by the user; by default "photons" if an estimator is chosen, else "best"."""
        return self.light or ("best" if self.estimator is None else "photons")

    @property
    def beside_estimate(self) -> set[str]:
        """Views beside or instead of the estimate: an estimator, REFERENCE."""
        needs_reference = self.reference or self.show == ERRORS
        return {self.compare} - {""} | ({REFERENCE} if needs_reference else set())


def open_scene(settings: Settings) -> Scene:
    """Return the edited scene with its mobiles at the poses of the settings. Raises SceneError."""
    from gi_core.files.edits import edited

    return as_asked(edited(read_scene(settings), settings.edits, settings.allow_outside), settings)


def read_scene(settings: Settings) -> Scene:
    """Return the scene without edits. Raises SceneError."""
    from gi_core.files.load import load_scene

    options = {name: getattr(settings, name) for name in ("max_edge", "up") if getattr(settings, name) is not None}
    scene = load_scene(settings.scene, mobiles=settings.mobiles, allow_outside=settings.allow_outside, **options)
    return replace(scene, units=settings.units or scene.units)


def of_files(settings: Settings) -> tuple:
    """Return the settings that read_scene() depends on."""
    s = settings
    return s.scene, s.mobiles, s.max_edge, s.up, s.allow_outside, s.units


def as_asked(scene: Scene, settings: Settings) -> Scene:
    """Return an edited scene with its camera and its mobiles as in the settings. Raises SceneError."""
    from gi_core.files.edits import removed_lamps
    from gi_core.lights.lamps import OTHERS
    from gi_core.scene import Camera
    from gi_core.scene.validate import check_lamp

    for name in settings.levels(()):  # before kernels compile
        if name != OTHERS and name not in removed_lamps(settings.edits):
            check_lamp(_place_of(settings, "lamps", name, scene.name), name, scene)
    poses = start_poses(settings, scene)
    if (c := settings.camera) is not None:
        scene = replace(scene, camera=Camera((c[0], c[1], c[2]), (c[3], c[4], c[5]), c[6]))
    return replace(scene, mobiles=tuple(m._replace(pose=poses.get(m.name, m.pose)) for m in scene.mobiles))


def open_moving_scene(settings: Settings) -> Scene:
    """Return open_scene(). Raises SceneError; UsageError for a scene without mobiles."""
    scene = open_scene(settings)
    if not scene.mobiles:
        raise UsageError(f"{settings.scene} has no mobile to move: add one with --mobile FILE")
    return scene


def start_poses(settings: Settings, scene: Scene) -> dict[str, Pose]:
    """Return poses by mobile, of `--pose`; without a quaternion the rotation in the scene is kept.

    Raises SceneError for a mobile that the scene does not have and for a pose that is not rigid.
    """
    from gi_core.scene import Pose, SceneError
    from gi_core.scene.pose import as_pose, four, three

    known = {m.name: m for m in scene.mobiles}
    poses = {}
    for name, numbers in settings.poses:
        if name not in known:
            there = ", ".join(known) or "none"
            where = _place_of(settings, "poses", name) or f"{scene.name}: --pose"
            raise SceneError(f'{where} names the mobile "{name}", but the mobiles of this scene are: {there}')
        quaternion = numbers[3:] or known[name].pose.quaternion
        place = _place_of(settings, "poses", name)
        poses[name] = as_pose(Pose(three(numbers[:3]), four(quaternion)), f"{place or '--pose'} {name}")
    return poses


def _place_of(settings: Settings, table: str, name: str, otherwise: str = "") -> str:
    """Return the table of the saved scene that has a name; `otherwise` where it stands on the command line."""
    from gi_core.files.formats.boundary import Boundary
    from gi_core.files.formats.toml_fields import read_toml
    from gi_core.scene import SceneError

    if document := settings.document:
        with suppress(SceneError):
            if name in read_toml(Path(document), document, Boundary(Path(document).parent)).get(table, {}):
                return f"{document}: [{table}]"
    return otherwise


def check_names(settings: Settings) -> None:
    """Raise UsageError for an unknown estimator, search or structure of rays. Default names need no import."""
    given = [(name, getattr(settings, name)) for name in ("estimator", "search", "rays")]
    if all(value in (None, getattr(Settings, name)) for name, value in given):
        return
    from gi_core.discs.search import SEARCHES
    from gi_core.estimators import ESTIMATORS
    from gi_core.rays.structures import STRUCTURES

    known_names: tuple[Mapping[str, object], ...] = ESTIMATORS, SEARCHES, STRUCTURES
    for (name, value), known in zip(given, known_names, strict=True):
        if value is not None and value not in known:
            raise UsageError(f'--{name} must be one of {", ".join(known)}, got "{value}"')


def make_solver(scene: Scene, settings: Settings, earlier: Photons | None = None, threads: int | None = None) -> Solver:
    """Return a solver for the scene; nothing is traced yet. Raises UsageError, SceneError for an unknown name.

    earlier: photons of the scene before its last edit; threads: None for one per core.
    """
    from gi_core.estimators import DEFAULT, ESTIMATORS
    from gi_core.files.edits import removed_lamps
    from gi_core.scene import SceneError
    from gi_core.solver import Solver

    check_names(settings)
    removed = removed_lamps(settings.edits)
    estimator = settings.estimator or scene.defaults.estimator or DEFAULT
    if estimator not in ESTIMATORS:
        raise SceneError(
            f'{scene.name}: [defaults]: estimator must be one of {", ".join(ESTIMATORS)}, got "{estimator}"'
        )
    return Solver(
        scene,
        estimator=estimator,
        photons=settings.photons,
        radius=settings.radius,
        neighbours=settings.neighbours,
        seed=settings.seed,
        threads=threads,
        control=settings.control,
        search=settings.search,
        border_correction=settings.border_correction,
        textbook=settings.textbook,
        light=settings.light_chosen,
        gloss=settings.gloss,
        lamps={name: level for name, level in settings.levels(()).items() if name not in removed},
        rays=settings.rays,
        earlier=earlier,
    )

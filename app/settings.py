"""Settings: the table of all of them, and one frozen record that the command line, the panel and the commands share.

A setting is one entry of a group below: its type, its default, its option, and the columns of `Row`. Options, saved
scenes, copied commands, resets, and the work after a change are read from there. Nothing at the top imports numpy, so
that `--help` and `--version` stay instant.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from app import values
from app.values import Pin
from gi_core.scene import Camera, Pose, Scene, SceneError
from gi_core.scene.types import CalculationSurface, LampLevel, LightScene

if TYPE_CHECKING:
    from gi_core.base.results import Results
    from gi_core.files.edits import Edit
    from gi_core.model import Model
    from gi_core.solver import Solver

UNITS = ("photometric", "radiometric")  # those of gi_core.scene.Scene
LIGHTS = ("best", "photons")  # those of gi_core.frames.light_setting
GLOSS = ("quadtree", "list", "all_rays")  # those of gi_core.frames.light_setting
TONE_MAPS = ("agx", "neutral", "aces", "reinhard", "clip")
DEFAULT_TONE_MAP = "agx"
ILLUMINANCE = "illuminance"
LUMINANCE = "luminance"
FALSE_COLOURS = ILLUMINANCE, LUMINANCE
SHOWS = ("radiance", "irradiance", *FALSE_COLOURS)
POINTED, CLICKED = "pointed", "clicked"  # the ray under the cursor; that of the last click, which stays
ERROR_RANGES = (0.1, 0.3, 1.0)
ERRORS = "error"  # one more in the window: needs the reference, see app/rest/live_error.py
CHANGE = "change"  # one more there: light since the kept one
BUDGET = 16.0  # [ms]: 60 frames per second
PICTURE_SCALES = (1, 2, 4)
SECONDS = 20.0  # for gathering light before a picture without a window
STEP_PER_FRAME = 0.015  # of the scene size: motion of a mobile per timed frame, as in the report
TOGETHER = "settings"  # the table of a saved scene with the settings that have none of their own


class State(NamedTuple):
    """What light depends on besides settings."""

    model: weakref.ref[Model]
    poses: tuple[tuple[str, Pose], ...]
    levels: tuple[tuple[float, ...], ...]  # (G, 3) of the lamps


class UsageError(ValueError):
    """A wrong value on the command line that only the loaded program can detect (exit code 2)."""


class Row(NamedTuple):
    """The columns of a setting besides its type and default."""

    option: Mapping[str, Any]  # arguments of argparse.add_argument; {}: the command line has none
    flag: str = ""  # the option, where it is not the name
    among: str = ""  # the registry of the names that it can be, imported for others than the default
    kept: str = ""  # the key of a saved scene that holds the value, TOGETHER for most; "": none does
    counts: bool = True  # the window asks to save a change
    of_scene: bool = False  # another scene resets it
    resets: bool = True  # *Reset settings* resets it
    reads: bool = False  # a change reads the scene again
    recolours: bool = False  # a change needs new colours of vertices, or new read-outs


def unlisted(default: Any, **columns: Any) -> Any:
    """Return a setting without an option."""
    return field(default=default, metadata={"row": Row({}, **columns)})


def option(default: Any, kind: Callable | None, metavar: str, help: str, flag: str = "", **columns: Any) -> Any:
    """Return a setting with an option; kind: makes its value of text. One with a flag of its own may be repeated."""
    of = {"type": kind, "metavar": metavar, "help": help} | ({"action": "append"} if flag else {})
    return field(default=default, metadata={"row": Row(of, flag, **{"kept": TOGETHER, **columns})})


def choice(default: Any, choices: tuple[str, ...], help: str, **columns: Any) -> Any:
    """Return a setting with an option that is one of some words."""
    of = {"choices": choices, "help": help}
    return field(default=default, metadata={"row": Row(of, **{"kept": TOGETHER, **columns})})


def switch(default: bool | None, help: str, **columns: Any) -> Any:
    """Return a setting with an option that switches it off, or on."""
    of = {"action": "store_false" if default else "store_true", "help": help}
    return field(default=default, metadata={"row": Row(of, **{"kept": TOGETHER, **columns})})


OF_SCENE: dict[str, Any] = {"of_scene": True, "resets": False}  # columns of settings that belong to a scene
PLACED: dict[str, Any] = {**OF_SCENE, "counts": False}  # the window compares poses and edits itself


# None: the scene file decides, else `gi_core.defaults.choose`.


@dataclass(frozen=True)
class Source:
    """The scene: its files, and the changes after these were read."""

    scene: str = unlisted(  # a shipped name, a scene file (.toml) or a mesh file
        "cornell", kept="scene", resets=False, reads=True
    )
    mobiles: tuple[str, ...] = option(
        (), None, "FILE", "mesh file that becomes a mobile", "mobile", kept="mobiles", resets=False, reads=True
    )
    poses: tuple[tuple[str, tuple[float, ...]], ...] = option(  # (mobile, 3 or 7 numbers: x y z [w x y z])
        (), values.pose, "NAME=x,y,z[,qw,qx,qy,qz]",
        "position of a mobile's origin [m]: that of its mesh in a scene file, the middle of its foot of --mobile FILE; "
        "without a unit quaternion its rotation stays", "pose", kept="poses", **PLACED,
    )  # fmt: skip
    edits: tuple[Edit, ...] = unlisted((), kept="edits", **PLACED)  # in order, see gi_core.files.edits
    camera: Camera | None = option(
        None, values.camera, "x,y,z,tx,ty,tz,fov", "eye and target [m], vertical field of view [degrees]",
        kept="camera", **PLACED,
    )  # fmt: skip
    max_edge: float | None = option(
        None, values.positive, "M", "longest edge; longer ones are split [m]", reads=True, **OF_SCENE
    )
    up: str | None = choice(None, ("x", "y", "z"), "axis that points up, instead of the file's", reads=True, **OF_SCENE)
    units: str | None = choice(
        None, UNITS,
        "photometric: the files' numbers are lm, cd, lx and cd/m2; radiometric: watts (the scene's)",
        of_scene=True, reads=True, recolours=True,
    )  # fmt: skip
    allow_outside: bool = switch(False, "the scene may name files outside its folder", kept="", reads=True, **OF_SCENE)
    document: str = unlisted("", **OF_SCENE)  # the saved scene that this comes from and is saved to; "": none


@dataclass(frozen=True)
class Method:
    """How light is computed: arguments of Solver.configure(). A change computes the frame again."""

    estimator: str | None = option(
        None, None, "NAME", "estimator of irradiance; `gi-viewer info` lists them (tangent_plane)", counts=False,
        among="gi_core.estimators.ESTIMATORS",
    )  # fmt: skip
    photons: int | None = option(
        None, values.photons, "N", "photons to trace, 1e6 is allowed (the scene's, else chosen)", of_scene=True
    )
    radius: float | None = option(
        None, values.positive, "M", "radius of discs, largest radius of photon_map [m] (the scene's, else chosen)",
        of_scene=True,
    )  # fmt: skip
    neighbours: int | None = option(
        None, values.neighbours, "K", "hits per estimate of photon_map (the scene's, else chosen)", of_scene=True
    )
    control: bool = switch(  # artifact control, see gi_core/discs/region.py
        True, "tangent_plane without artifact control: faster; corners are dark, walls leak light"
    )
    border_correction: bool = switch(True, "photon_map without alpha / 2 pi at borders, which are then dark")
    textbook: bool = switch(False, "photon_map counts the k-th hit too: k / (k - 1) times the light")
    search: str = option(
        "disc_index", None, "NAME", "disc search of tangent_plane; pictures do not depend on it (disc_index)",
        among="gi_core.discs.search.SEARCHES",
    )  # fmt: skip
    light: str | None = choice(  # None: see `light_chosen`
        None, LIGHTS,
        "best: gathered along paths, on mobiles per frame and on the static part at rest; photons: the estimator"
        " alone, as in the report (photons with --estimator and in bench, else best)", counts=False,
    )  # fmt: skip
    gloss: str = choice(
        "quadtree", GLOSS,
        "rays at glossy vertices: quadtree, summarised in cells of directions; list, one by one; all_rays, one by one"
        " where the lobe is bright (quadtree)",
    )  # fmt: skip


@dataclass(frozen=True)
class Lighting:
    """Levels of lamps. A change mixes light that is there; each press of the mouse is a step of undo."""

    lamps: tuple[LampLevel, ...] = option(  # those that differ from the scene file
        (), values.lamp, "NAME=LEVEL", "level of a lamp: 0.5, or r,g,b; `gi-viewer info` lists lamps", "lamp",
        kept="lamps", of_scene=True,
    )  # fmt: skip
    solo: str = unlisted("", of_scene=True)  # the only lamp that is on; "": all that are on
    light_scenes: tuple[LightScene, ...] = unlisted(  # by name, besides the scene file's
        (), kept="light_scenes", of_scene=True
    )


@dataclass(frozen=True)
class Tracing:
    """How paths are traced. A change opens the scene again."""

    rays: str | None = option(
        None, None, "NAME",
        "structure that traces rays; `gi-viewer info` lists them (embree, or bvh where it is missing)",
        among="gi_core.rays.structures.STRUCTURES",
    )  # fmt: skip
    seed: int = option(0, values.seed, "N", "seed of the photons (0)", resets=False)


@dataclass(frozen=True)
class Display:
    """How light is drawn."""

    size: tuple[int, int] = option((1280, 800), values.size, "WxH", "pixels (1280x800)", kept="", resets=False)
    exposure: float | None = option(  # None: metered once
        None, values.exposure, "EV", "stops; +1 doubles the brightness (the scene's, else metered)", of_scene=True
    )
    white_balance: bool = switch(True, "draw coloured lamps coloured instead of neutral")
    tone_map: str = choice(DEFAULT_TONE_MAP, TONE_MAPS, f"({DEFAULT_TONE_MAP})")
    since: State | None = unlisted(None, of_scene=True)  # that changes are shown from: of light A
    show: str = choice(  # in the window ERRORS and CHANGE too
        "radiance", SHOWS,
        "with reflectance, without, or false colours with a legend: of the light on surfaces, or of that seen by the"
        " camera (radiance)", counts=False, recolours=True,
    )  # fmt: skip
    illuminance_range: tuple[float, float] | None = option(  # None: of the view
        None, values.value_range, "LOW,HIGH",
        "ends of the false colours [lx or W/m2]; a logarithmic scale if HIGH is 30 LOW or more (that of the view)",
        counts=False,
    )  # fmt: skip
    luminance_range: tuple[float, float] | None = option(
        None, values.value_range, "LOW,HIGH", "the same [cd/m2 or W/m2/sr]", counts=False
    )
    isolines: tuple[float, ...] | None = option(  # (): at round values; None: without
        None, values.isolines, "auto|E1,E2,...",
        "lines of equal illuminance over its false colours, at round or at given values [lx or W/m2]", counts=False,
    )  # fmt: skip
    error_range: float | None = unlisted(None, recolours=True)  # ends of the error map, relative; see ERROR_RANGES
    cull: bool = switch(True, "draw the backs of one-sided faces too, dark grey")
    picture_scale: int = unlisted(1)  # times the viewport's pixels per side, of saved pictures; one of PICTURE_SCALES


@dataclass(frozen=True)
class View:
    """What the window shows beside the picture, and measures."""

    reference: bool = unlisted(False, recolours=True)  # show the reference instead of the estimate
    measure_errors: bool = unlisted(True)  # at rest
    cells: str = unlisted("")  # leaf cells of the structure of rays, and those on a ray: POINTED, CLICKED; "": none
    show_paths: bool = unlisted(False)  # draw paths of some photons
    show_disc: bool = unlisted(False)  # draw the light counted at the receiver under the cursor
    show_recomputed: bool = unlisted(False, recolours=True)  # colour receivers by the work of the last frame
    budget: float = option(  # 0: always all photons
        BUDGET, values.not_negative, "MS", f"time for light per frame in motion ({BUDGET:g})"
    )
    pins: tuple[Pin, ...] = unlisted((), kept="pins", **OF_SCENE)  # read-outs
    asked: Pin | None = unlisted(None, of_scene=True)  # whose light is shown by its origins
    cameras: tuple[tuple[str, Camera], ...] = unlisted((), kept="cameras", **OF_SCENE)  # by name
    surfaces: tuple[CalculationSurface, ...] | None = option(  # None: those of the scene file
        None, values.surface, "KEYS",
        "calculation surface instead of the scene's: keys of [[surface]], such as 'name = \"desk\", height = 0.75'",
        "surface", kept="surface", **OF_SCENE,
    )  # fmt: skip
    watts: tuple[tuple[str, float], ...] = option(  # before those of the scene file and of photometric files
        (), values.watts, "NAME=W", "power of a lamp at full level [W]", "watts", kept="watts", of_scene=True
    )
    maintenance_factor: float | None = option(
        None, values.maintenance, "F", "factor of the light of electric lamps on surfaces, 0 to 1 (the scene's)",
        of_scene=True,
    )  # fmt: skip
    hold: bool | None = switch(  # None: the scene file decides
        None, "dim lamps to the fewest watts that hold the targets of surfaces", of_scene=True
    )
    fallback: bool = unlisted(True, resets=False)  # without a window, render to a file instead of failing


@dataclass(frozen=True)
class Settings(View, Display, Tracing, Lighting, Method, Source):
    """All settings."""

    @property
    def method(self) -> dict[str, Any]:
        """The fields of Method, with the light chosen, as arguments of the solver."""
        return {f.name: getattr(self, f.name) for f in fields(Method)} | {"light": self.light_chosen}

    def with_method_of(self, solver: Solver) -> Settings:
        """Return settings that name the method of a solver, whatever was open."""
        setting = {name: value for name, value in solver.setting._asdict().items() if name in TABLE}
        return replace(self, **setting, photons=solver.photons, light=solver.light)

    def in_light_scene(self, lamps: tuple[LampLevel, ...]) -> Settings:
        """Return settings of these lamps, by name; all others are as in the scene file."""
        return replace(self, lamps=tuple(sorted(lamp for lamp in lamps if lamp != LampLevel(lamp.name))), solo="")

    def without_solo(self, names: Iterable[str]) -> Settings:
        """Return settings of the same levels of these lamps, in which none is alone."""
        if not self.solo:
            return self
        lit = (lamp._replace(on=lamp.on and name == self.solo) for name, lamp in self._lamps(names).items())
        return self.in_light_scene(tuple(lit))

    def with_light_scene(self, name: str, names: Iterable[str]) -> Settings:
        """Return settings that keep the present levels of these lamps as a light scene."""
        now = self.without_solo(names).lamps
        scenes = {**dict(self.light_scenes), name: now}
        return replace(self, light_scenes=tuple(LightScene(*scene) for scene in scenes.items()))

    def _lamps(self, names: Iterable[str]) -> dict[str, LampLevel]:
        """Return the state of each of these lamps, and of those that are set."""
        return {name: LampLevel(name) for name in names} | {lamp.name: lamp for lamp in self.lamps}

    def levels(self, names: Iterable[str]) -> dict[str, tuple[float, float, float]]:
        """Return the level per channel of each of these lamps, and of those that are set."""
        lamps = self._lamps(names)
        lit = {name: lamp.on and self.solo in ("", name) for name, lamp in lamps.items()}
        return {
            name: tuple(lamp.level * c * lit[name] for c in lamp.colour)  # type: ignore[misc]
            for name, lamp in lamps.items()
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
    def needs_reference(self) -> bool:
        """Whether the picture shows the reference, or errors against it."""
        return self.reference or self.show == ERRORS


TABLE: dict[str, Row] = {f.name: f.metadata["row"] for f in fields(Settings)}
OPTIONS = {name: row for name, row in TABLE.items() if row.option}


def flag_of(name: str) -> str:
    """Return the option of a setting."""
    no = "no-" if OPTIONS[name].option.get("action") == "store_false" else ""
    return f"--{no}{(OPTIONS[name].flag or name).replace('_', '-')}"


def named(group: type) -> list[str]:
    """Return the names of the settings of a group that have options."""
    return [f.name for f in fields(group) if f.name in OPTIONS]


def open_scene(settings: Settings) -> Scene:
    """Return the edited scene with its mobiles at the poses of the settings. Raises SceneError."""
    from gi_core.files.edits import edited

    return as_asked(edited(read_scene(settings), settings.edits, settings.allow_outside), settings)


def read_scene(settings: Settings) -> Scene:
    """Return the scene without edits. Raises SceneError."""
    from gi_core.files.load import load_scene
    from gi_core.lights.daylight import daylit

    options = {name: getattr(settings, name) for name in ("max_edge", "up") if getattr(settings, name) is not None}
    scene = load_scene(settings.scene, mobiles=settings.mobiles, allow_outside=settings.allow_outside, **options)
    scene = replace(scene, units=settings.units or scene.units)
    return daylit(scene, scene.daylight, settings.scene) if scene.daylight else scene


def of_files(settings: Settings) -> tuple:
    """Return the settings that read_scene() depends on."""
    return tuple(getattr(settings, name) for name, row in TABLE.items() if row.reads)


def as_asked(scene: Scene, settings: Settings) -> Scene:
    """Return an edited scene with its camera and its mobiles as in the settings. Raises SceneError."""
    from gi_core.files.edits import removed_lamps
    from gi_core.lights.lamps import OTHERS
    from gi_core.scene.validate import check_lamp

    asked = [*(("lamps", name) for name in settings.levels(())), *(("watts", name) for name, _ in settings.watts)]
    for table, name in asked:  # before kernels compile
        if name != OTHERS and name not in removed_lamps(settings.edits):
            check_lamp(_place_of(settings, table, name, scene.name), name, scene)
    poses = start_poses(settings, scene)
    if settings.camera is not None:
        scene = replace(scene, camera=settings.camera)
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
    from gi_core.scene.pose import as_pose, four, three

    mobiles = {m.name: m for m in scene.mobiles}
    poses = {}
    for name, numbers in settings.poses:
        if name not in mobiles:
            names = ", ".join(mobiles) or "none"
            where = _place_of(settings, "poses", name) or f"{scene.name}: --pose"
            raise SceneError(f'{where} names the mobile "{name}", but the mobiles of this scene are: {names}')
        quaternion = numbers[3:] or mobiles[name].pose.quaternion
        place = _place_of(settings, "poses", name)
        poses[name] = as_pose(Pose(three(numbers[:3]), four(quaternion)), f"{place or '--pose'} {name}")
    return poses


def _place_of(settings: Settings, table: str, name: str, otherwise: str = "") -> str:
    """Return the table of the saved scene that has a name; `otherwise` where it stands on the command line."""
    from gi_core.files.formats.boundary import Boundary
    from gi_core.files.formats.toml_fields import read_toml

    if document := settings.document:
        file = Path(document)
        with suppress(SceneError):
            if name in read_toml(file, document, Boundary(file.parent, named=file)).get(table, {}):
                return f"{document}: [{table}]"
    return otherwise


def check_names(settings: Settings) -> None:
    """Raise UsageError for an unknown estimator, search or structure of rays. Default names need no import."""
    for name, row in TABLE.items():
        value = getattr(settings, name)
        if row.among and value not in (None, getattr(Settings, name)):
            module, _, registry = row.among.rpartition(".")
            names = getattr(import_module(module), registry)
            if value not in names:
                raise UsageError(f'--{name} must be one of {", ".join(names)}, got "{value}"')


def make_solver(scene: Scene, settings: Settings, results: Results | None = None, threads: int | None = None) -> Solver:
    """Return a solver for the scene; nothing is traced yet. Raises UsageError, SceneError for an unknown name.

    results: of the scene before its last edit; threads: None for one per core.
    """
    from gi_core.estimators import DEFAULT, ESTIMATORS
    from gi_core.files.edits import removed_lamps
    from gi_core.solver import Solver

    check_names(settings)
    removed = removed_lamps(settings.edits)
    estimator = settings.estimator or scene.defaults.estimator or DEFAULT
    if estimator not in ESTIMATORS:
        raise SceneError(
            f'{scene.name}: [defaults]: estimator must be one of {", ".join(ESTIMATORS)}, got "{estimator}"'
        )
    lamps = {name: level for name, level in settings.levels(()).items() if name not in removed}
    method = {**settings.method, "estimator": estimator}
    return Solver(
        scene, seed=settings.seed, threads=threads, lamps=lamps, rays=settings.rays, results=results, **method
    )

"""The scene on show: its poses, meshes, colours and exposure, read from the snapshot of its light."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from app.draw.camera import Turntable, matrices
from app.draw.draw_mesh import DrawMesh, dimmed
from app.draw.lit_scene import LitScene, metered
from app.draw.motion import paths_of
from app.draw.picking import Picker
from app.draw.tonemap import NEUTRAL, Gains, gains_for
from app.rest.calculation_surface import SurfaceLight, surfaces_of
from app.rest.results import GatherProgress
from app.rest.surface_grid import Grid, Level, grid_of, level_of
from app.session.lights import LightId, lights_after
from app.session.method_view import MethodParts
from app.session.opening import Opened
from app.session.solver_thread import SolverThread
from app.settings import Settings, State
from gi_core.bsdf.tabulate import tabulate
from gi_core.defaults import Chosen
from gi_core.files import edits
from gi_core.files.edits import Edit, Finish, Values
from gi_core.files.finishing import finish_of, is_textured, parts_of
from gi_core.files.formats.materials_table import FINISH, brdf_of, checked
from gi_core.files.formats.toml_fields import as_table
from gi_core.lights.power import Power, power_of
from gi_core.model import Model
from gi_core.scene import KeyFrames, Pose, Scene, SceneError
from gi_core.scene.types import UNITS, CalculationSurface, Daylight, Light, Material, PhotometricLight, PlacedLight


class Finished(NamedTuple):
    """The reflection of a material, or of a part of a mobile."""

    values: Values  # as an edit gives it
    textured: bool  # its colour is a texture, or several colours
    darkened: str = ""  # where and why the scene on show darkens it, as `gi_core.bsdf.table.Table.limited`


class KeptLight(NamedTuple):
    """Light at rest, to compare later light with."""

    irradiance: np.ndarray  # (R, 3) [W/m2]
    deviation: np.ndarray  # (R,) [W/m2], standard error of its luminance
    places: np.ndarray  # (R, 3) [m] of the receivers in the spaces of their objects
    state: State  # that it is of
    surfaces: tuple[SurfaceLight, ...]  # those measured


class OpenScene:
    """A scene and its light; nothing here changes them. Before `_show` there is no light."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings  # the user's
        self.opened: Opened
        self._given: Scene
        self.model: Model
        self.chosen: Chosen
        self.gains: Gains = NEUTRAL  # of the white balance
        self.picker: Picker | None = None
        self.light: SolverThread | None = None
        self.receiver = -1  # under the cursor; -1: none
        self.held_receiver = -1  # whose part in the method is drawn instead, chosen by a click; -1: none
        self.edits = settings.edits  # those on show, and those asked for
        self._meshes: tuple[DrawMesh, ...] = ()
        self.paths: dict[str, KeyFrames] = {}  # by mobile: the scene's, else a circle for the first one
        self.kept: KeptLight | None = None  # light A
        self._grids: dict[CalculationSurface, tuple[tuple, Grid]] = {}  # poses that they are of, and points

    def _show(self, opened: Opened, light: SolverThread) -> None:
        """Take the records of an opened scene; they never change, and the solver's thread alone touches the rest."""
        self.opened, self.light, solver = opened, light, opened.solver
        self._meshes, self.picker = opened.meshes, Picker(solver.model)
        self._given = solver.scene
        self.model, self.chosen = solver.model, solver.chosen
        self.gains = gains_for(solver.model.emitters.total_flux)
        self.paths = {name: path for name, path in paths_of(solver).items() if len(path.times) > 1}
        self._start = light.snapshot.poses

    @property
    def scene(self) -> Scene:
        """The scene, in the units of the settings, else in those of its files."""
        units = self.settings.units or self._given.units
        return self._given if units == self._given.units else replace(self._given, units=units)

    @property
    def meshes(self) -> tuple[DrawMesh, ...]:
        """Draw meshes, the static part first; lamps emit at the levels of the light on show."""
        return dimmed(self._meshes, self.light.snapshot.levels)

    @cached_property
    def level(self) -> Level:
        """The lit box above the floor, along the axes of the scene, for calculation surfaces."""
        return level_of(self.model)

    @property
    def power(self) -> Power:
        """Electric power of the lamps on show."""
        levels = self.light.snapshot.levels
        return power_of(self.model.emitters, self.scene, levels, self.settings.watts, self.level.area)

    @property
    def light_to_keep(self) -> KeptLight | None:
        """The light on show, once its errors are known: those of best light are from its first pictures on."""
        light = self.light.snapshot
        if light.deviation is None or np.isnan(light.deviation).all():
            return None
        levels = tuple(map(tuple, light.levels.tolist()))
        state = State(weakref.ref(self.model), tuple(sorted(light.poses.items())), levels)
        surfaces = tuple(x for x in light.rest.surfaces if x.is_current and x.fraction == 1)
        return KeptLight(light.irradiance, light.deviation, self.model.object_receivers.positions, state, surfaces)

    @property
    def grids(self) -> list[tuple[CalculationSurface, Grid]]:
        """The calculation surfaces at the poses of the light on show."""
        poses, out = self.light.snapshot.poses, []
        for s in surfaces_of(self.settings, self.scene):
            of = tuple(sorted(poses.items())) if s.on else ()
            if (placed := self._grids.get(s)) is None or placed[0] != of:
                try:
                    placed = of, grid_of(s, self.model, self.level, poses)
                except SceneError:  # the part that it lies on has been removed
                    continue
                self._grids[s] = placed
            out.append((s, placed[1]))
        return out

    @property
    def poses(self) -> dict[str, Pose]:
        """Poses of the mobiles, those of moves under way included."""
        return self.light.poses

    @property
    def moved(self) -> dict[str, Pose]:
        """Poses of the mobiles that differ from the scene file's."""
        asked = dict(self.settings.poses)
        return {name: p for name, p in self.poses.items() if name in asked or p != self._start[name]}

    @property
    def pose_list(self) -> list[Pose]:
        """Poses of the light on show, in the scene's order."""
        return [self.light.snapshot.poses[m.name] for m in self.scene.mobiles]

    def box_of(self, names: Iterable[str], poses: Mapping[str, Pose] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the corners (3,) [m] of the box round mobiles at poses, by default the present ones."""
        numbers = [1 + self.model.names.index(name) for name in names]
        points = [self.model.vertices_at(o, self.poses if poses is None else poses) for o in numbers]
        return np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0)

    def box_of_lamp(self, lamp: LightId) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the corners (3,) [m] of the box round a light that has a place, else round a lamp's faces, or None."""
        light, mesh = self.lights.get(lamp), self.scene.static
        if isinstance(light, PlacedLight):
            least = 0.03 * self.chosen.scene_size  # 0.03 of the scene's size: box of a light without a size
            side = max(least, *light.size) if isinstance(light, PhotometricLight) else least
            return np.array(light.position) - side / 2, np.array(light.position) + side / 2
        shining = [m.name == lamp.name and max(m.emission) > 0 for m in self.scene.materials]
        points = mesh.vertices[mesh.faces[np.array(shining, bool)[mesh.face_material]]].reshape(-1, 3)
        return (points.min(axis=0), points.max(axis=0)) if len(points) else None

    @property
    def irradiance(self) -> np.ndarray:
        """Irradiance (R, 3) [W/m2] of the light on show."""
        return self.light.snapshot.irradiance

    @property
    def gathered(self) -> GatherProgress | None:
        """Progress of the static part's gathered light; None: the settings ask for photons only."""
        return self.light.snapshot.rest.gathered if self.settings.light_chosen == "best" else None

    @property
    def _method_parts(self) -> MethodParts | None:
        """Parts of the method that the settings ask for."""
        s = self.settings
        if not (s.show_paths or s.show_disc or s.show_recomputed):
            return None
        receiver = self.receiver if self.held_receiver < 0 else self.held_receiver
        return MethodParts(s.show_paths, receiver if s.show_disc else -1, s.show_recomputed)

    def finish_of(self, name: str, material: bool, part: str = "") -> Finished:
        """Return the reflection of a part of a mobile, or of a material in the static part; of the edits asked for."""
        of = name, material, part
        values = finish_of(self.scene, self.model.surfaces, *of)
        finish = Finished(values, is_textured(self.scene, *of), _darkened(values))

        def values_of(edits: Iterable[Edit]) -> list[Values]:
            return [e.material for e in edits if isinstance(e, Finish) and (e.name, e.part) == (name, part)]

        if asked := values_of(self.edits):
            newest: dict[str, Any] = dict(asked[-1])
            if "reflectance" in newest:
                return Finished(asked[-1], False, finish.darkened)
            if "brdf" not in newest:  # no textures yet
                newest = {"reflectance": dict(finish.values).get("reflectance", (0.5,) * 3), **newest}
            comes = any("reflectance" in dict(shown) for shown in values_of(self.settings.edits))  # back, by an undo
            return Finished(tuple(newest.items()), finish.textured or comes, finish.darkened)
        return finish

    @property
    def lights(self) -> dict[LightId, Light]:
        """Lights by name and number, as the edits asked for leave them."""
        return lights_after(self.scene, [edit for edit in self.edits if edit not in self.settings.edits])

    @property
    def daylight(self) -> Daylight | None:
        """Place, date and hour of the daylight, as the edits asked for leave them; None: the scene has none."""
        now = self.scene.daylight
        for edit in self.edits:
            if now is not None and isinstance(edit, edits.Daylight) and edit not in self.settings.edits:
                now = now._replace(**dict(edit.light))
        return now

    def file_of(self, light: LightId) -> str:
        """Return the photometric file that an edit has given a light, "" for none."""
        key = light.name, light.number
        files = [e.file for e in self.edits if isinstance(e, edits.Light) and (e.name, e.number) == key]
        return files[-1] if files else ""

    def parts_of(self, name: str) -> tuple[str, ...]:
        """Return the parts of a mobile, by material; () for an unknown one."""
        return parts_of(self.scene, name) if name in self.poses else ()

    @property
    def lit(self) -> LitScene:
        """The light on show."""
        light, radiance, units = self.light.snapshot, self.settings.shows_radiance, UNITS[self.scene.units]
        return LitScene(self.model, light.poses, light.levels, self.meshes, light.drawn, light.gloss, radiance, units)

    def metered(self, camera: Turntable) -> float:
        """Return the metered exposure [EV] of a view of the light on show."""
        return round(metered(self.lit, camera, self.chosen.scene_size), 2)

    def models(self) -> tuple[np.ndarray, ...]:
        """Return the (4, 4) object-to-world matrix of each object; the static part's is the identity."""
        return tuple(matrices(self.model.transforms(self.light.snapshot.poses)))


def _darkened(values: Values) -> str:
    """Return where and why a material of these values is darkened, "" if it is not; its table is that of the scene."""
    material = brdf_of(checked(as_table(values), "", FINISH), Material(""))
    return tabulate(material.brdf, True).limited if material.scaled else ""

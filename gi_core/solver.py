"""The solver: background once, then each frame (`frames/frame.py`) from the background and the poses alone."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from gi_core.base.pause import Progress, pause, steps, undivided
from gi_core.base.results import KEPT, Results
from gi_core.defaults import choose
from gi_core.discs.search import SEARCHES
from gi_core.display.dilation import Drawn
from gi_core.estimators import DEFAULT, ESTIMATORS
from gi_core.estimators.base import Setting, checked
from gi_core.frames.background import Background, Photons
from gi_core.frames.control_variate import changed
from gi_core.frames.edited_light import LightBefore
from gi_core.frames.first_frame import FirstFrame
from gi_core.frames.frame import Frame, light_from_scratch, next_frame
from gi_core.frames.frame_light import FrameLight
from gi_core.frames.held_light import Held
from gi_core.frames.light_setting import FrameBudget
from gi_core.gather.importance import importance
from gi_core.geometry.error import luminance, relative_noise
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights.lamps import Lamps
from gi_core.model import Model
from gi_core.scene.errors import shown
from gi_core.scene.rules import one_of
from gi_core.scene.types import Pose, Scene

Posed = Pose | np.ndarray
CHOICES: dict[str, Mapping] = {"estimator": ESTIMATORS, "search": SEARCHES}


class BeforeEdit(NamedTuple):
    """Static light on show before an edit."""

    light: LightBefore | None
    goes_on: str  # key of the static part whose photons or gathered light it is, so that these show it; "": of none


def _model(scene: Scene, threads: int | None, rays: str | None, earlier: Photons | None, results: Results) -> Model:
    """Return the model of a scene; its geometry is that before the edit, where the edit has changed lights alone."""
    before = earlier.model if earlier is not None else None
    if before is not None and threads in (None, before.threads) and rays in (None, before.accelerator.rays):
        relit = before.relit(scene)
        if relit is not None:
            return relit
    return Model(scene, threads, rays, before, results)


def _summary(solver: Solver) -> str:
    where, light = f'"{solver.scene.name}", {len(solver.irradiance):,} receivers', solver.setting.estimator
    return f"<Solver of {where}: {solver.frame.photons:,} photons, {light}>"


class Solver:
    """Irradiance at the receivers of a scene, kept up to date while mobiles move. `frame` is the last one."""

    def __init__(
        self, scene: Scene, estimator: str = DEFAULT, photons: int | None = None, radius: float | None = None,
        neighbours: int | None = None, seed: int = 0, threads: int | None = None, light: str = "photons",
        lamps: Mapping[str, float | Sequence[float]] | None = None, rays: str | None = None,
        results: Results | None = None, **settings,
    ):  # fmt: skip
        """Prepare a scene; nothing is traced except a small pilot trace for the defaults.

        photons: to trace (>= 0); radius: of the disc [m]; neighbours: k of photon_map; None: the scene file's value,
        else by `gi_core.defaults.choose`; light: "photons" or "best", see `gi_core.frames.light_setting`; lamps: levels
        that differ from 1, see set_lamps(); rays: as for `gi_core.model.Model`; results: keep_results() of the
        scene before an edit; settings: fields of `gi_core.estimators.base.Setting` beside their defaults. Raises
        SceneError.
        """
        self.scene, self.seed = scene, checked("seed", seed, 0)
        self.results = Results() if results is None else results
        earlier: Photons | None = self.results.take("photons", "")
        self.model = _model(scene, checked("threads", threads), rays, earlier, self.results)
        self.chosen = choose(self.model, photons, radius, neighbours)
        self.scene_size, self.photons = self.chosen.scene_size, self.chosen.photons
        self.setting = Setting(DEFAULT, self.chosen.radius, self.chosen.neighbours)
        self.frame_light = FrameLight(self.model, self.seed)
        store, black = Photons(self.model, self.seed, earlier), np.zeros((len(self.model.object_receivers.areas), 3))
        self.frame, self.budget = Frame(self.model.start_poses(), black, black, self.levels, store), FrameBudget()
        self._first_frame = FirstFrame(store, self.frame_light)
        self.configure(estimator=estimator, light=light, **settings)
        self.set_lamps(lamps or {})
        if results is not None:
            self._begin()

    __repr__ = _summary

    def configure(
        self,
        photons: int | None = None,
        light: str | None = None,
        subset_only: bool | None = None,
        gloss: str | None = None,
        **changes,
    ) -> None:
        """Change settings. Paths stay; solve_steps() repeats only the work that depends on the change.

        light: as for Solver; subset_only: frames of a photon subset take the static part's light from that subset too,
        not from all photons (for measuring); gloss: how rays at glossy receivers are kept, one of
        `gi_core.frames.light_setting.WAYS`; changes: fields of `setting`; None keeps a value. Until solve_steps() has
        run, frames go on with the old settings. Raises SceneError for a bad value.
        """
        photons, setting = checked("photons", photons, self.photons), self.setting.changed(CHOICES, **changes)
        self.frame_light.setting.choose(light, subset_only, gloss)
        self.photons, self.setting = photons, setting

    @property
    def light(self) -> str:
        return self.frame_light.setting.light

    @property
    def lamps(self) -> Lamps:
        """Lamps of the scene, in the order of `levels`."""
        return self.model.emitters.lamps

    @property
    def levels(self) -> np.ndarray:
        """Levels (G, 3) of the lamps: factors of red, green and blue, 1 as in the scene file."""
        return self.frame_light.setting.levels

    def set_lamps(self, levels: Mapping[str, float | Sequence[float]], paths: int | None = None) -> None:
        """Change levels of lamps by name: a factor >= 0, or three for red, green and blue; update irradiance.

        Nothing is traced again, except rays to mobiles; solve_steps() traces photons again where lamps share them
        otherwise at these levels (`FirstFrame.share`). paths: as for move_all(). Raises SceneError for a name that no
        lamp has, and for a bad level. A change that any exception breaks off has not been made.
        """
        setting = self.frame_light.setting
        with setting.dimmed_to(self.lamps.changed(setting.asked, levels, self.scene.name)):
            self._update(paths=paths)

    def hold(self, held: Held | None) -> None:
        """Let each frame find the levels that hold targets, at most those of set_lamps(); None: have these again."""
        before, self.frame_light.held = self.frame_light.held, held
        try:
            with self.frame_light.setting.dimmed_to(self.frame_light.setting.asked):
                self._update()
        except BaseException:
            self.frame_light.held = before
            raise

    def solve(self) -> None:
        """Trace and estimate all photons wanted."""
        self._solve(pictures=False)

    def solve_steps(self, pictures: bool = True) -> Iterator[Progress]:
        """Trace and estimate in steps of some 20 ms; with `pictures`, refresh irradiance as photons grow.

        May be abandoned between steps and restarted; traced photons are reused. The first one's thread takes all.
        """
        return steps(partial(self._solve, pictures))

    def _solve(self, pictures: bool) -> None:
        f = self._first_frame
        f.share(self.model)
        f.extend(self.setting, lambda: self.frame, lambda: self._goal, pictures, self._update)
        pause(Progress("done", 1.0, False))

    @property
    def _goal(self) -> int:
        return self.photons if len(self.model.emitters.kind) else 0

    def gather_steps(self) -> Iterator[Progress]:
        """Gather the static part's light, used where `light` is "best", in steps of some 10 ms to 0.7 % noise.

        May be abandoned between steps and begun again.
        """
        return steps(self._gather)

    def _gather(self) -> None:
        self.frame_light.gather(lambda: self.frame.background, self._refresh)
        pause(Progress("done", 1.0, False))

    def _refresh(self) -> None:
        """Compute the frame on show again, in new static light."""
        if self.frame.background.added == self._goal:
            self._first_frame.find_unreached(self.frame.background)
        self._update()

    def gather_pose_steps(self) -> Iterator[Progress]:
        """Gather light with mobiles in place at the current poses, in steps of some 10 ms, for frames at these poses.

        To be abandoned at the next move; begun again, it continues.
        """
        return steps(self._gather_at_poses)

    def _gather_at_poses(self) -> None:
        f = self.frame
        at = self.model.transforms(f.poses)
        self.frame_light.gather_at_poses(f.background, f.photons, f.irradiance, f.gloss, at, self._update)
        pause(Progress("done", 1.0, False))

    @property
    def poses(self) -> dict[str, Pose]:
        return self.frame.poses

    @property
    def irradiance(self) -> np.ndarray:
        """Irradiance (R, 3) [W/m2] of the last frame."""
        return self.frame.irradiance

    def move(self, name: str, pose: Posed) -> None:
        """Put one mobile at a pose (a Pose or a rigid (4, 4) matrix) and update irradiance; errors as move_all()."""
        self.move_all({name if isinstance(name, str) else shown(name): pose})

    def move_all(self, poses: Mapping[str, Posed], photons: int | None = None, paths: int | None = None) -> None:
        """Put several mobiles at new poses and update irradiance once.

        photons: one of `subsets`, None: all; paths: per receiver of a mobile, where its light is gathered, one of
        `light_setting.PATHS`, None: 64. Raises SceneError for a name that no mobile has, a pose that is not rigid, and
        any other number of photons or paths. A move that any exception breaks off has not been made, such as
        Interrupted at a pause (`gi_core.base.pause.breaking_off`).
        """
        if photons is not None:
            one_of(self.frame.subsets).check(f"{self.scene.name}: the photons of a frame", photons)
        self.frame_light.size(0, paths)  # raises before the first photon too
        self._update(None, {**self.poses, **self.model.checked_poses(poses)}, photons, paths)

    def size_within(self, seconds: float) -> tuple[int | None, int | None]:
        """Return photons and paths for move_all(), of the largest frame that past ones predict to fit (FrameBudget)."""
        return self.budget.within(seconds, self.frame.subsets, self.paths_at_rest > 0)

    @property
    def paths_at_rest(self) -> int:
        """Default paths per receiver of a mobile; 0 where none are gathered."""
        return self.frame_light.size(self._goal).paths

    def _update(
        self, background: Background | None = None, poses: dict[str, Pose] | None = None, photons: int | None = None,
        paths: int | None = None,
    ) -> None:  # fmt: skip
        """Compute the next frame, from the background on show and at the last poses where none are given, or raise."""
        shown, again = self.frame.background, self.frame if poses is None else None
        b, poses = background or shown, self.poses if poses is None else poses
        if b is None:
            self.frame = self.frame._replace(poses=poses, levels=self.frame_light.setting.levels)
            return  # nothing traced yet
        size = self.frame_light.size(b.estimate.photons if photons is None else photons, paths)
        setting, levels = self.frame_light.setting, self.frame_light.setting.levels
        try:
            with undivided():
                frame = next_frame(b, self.frame_light, poses, size, again)
        except BaseException:
            setting.levels = levels  # those of the frame on show
            raise
        budget = self.budget if b is shown else FrameBudget()
        if frame.evaluated is not self.frame.evaluated:
            budget.record(size, frame.timings, self.frame_light.mobiles.rays_traced)
        self.frame, self.budget = frame, budget

    def twin(self, fresh: bool = False) -> Solver:
        """Return a solver of the same photons with separate settings and poses; only one of the two may work at a time.

        It starts as this one is or, `fresh`, with nothing estimated yet.
        """
        other, light = copy.copy(self), self.frame_light.twin(fresh)
        other.budget, other.frame_light = FrameBudget(), light
        other._first_frame = self._first_frame.twin(light, self.frame.store)
        if fresh:
            other.frame = Frame(self.poses, self.irradiance, self.irradiance, self.frame.levels, self.frame.store)
        return other

    def from_scratch(self, poses: Mapping[str, Pose] | None = None) -> np.ndarray:
        """Return irradiance (R, 3) at poses from all photons, traced again; each frame must equal this bit for bit."""
        b = self.frame.background or self._first_frame.background(self.setting, None, self._goal)
        return light_from_scratch(self.frame, b, self.frame_light, {**self.poses, **(poses or {})})

    @property
    def _static_key(self) -> str:
        return f"{self.model.static_key} {self.seed}"

    @property
    def _rays_key(self) -> str:
        return f"{self.model.static_rays_key} {self.seed}"

    def _begin(self) -> None:
        """Begin with the results of the scene before an edit: those of the same inputs go on.

        Elsewhere the static part's light begins as that before the edit, changed by photons.
        """
        light, key, results = self.frame_light, self._static_key, self.results
        if (direct := results.get("direct light", self._rays_key)) is not None:
            light.static.direct.begin_with(direct)
        sums: Background | None = results.take("sums", key)
        if sums is not None and sums.added <= photons_of(self).count:
            light.gloss.begin_with(results.take("gloss", key), self._first_frame.begin_with(sums))
        light.at_poses.begin_with(results.take("light at poses", key))
        before: BeforeEdit | None = results.get("light before", "")
        changed = None if before is None or before.goes_on == key else before.light
        light.static.begin_with(changed, results.get("static light", key))

    def keep_results(self) -> Results:
        """Keep copies of results for a solver of an edited scene of the same seed, and return all that are kept."""
        light, f, key, results = self.frame_light, self.frame, self._static_key, self.results
        photons, b, gathered = Photons(self.model, self.seed, photons_of(self)), f.background, light.static.gathered
        results.keep("photons", "", photons, 1)
        has_sums = b is not None and b.added and b.store is photons_of(self) and b.setting is not None
        if has_sums:
            at = self.model.transforms(f.poses)
            results.keep("sums", key, b.copied(photons), 1)
            results.keep("gloss", key, light.gloss.kept(b, light.setting), 1)
            results.keep("light at poses", key, light.before_edit(b, f.photons, f.irradiance, f.own, at), 1)
        if light.direct.is_known:
            results.keep("direct light", self._rays_key, light.direct.kept(), KEPT)
        if gathered is not None:
            results.keep("static light", key, gathered.copied(None), KEPT)
        stands = (has_sums or light.is_gathered) and not light.static.shows_earlier
        shown = light.static.before_edit(b, light.unreached.static.rows) if self.light == "best" else None
        results.keep("light before", "", BeforeEdit(shown, key if stands else ""), 1)
        return results

    @property
    def deviation(self) -> np.ndarray:
        """Error (R,) [W/m2] of the luminance of `irradiance`: its standard error, and the mean share of bias; nan where
        it is not known.
        """
        if (b := self.frame.background) is None or not b.estimate.photons:
            return np.full(len(self.irradiance), np.nan)
        at, f = self.model.transforms(self.poses), self.frame
        return self.frame_light.deviation(at, b, (f.irradiance, f.deviation))

    def since(self, poses: Mapping[str, Pose], levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return irradiance (R, 3) [W/m2] at other poses and levels (G, 3) of the lamps, by the same photons and paths.

        Also return the standard error (R,) [W/m2] of the change of luminance since; nan where it is not known. Light
        gathered at the poses on show is compared with that gathered at the others, or changed as frames change.
        """
        twin, here = self.twin(), self.frame
        twin.frame_light.held = None

        def dim(to: np.ndarray) -> None:
            twin.set_lamps(dict(zip(self.lamps.names, to.tolist(), strict=True)))

        dim(levels)
        twin.move_all(poses)
        earlier, apart = twin.frame, np.hypot(self.deviation, twin.deviation)
        moved, own = twin.poses != self.poses, (here.own, here.deviation)
        rested, both = (here.irradiance != here.own).any(axis=1), np.zeros(len(apart), bool)
        by_frames = changed(here.irradiance, here.own, earlier.own)
        if moved:
            both = rested & (earlier.irradiance != earlier.own).any(axis=1)
        else:  # levels are factors
            factors = np.divide(earlier.own, here.own, out=np.ones_like(here.own), where=here.own > 0)
            by_frames = np.where(here.own > 0, here.irradiance * factors, by_frames)  # the same bits by a factor of 1
        by_frames = np.where(rested[:, None], by_frames, earlier.own)
        irradiance = np.where(both[:, None], earlier.irradiance, by_frames)
        if (b := here.background) is None or not b.estimate.photons or not self.frame_light.setting.takes_gathered:
            return irradiance, apart
        if moved:
            deviation = self.frame_light.own_deviation(b, own, (twin.frame_light, (earlier.own, earlier.deviation)))
        else:
            dim(np.abs(self.levels - levels))  # light is linear, and lamps are independent
            deviation = twin.frame_light.own_deviation(b, (twin.frame.own, twin.frame.deviation))
        return irradiance, np.where(both, apart, deviation)

    @property
    def error(self) -> float:
        """Relative l1 error of `irradiance` by importance, where `deviation` knows it; nan where it knows none."""
        deviation, weights = self.deviation, importance(self.model, luminance(self.irradiance))
        return relative_noise(deviation, self.irradiance, weights, np.isfinite(deviation))

    @property
    def static_irradiance(self) -> np.ndarray:
        """Irradiance (n, 3) [W/m2] of static receivers without mobiles; zeros before the first solve."""
        if (b := self.frame.background) is None or not (photons := b.estimate.photons):
            return np.zeros((self.surfaces.receiver_range(0).stop, 3))
        return self.frame_light.static_irradiance(b, photons)

    def drawn(self, irradiance: np.ndarray, poses: Mapping[str, Pose] | None = None) -> Drawn:
        """Return irradiance (R, 3) as it is to be drawn: unreached receivers are filled from lit ones beside them.

        poses: that it belongs to, if not the current ones. The same array, and no weights, where light reaches all
        receivers (`gi_core.display.dilation`), and until all photons wanted have been estimated.
        """
        return self.frame_light.unreached.drawn(irradiance, self.model.transforms(poses or self.poses))

    @property
    def receivers(self) -> Receivers:
        """Receivers at the current poses, in the world."""
        return self.model.receivers_at(self.poses)

    @property
    def surfaces(self) -> Surfaces:
        return self.model.surfaces


def photons_of(solver: Solver) -> Photons:
    """Return the photons that lamps share by flux."""
    return solver._first_frame.by_flux


def edited_solver(solver: Solver, scene: Scene) -> Solver:
    """Return a solver of an edited scene (`gi_core.files.edits`) with a solver's settings, poses and levels of lamps.

    Photons that met no edited face are not traced again. The irradiance equals that of a new solver of the scene with
    these settings, bit for bit: light before the edit has no part. Raises SceneError.
    """
    model, chosen = solver.model, solver.frame_light.setting
    settings = solver.setting._asdict() | {"photons": solver.photons, "light": solver.light, "seed": solver.seed}
    settings |= {"subset_only": chosen.subset_only, "gloss": chosen.gloss}
    results = solver.keep_results().of("regions", "places", "photons", "sums", "gloss", "direct light")
    other = Solver(scene, threads=model.threads, rays=model.accelerator.rays, results=results, **settings)
    other.move_all({name: pose for name, pose in solver.poses.items() if name in other.poses})
    levels = zip(solver.lamps.names, chosen.asked.tolist(), strict=True)
    other.set_lamps({name: level for name, level in levels if name in other.lamps.names})
    return other

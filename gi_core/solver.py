"""The solver: background once, then each frame (`frame.py`) from the background and the poses alone."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.base.stage_timer import StageTimer
from gi_core.defaults.choose import choose
from gi_core.discs.contact.stale_receivers import ControlFacts
from gi_core.discs.search import SEARCHES
from gi_core.display.dilation import Drawn
from gi_core.display.probes import probe_irradiance
from gi_core.estimators import DEFAULT, ESTIMATORS
from gi_core.estimators.setting import Setting, number
from gi_core.frames.background import Background, Photons
from gi_core.frames.first_frame import FirstFrame, Progress
from gi_core.frames.frame import (
    NO_FACTS,
    Changes,
    FrameSize,
    Generation,
    changes_of,
    fluxes,
    frame_light,
    light_from_scratch,
)
from gi_core.frames.frame_budget import FrameBudget
from gi_core.frames.light_source import LightSource
from gi_core.gather.reference import ReferenceState
from gi_core.gather.static import StaticGather
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces
from gi_core.model import Model
from gi_core.retrace.broad_phase import ScanBuffers
from gi_core.retrace.cuts import PoseChange
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import as_pose
from gi_core.scene.types import Pose, Scene

CHOICES: dict[str, Mapping] = {"estimator": ESTIMATORS, "search": SEARCHES}


class FrameParts(NamedTuple):
    """Parts that the last frame was computed from, for tests and instruments: to be read, not changed."""

    photons: Photons
    background: Background | None  # None before the first solve
    change: PoseChange | None  # what the mobiles change; None before the first frame


class Solver:
    """Irradiance at the receivers of a scene, kept up to date while mobiles move."""

    def __init__(
        self,
        scene: Scene,
        estimator: str = DEFAULT,
        photons: int | None = None,
        radius: float | None = None,
        neighbours: int | None = None,
        seed: int = 0,
        threads: int | None = None,
        light: str = "photons",
        **others,
    ):
        """Prepare a scene; nothing is traced except a small pilot trace for the defaults.

        photons: how many to trace (>= 0); radius: of the disc [m]; neighbours: k of photon_map;
        None takes the scene file's value, else the rule of `gi_core.defaults.choose`; light: "photons" or "best", see
        `gi_core.frames.light_source`; others: fields of `gi_core.estimators.setting.Setting` that differ from what they
        are there. Raises SceneError.
        """
        self.scene = scene
        self.seed = int(seed)
        self.model = Model(scene, number("threads", threads))
        given = number("photons", photons), number("radius", radius), number("neighbours", neighbours)
        self.chosen = choose(self.model, *given)
        self.scene_size = self.chosen.scene_size
        self.photons = self.chosen.photons
        self._source = LightSource(self.model, self.seed)
        self.setting = Setting(estimator, self.chosen.radius, self.chosen.neighbours)
        self.poses: dict[str, Pose] = self.model.start_poses()
        self.irradiance = np.zeros((len(self.model.object_receivers.areas), 3))
        self.photons_traced = self.paths_gathered = 0  # photons, and paths per receiver of mobiles, of the irradiance
        self.changes = Changes(0, 0, 0)
        self.timings: dict[str, float] = {}
        self.budget = FrameBudget()
        self._photons, self._buffers = Photons(self.model, self.seed), ScanBuffers()
        self._first_frame = FirstFrame(self._photons, self._source, self.scene_size)
        self._generation = Generation(None, None, FrameSize(0, 0), False, NO_FACTS)
        self.configure(estimator=estimator, light=light, **others)

    # -- settings ---------------------------------------------------------------------------------

    def configure(
        self, photons: int | None = None, light: str | None = None, prefix_only: bool | None = None, **changes
    ) -> None:
        """Change settings. Paths stay; solve_steps() repeats only the work that depends on the change.

        light: "photons", the estimator's own; "best", gathered where that is better (`gi_core.frames.light_source`);
        prefix_only: frames of a photon subset take the static part's light from that subset too, not from all
        photons (for measuring); changes: fields of `setting`; None keeps a value. Until solve_steps() has run,
        frames go on with the old settings. Raises SceneError for a bad value.
        """
        photons, setting = number("photons", photons, self.photons), self.setting.changed(CHOICES, **changes)
        source = self._source
        source.choose(
            source.light if light is None else light, source.prefix_only if prefix_only is None else prefix_only
        )
        self.photons, self.setting = photons, setting

    @property
    def light(self) -> str:
        return self._source.light

    @property
    def estimator(self) -> str:
        return self.setting.estimator

    @property
    def radius(self) -> float:
        return self.setting.radius

    @property
    def neighbours(self) -> int:
        return self.setting.neighbours

    @property
    def _goal(self) -> int:
        return self.photons if len(self.model.emitters.kind) else 0

    # -- first frame ------------------------------------------------------------------------------

    def solve(self) -> None:
        """Trace and estimate all photons wanted."""
        for _ in self.solve_steps(pictures=False):
            pass

    def solve_steps(self, pictures: bool = True) -> Iterator[Progress]:
        """Trace and estimate in steps of some 20 ms; with `pictures`, refresh irradiance as photons grow.

        May be abandoned between steps and restarted; traced photons are reused.
        """
        first, shown = self._first_frame, self._generation.background
        b, goal = yield from first.steps(self.setting, shown, lambda: self._goal, pictures, self._show)
        g = self._generation
        as_asked = g.gathered == self.uses_gathered and g.size == self._size(goal)
        if not (b is g.background and g.photons == goal and as_asked):
            yield from first.show(b, self._goal, self._show)
        yield Progress("done", 1.0, False)

    @property
    def memory_full(self) -> bool:
        """Whether memory limits the photons below the number wanted."""
        return self._first_frame.memory_full

    def _show(self, b: Background) -> None:
        self._update(background=b)

    # -- every next frame -------------------------------------------------------------------------

    def move(self, name: str, pose: Pose | np.ndarray) -> None:
        """Put one mobile at a pose (a Pose or a rigid (4, 4) matrix) and update irradiance.

        Raises SceneError for a name that no mobile has and for a pose that is not rigid.
        """
        self.move_all({name: pose})

    def move_all(
        self, poses: Mapping[str, Pose | np.ndarray], photons: int | None = None, paths: int | None = None
    ) -> None:
        """Put several mobiles at new poses and update irradiance once.

        For a faster and noisier frame, photons: one of `prefixes`, None: all; paths: that a receiver of a mobile
        gathers, where its light is gathered, one of `gi_core.frames.light_source.PATHS`, None: 64. Raises SceneError as
        move() does, and for any other number of photons or paths. A move that any exception breaks off has not been
        made.
        """
        self._source.paths(paths)
        if photons is not None and photons not in self.prefixes:
            have = ", ".join(map(str, self.prefixes))
            raise SceneError(f"{self.scene.name}: a frame can use {have} photons, got {photons}")
        checked = {}
        for name, pose in poses.items():
            if name not in self.poses:
                have = ", ".join(f'"{n}"' for n in self.poses) or "none"
                raise SceneError(f'{self.scene.name}: no mobile is called "{name}"; there is {have}')
            checked[name] = as_pose(pose, f'{self.scene.name}: mobile "{name}"')
        self._update(photons, paths, {**self.poses, **checked})

    @property
    def prefixes(self) -> tuple[int, ...]:
        """Numbers of photons that a frame can be computed from, ascending; the last is all."""
        b = self._generation.background
        return () if b is None else tuple(sorted(b.estimate.prefixes))

    def size_within(self, seconds: float) -> tuple[int | None, int | None]:
        """Return the photons and paths, as for move_all(), of the largest frame predicted to fit.

        The prediction uses past frames; without any, the smallest acceptable size (`gi_core.frames.frame_budget`).
        """
        return self.budget.within(seconds, self.prefixes, self.paths_at_rest > 0)

    @property
    def paths_at_rest(self) -> int:
        """Default paths per receiver of a mobile; 0 where none are gathered."""
        return self._size(self._goal).paths

    def _size(self, photons: int, paths: int | None = None) -> FrameSize:
        return FrameSize(photons, self._source.paths(paths) if photons else 0)

    def _update(
        self, photons: int | None = None, paths: int | None = None, poses: dict[str, Pose] | None = None,
        background: Background | None = None,
    ) -> None:  # fmt: skip
        """Compute the frame at some poses, if not the current ones, from a background, if not that on show.

        The visible state changes at the end, or not at all if an exception is raised.
        """
        poses, b = self.poses if poses is None else poses, background or self._generation.background
        if b is None:
            self.poses = poses
            return  # nothing traced yet
        budget = self.budget if b is self._generation.background else FrameBudget()
        clock, size = StageTimer(), self._size(b.estimate.photons if photons is None else photons, paths)
        at = self.model.transforms(poses)
        change, light = frame_light(self.model, self._photons, b, self._source, at, size, self._buffers, clock)
        facts = b.estimate.control_facts
        generation, changes = Generation(b, change, size, self.uses_gathered, facts), changes_of(change)
        gathering = clock.seconds.get("gather", 0.0)
        rest = sum(clock.seconds.values()) - gathering
        budget.took(*size, rest, gathering if self._source.rays_traced else None)
        # No calls from here on, so no exception can leave a partial state.
        self.poses, self.irradiance, self.changes, self.timings = poses, light, changes, clock.seconds
        (self.photons_traced, self.paths_gathered), self._generation, self.budget = size, generation, budget

    @property
    def uses_gathered(self) -> bool:
        """Whether frames start from gathered light: `light` is "best", and it has less noise than photons."""
        return self._source.is_gathered

    @property
    def gathered(self) -> StaticGather | None:
        return self._source.gathered

    # -- gathering --------------------------------------------------------------------------------

    def gather_steps(self, state: ReferenceState | None = None) -> Iterator[Progress]:
        """Gather the static part's light in steps of some 30 ms to 0.7 % noise (`gi_core.gather.static`).

        Used by frames where `light` is "best". May be abandoned between steps and begun again;
        state: what `gathered.state` of an earlier run was, for the same scene and seed. Raises ValueError for another.
        """
        g = self._source.gather(state)
        yield from self._look_at_gathered(g)
        for new in g.steps(self._photons_at_rest):
            if new:
                yield from self._look_at_gathered(g)
            else:
                yield Progress("gathering", g.fraction, False)
        yield Progress("done", 1.0, False)

    def _photons_at_rest(self) -> np.ndarray | None:
        """Return irradiance (n, 3) [W/m2] of static receivers, without mobiles, by all photons shown, if there are."""
        g = self._generation
        return g.background.resting(g.photons) if g.photons else None

    def _look_at_gathered(self, g: StaticGather) -> Iterator[Progress]:
        """Use gathered light if it has less noise than photons; irradiance is then refreshed."""
        b = self._generation.background
        used = self._source.compare(b)
        if used:
            if b.added == self._goal:
                yield from (p._replace(fraction=g.fraction) for p in self._first_frame.find_unreached(b))
            self._update()
        yield Progress("gathering", g.fraction, used)

    def twin(self, fresh: bool = False) -> Solver:
        """Return a solver with separate settings and poses that shares this one's scene and photons.

        It starts as this one is or, `fresh`, with nothing estimated yet. For a second look at the same light, say by
        another estimator: nothing is traced twice. Only one of the two may be at work at a time.
        """
        other = copy.copy(self)
        other.poses, other.budget, other._buffers = dict(self.poses), FrameBudget(), ScanBuffers()
        other._source = self._source.twin(fresh)
        other._first_frame = FirstFrame(self._photons, other._source, self.scene_size)
        if fresh:
            other._generation = self._generation._replace(background=None, change=None, facts=NO_FACTS)
        return other

    # -- answers ----------------------------------------------------------------------------------

    def from_scratch(self, poses: Mapping[str, Pose] | None = None) -> np.ndarray:
        """Return irradiance (R, 3) at poses from all photons, traced again through static part and mobiles.

        Each frame must equal this bit for bit. Acceleration structures are reused; the background is not.
        """
        at, shown = self.model.transforms({**self.poses, **(poses or {})}), self._generation.background
        made = shown or self._first_frame.background(self.setting, None, self._goal)
        paths = self.paths_gathered if self.photons_traced else 0
        return light_from_scratch(self.model, self.seed, shown, made, self._source, at, paths)

    @property
    def resting_irradiance(self) -> np.ndarray:
        """Irradiance (n, 3) [W/m2] of the receivers of the static part, as it is without mobiles; zeros before the
        first solve."""
        g = self._generation
        if not g.photons:
            return np.zeros((self.surfaces.receiver_range(0).stop, 3))
        return self._source.static_irradiance(g.background, g.photons)

    def drawn(self, irradiance: np.ndarray, poses: Mapping[str, Pose] | None = None) -> np.ndarray:
        """Return irradiance (R, 3) as it is to be drawn: `as_drawn()` without the weights."""
        return self.as_drawn(irradiance, poses).irradiance

    def as_drawn(self, irradiance: np.ndarray, poses: Mapping[str, Pose] | None = None) -> Drawn:
        """Return irradiance (R, 3) as it is to be drawn: unreached receivers are filled from lit ones beside them.

        poses: that it belongs to, if not the current ones. The same array, and no weights, where light reaches all
        receivers (`gi_core.display.dilation`), and until all photons wanted have been estimated.
        """
        return self._source.dilated(irradiance, self.model.transforms(poses or self.poses))

    def frame_parts(self) -> FrameParts:
        """Return the parts that the last frame was computed from."""
        return FrameParts(self._photons, self._generation.background, self._generation.change)

    @property
    def receivers(self) -> Receivers:
        """Receivers at the current poses, in the world."""
        return self.model.receivers_at(self.poses)

    @property
    def control_facts(self) -> ControlFacts:
        """Numbers of receivers under artifact control, in general and in the last frame."""
        return self._generation.facts

    @property
    def surfaces(self) -> Surfaces:
        return self.model.surfaces

    @property
    def probe_irradiance(self) -> dict[str, np.ndarray]:
        """Irradiance (3,) [W/m2] at each probe, see `gi_core.display.probes`."""
        b = self._generation.background
        return probe_irradiance(self.model, self.irradiance, b is not None and b.estimate.on_faces)

    @property
    def search_summary(self) -> str:
        """Summary of the disc search over the static part; "" where there is none."""
        b = self._generation.background
        searches = [] if b is None else b.estimate.searches
        return searches[0].summary() if searches else ""

    @property
    def segments_total(self) -> int:
        """Number of background segments of the photons of irradiance."""
        return self._photons.segments(self.photons_traced)

    @property
    def fates(self) -> dict[str, np.ndarray]:
        """Flux (3,) [W] emitted, absorbed, escaped and truncated at the current poses.

        Exact in fixed-point units: emitted = absorbed + escaped + truncated. Covers all photons traced.
        """
        return fluxes(self._photons, self._generation.change)

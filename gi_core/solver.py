"""The solver: background once, then each frame (`frame.py`) from the background and the poses alone."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.base.stage_timer import StageTimer
from gi_core.defaults.choose import choose
from gi_core.discs.contact.stale_receivers import ControlFacts
from gi_core.discs.search import SEARCHES
from gi_core.display.dilation import Drawn, dilated
from gi_core.display.probes import probe_irradiance
from gi_core.estimators import DEFAULT, ESTIMATORS
from gi_core.estimators.setting import Setting, number
from gi_core.frames.background import Background, Photons, add_fates
from gi_core.frames.frame import Changes, FrameSize, changes_of, frame_light, light_from_scratch
from gi_core.frames.frame_budget import FrameBudget
from gi_core.frames.light_source import LightSource
from gi_core.gather.reference import ReferenceState
from gi_core.gather.static import StaticGather
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces
from gi_core.model import Model
from gi_core.photons.prefixes import is_level, next_level
from gi_core.photons.trace import Fates
from gi_core.retrace.broad_phase import ScanBuffers
from gi_core.retrace.cuts import PoseChange
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import as_pose
from gi_core.scene.types import Pose, Scene

STEP_SECONDS = 0.02  # aim of one step of solve_steps(); of 6 ms, a third would be spent on handing out work
FIRST_STEP_SECONDS = 0.08  # the same before the first picture: there is nothing yet that could be dragged
FIRST_PICTURE = 16_384  # photons: a tenth of a second; fewer are confetti
MANY_RECEIVERS = 30_000  # their regions take half a second and more to find
MORE, LATE_MORE = 1.41, 1.19  # times as many photons are shown next: where sums are additive a picture costs a frame,
LATE = 1 << 18  # which is little beside so many photons ...
MUCH_MORE = 2.0  # ... elsewhere everything is estimated anew
CHOICES: dict[str, Mapping] = {"estimator": ESTIMATORS, "search": SEARCHES}
NO_FACTS = ControlFacts(0.0, 0, 0)


class Progress(NamedTuple):
    """Where solve_steps() is."""

    stage: str
    fraction: float  # 0 .. 1 of the photons wanted
    picture: bool  # irradiance was refreshed


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
        """Prepare a scene; nothing is traced yet but for a small pilot that sets the defaults.

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
        self._photons = Photons(self.model, self.seed)
        self._room = ScanBuffers()
        self.timings: dict[str, float] = {}
        self.changes = Changes(0, 0, 0)
        self._facts = NO_FACTS
        self.irradiance = np.zeros((len(self.model.object_receivers.areas), 3))
        self.memory_full = False  # fewer photons than wanted, because memory does not hold more
        self.photons_traced = 0  # photons that self.irradiance belongs to ...
        self.paths_gathered = 0  # ... and paths a receiver of mobiles; 0: those have the photons' light
        self._from_gathered = False  # self.irradiance is
        self._frame: PoseChange | None = None
        self.budget = FrameBudget()
        self._shown: Background | None = None  # what frames are computed from
        self._next: Background | None = None  # what replaces it, being built
        self._made_of: Background | None = None  # self.irradiance is
        self.configure(estimator=estimator, light=light, **others)

    # -- settings ---------------------------------------------------------------------------------

    def configure(
        self, photons: int | None = None, light: str | None = None, prefix_only: bool | None = None, **changes
    ) -> None:
        """Change settings. Paths are kept; solve_steps() does again only what depends on the change.

        light: "photons", the estimator's own; "best", gathered where that is better (`gi_core.frames.light_source`);
        prefix_only: frames of a prefix of the photons take the static part's light from that prefix too, not from all
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

    def _background(self) -> Background:
        """Return the estimate of the background to go on with: the one shown if it still fits."""
        for kept in (self._shown, self._next):
            if kept is not None and kept.setting == self.setting and kept.added <= self._goal:
                return kept
        self._next = Background(self.model, self.setting)
        return self._next

    # -- first frame ------------------------------------------------------------------------------

    def solve(self) -> None:
        """Trace and estimate all photons wanted."""
        for _ in self.solve_steps(pictures=False):
            pass

    def solve_steps(self, pictures: bool = True) -> Iterator[Progress]:
        """Trace and estimate in steps of some 20 ms; with `pictures`, refresh irradiance as photons grow.

        May be abandoned between steps and started again: nothing traced is traced again.
        """
        goal = self._goal
        if pictures and goal and self._shown is None and self._slow_to_build:
            yield from self._first_look(goal)
        b = self._background()
        yield Progress("indexing", 0.0, False)
        yield from (Progress("indexing", 0.0, False) for _ in b.build())
        # A new setting is shown once it has as many photons as what it replaces.
        shown = self._shown.estimate.photons if self._shown not in (None, b) else 0
        due = max(FIRST_PICTURE, shown, _next_shown(b)) if pictures else goal
        while b.added < (goal := self._affordable(b)):
            had, until = b.added, min(goal, max(due, b.added + 1), next_level(b.added))
            stage = self._photons.bring_in(b, until, goal, self._step_seconds if pictures else math.inf)
            yield Progress(stage, b.added / goal, False)
            if b.added == had:
                continue
            if due <= b.added < goal:
                yield from self._show(b)
                due = _next_shown(b)
            elif is_level(b.added) and b.estimate.additive:
                yield from self._prepare(b)
        complete = b is self._made_of and b.estimate.photons == goal == self.photons_traced
        as_asked = self._from_gathered == self.uses_gathered and self.paths_gathered == self._size(goal).paths
        if not (complete and as_asked):
            yield from self._show(b)
        yield Progress("done", 1.0, False)

    @property
    def _slow_to_build(self) -> bool:
        controlled = self.setting.control and ESTIMATORS[self.estimator].controlled
        return controlled and len(self.irradiance) > MANY_RECEIVERS

    @property
    def _step_seconds(self) -> float:
        return FIRST_STEP_SECONDS if self._shown is None else STEP_SECONDS

    def _first_look(self, goal: int) -> Iterator[Progress]:
        """Show the first photons without artifact control: its regions may take seconds."""
        b = Background(self.model, self.setting.changed(CHOICES, control=False))
        yield from (Progress("indexing", 0.0, False) for _ in b.build())
        while b.added < (first := min(FIRST_PICTURE, goal)):
            yield Progress(self._photons.bring_in(b, first, first, self._step_seconds), b.added / goal, False)
        yield from self._show(b)

    def _affordable(self, b: Background) -> int:
        """Return the photons wanted, or as many as memory holds."""
        goal = self._photons.affordable(self._goal, b.estimate.bytes_per_hit)
        self.memory_full = goal < self._goal
        return goal

    def _show(self, b: Background) -> Iterator[Progress]:
        """Prepare what has been added and let frames use it from now on."""
        yield from self._prepare(b)
        if b is not self._shown:
            self.budget = FrameBudget()
        self._shown, self._next = b, None
        self._source.compare(b)
        if b.added == self._goal > 0:
            yield from self._find_unreached()
        self._update()
        yield Progress("estimating", b.added / max(self._goal, 1), True)

    def _find_unreached(self) -> Iterator[Progress]:
        for _ in self._source.find_unreached(self.scene_size, self._shown):
            yield Progress("looking for unreached receivers", 1.0, False)

    def _prepare(self, b: Background) -> Iterator[Progress]:
        for _ in b.estimate.prepare(b.added):
            yield Progress("estimating", b.added / max(self._goal, 1), False)

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
        return () if self._shown is None else tuple(sorted(self._shown.estimate.prefixes))

    def size_within(self, seconds: float) -> tuple[int | None, int | None]:
        """Return the photons and paths, as of move_all(), of the largest frame expected to take no longer.

        Judged by past frames; where there are none, the smallest that makes a picture (`gi_core.frames.frame_budget`).
        """
        return self.budget.within(seconds, self.prefixes, self.paths_at_rest > 0)

    @property
    def paths_at_rest(self) -> int:
        """Paths per receiver of a mobile where nothing else is asked for; 0 where none are gathered."""
        return self._size(self._goal).paths

    def _size(self, photons: int, paths: int | None = None) -> FrameSize:
        return FrameSize(photons, self._source.paths(paths) if photons else 0)

    def _update(
        self, photons: int | None = None, paths: int | None = None, poses: dict[str, Pose] | None = None
    ) -> None:
        """Compute the frame at some poses, if not the current ones, from the background, of a prefix of the photons.

        All that is seen of it changes at the end, or, where anything is raised, not at all.
        """
        poses = self.poses if poses is None else poses
        if self._shown is None:
            self.poses = poses
            return  # nothing traced yet
        clock, size = StageTimer(), self._size(self._shown.estimate.photons if photons is None else photons, paths)
        at = self.model.transforms(poses)
        frame, light = frame_light(self.model, self._photons, self._shown, self._source, at, size, self._room, clock)
        changes, facts = changes_of(frame), self._shown.estimate.control_facts
        gathered, gathering = self.uses_gathered, clock.seconds.get("gather", 0.0)
        rest = sum(clock.seconds.values()) - gathering
        self.budget.took(*size, rest, gathering if self._source.rays_traced else None)
        # From here on nothing is called, so that nothing can be raised half way.
        self.poses, self.irradiance, self._frame, self.changes, self._facts = poses, light, frame, changes, facts
        (self.photons_traced, self.paths_gathered), self._from_gathered = size, gathered
        self.timings, self._made_of = clock.seconds, self._shown

    @property
    def uses_gathered(self) -> bool:
        """Whether frames start from gathered light: it is asked for, and has less noise than the photons."""
        return self._source.is_gathered

    @property
    def gathered(self) -> StaticGather | None:
        return self._source.gathered

    # -- gathering --------------------------------------------------------------------------------

    def gather_steps(self, state: ReferenceState | None = None) -> Iterator[Progress]:
        """Gather the static part's light in steps of some 30 ms until it is known to 0.7 % (`gi_core.gather.static`).

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
        photons = self._shown.estimate.photons if self._shown is not None else 0
        return self._shown.resting(photons) if photons else None

    def _look_at_gathered(self, g: StaticGather) -> Iterator[Progress]:
        """Use gathered light if it has less noise than the photons; irradiance is then new."""
        used = self._source.compare(self._shown)
        if used:
            if self._shown.added == self._goal:
                yield from (p._replace(fraction=g.fraction) for p in self._find_unreached())
            self._update()
        yield Progress("gathering", g.fraction, used)

    def twin(self, fresh: bool = False) -> Solver:
        """Return a solver with settings and poses of its own that shares this one's scene and photons.

        It starts as this one is or, `fresh`, with nothing estimated yet. For a second look at the same light, say by
        another estimator: nothing is traced twice. Only one of the two may be at work at a time.
        """
        other = copy.copy(self)
        other.poses, other.budget, other._next = dict(self.poses), FrameBudget(), None
        other._room = ScanBuffers()
        other._source = self._source.twin(fresh)
        if fresh:
            other._shown = other._made_of = other._frame = None
            other._facts = NO_FACTS
        return other

    # -- answers ----------------------------------------------------------------------------------

    def from_scratch(self, poses: Mapping[str, Pose] | None = None) -> np.ndarray:
        """Return irradiance (R, 3) at poses from every photon traced anew through static and mobiles.

        What each frame must equal bit for bit; structures are prebuilt, nothing of the background is used.
        """
        at, made = self.model.transforms({**self.poses, **(poses or {})}), self._shown or self._background()
        paths = self.paths_gathered if self.photons_traced else 0
        return light_from_scratch(self.model, self.seed, self._shown, made, self._source, at, paths)

    @property
    def resting_irradiance(self) -> np.ndarray:
        """Irradiance (n, 3) [W/m2] of the receivers of the static part, as it is without mobiles; zeros before the
        first solve."""
        if self._shown is None or not self._shown.estimate.photons:
            return np.zeros((self.surfaces.receiver_range(0).stop, 3))
        return self._source.static_irradiance(self._shown, self._shown.estimate.photons)

    def drawn(self, irradiance: np.ndarray, poses: Mapping[str, Pose] | None = None) -> np.ndarray:
        """Return irradiance (R, 3) as it is to be drawn: `as_drawn()` without the weights."""
        return self.as_drawn(irradiance, poses).irradiance

    def as_drawn(self, irradiance: np.ndarray, poses: Mapping[str, Pose] | None = None) -> Drawn:
        """Return irradiance (R, 3) as it is to be drawn: unreached receivers are filled from lit ones beside them.

        poses: that it belongs to, if not the current ones. The same array, and no weights, where light reaches all
        receivers (`gi_core.display.dilation`), and until all photons wanted have been estimated.
        """
        source = self._source
        if source.dilation is None:
            return Drawn(irradiance, None)
        at = self.model.transforms(poses or self.poses)
        return dilated(irradiance, source.unreached, source.dilation.find_moved(irradiance, at))

    def frame_parts(self) -> FrameParts:
        """Return the parts that the last frame was computed from."""
        return FrameParts(self._photons, self._shown, self._frame)

    @property
    def receivers(self) -> Receivers:
        """Receivers at the current poses, in the world."""
        return self.model.receivers_at(self.poses)

    @property
    def control_facts(self) -> ControlFacts:
        """How many receivers artifact control concerns, in general and in the last frame."""
        return self._facts

    @property
    def surfaces(self) -> Surfaces:
        return self.model.surfaces

    @property
    def probe_irradiance(self) -> dict[str, np.ndarray]:
        """Irradiance (3,) [W/m2] at each probe, see `gi_core.display.probes`."""
        on_faces = self._shown is not None and self._shown.estimate.on_faces
        return probe_irradiance(self.model, self.irradiance, on_faces)

    @property
    def search_summary(self) -> str:
        """What the disc search over the static part has built, in words; "" where there is none."""
        searches = [] if self._shown is None else self._shown.estimate.searches
        return searches[0].summary() if searches else ""

    @property
    def segments_total(self) -> int:
        """Segments in the background prefix that irradiance belongs to."""
        return len(self._photons.prefix(self.photons_traced)[0].side) - self.photons_traced

    @property
    def fates(self) -> dict[str, np.ndarray]:
        """Flux (3,) [W] emitted, absorbed, escaped and truncated at the current poses.

        Exact in fixed-point units: emitted = absorbed + escaped + truncated. Covers all photons traced.
        """
        n, total = max(self._photons.count, 1), self._photons.fates
        if self._frame is not None and self._frame.photons == self._photons.count:
            total = add_fates(total, self._frame.fates)
        scale = self.model.emitters.unit_flux / n
        return {name: value * scale for name, value in zip(Fates._fields, total, strict=True)}


def _next_shown(b: Background) -> int:
    """Return how many photons are shown after those that a background has."""
    more = LATE_MORE if b.added >= LATE else MORE
    return int((more if b.estimate.additive else MUCH_MORE) * b.added)

"""The solver: background once, then each frame from the background and the poses alone.

E = E_bg - E~(tails) + E~(branches) on static receivers (report Eq. 2.4, kept from drifting by
computing it afresh from integers each frame); receivers on mobiles from all segments near them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.cuts import Frame, ScanRoom, change, current_segments
from gi_core.defaults import choose
from gi_core.estimators import ESTIMATORS
from gi_core.fixed_point import MAX_PHOTONS
from gi_core.model import Model
from gi_core.paths import PathStore, segments_of
from gi_core.photon_trace import Fates, no_flux, trace_background
from gi_core.pose import as_pose
from gi_core.receivers import Receivers
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Pose, Scene
from gi_core.surfaces import Surfaces

STEP_SECONDS = 0.006  # aim of one step of solve_steps(): the caller's frame allows 8 ms
FIRST_CHUNK = 512  # photons in the first step, before its speed is known
LARGEST_CHUNK = 1 << 16
SCRATCH_CHUNK = 1 << 16


class Progress(NamedTuple):
    """Where solve_steps() is."""

    stage: str
    fraction: float  # 0 .. 1 of the photons wanted
    picture: bool  # irradiance was refreshed


class Changes(NamedTuple):
    """What the mobiles change of the background."""

    photons_cut: int
    old_segments: int  # taken out
    new_segments: int  # put in, heads included


class Solver:
    """Irradiance at the receivers of a scene, kept up to date while mobiles move."""

    def __init__(
        self,
        scene: Scene,
        estimator: str = "tangent_plane",
        photons: int | None = None,
        radius: float | None = None,
        neighbours: int | None = None,
        seed: int = 0,
        threads: int | None = None,
    ):
        """Prepare a scene; nothing is traced yet but for a small pilot that sets the defaults.

        photons: how many to trace (>= 0); radius: of the disc [m]; neighbours: k of photon_map;
        None takes the scene file's value, else the rule of `gi_core.defaults`. Raises SceneError.
        """
        self.scene = scene
        self.seed = int(seed)
        self.model = Model(scene, threads)
        self.chosen = choose(self.model, photons, radius, neighbours)
        self.scene_size = self.chosen.scene_size
        self.photons, self.radius, self.neighbours = self.chosen.photons, self.chosen.radius, self.chosen.neighbours
        self.estimator = estimator
        self.poses: dict[str, Pose] = self.model.start_poses()
        self._store = PathStore()
        self._background_fates = no_flux()
        self._room = ScanRoom()
        self.timings: dict[str, float] = {}
        self.changes = Changes(0, 0, 0)
        self.irradiance = np.zeros((len(self.model.object_receivers.areas), 3))
        self.photons_traced = 0  # photons that self.irradiance belongs to
        self._frame: Frame | None = None
        self.configure(estimator=estimator, photons=self.photons, radius=self.radius, neighbours=self.neighbours)

    # -- settings ---------------------------------------------------------------------------------

    def configure(self, estimator=None, photons=None, radius=None, neighbours=None) -> None:
        """Change settings. Paths are kept; solve_steps() does again only what depends on the change.

        The last irradiance stays until a step refreshes it. Raises SceneError for a bad value.
        """
        estimator = self.estimator if estimator is None else estimator
        if estimator not in ESTIMATORS:
            raise SceneError(f"estimator must be one of {', '.join(ESTIMATORS)}, got {estimator!r}")
        photons = _number("photons", photons, self.photons, 0, MAX_PHOTONS, int)
        radius = _number("radius", radius, self.radius, 0, np.inf, float)
        neighbours = _number("neighbours", neighbours, self.neighbours, 1, 100_000, int)
        kept = getattr(self, "_estimate", None)
        if kept is None or (estimator, radius, neighbours) != (self.estimator, self.radius, self.neighbours):
            self._estimate = None
            self._estimated = 0
        self.estimator, self.photons, self.radius, self.neighbours = estimator, photons, radius, neighbours

    # -- first frame ------------------------------------------------------------------------------

    def solve(self) -> None:
        """Trace and estimate all photons wanted."""
        for _ in self.solve_steps(every_picture=False):
            pass

    def solve_steps(self, every_picture: bool = True) -> Iterator[Progress]:
        """Trace and estimate in steps of some 6 ms, refreshing irradiance at doubling numbers of photons.

        May be abandoned between steps and started again: nothing traced is traced again.
        """
        if self._estimate is None:
            yield Progress("indexing", 0.0, False)
            self._estimate = ESTIMATORS[self.estimator](self.model, self.radius, self.neighbours)
        goal = self._goal()
        seconds_a_photon = STEP_SECONDS / FIRST_CHUNK
        next_picture = max(2048, 2 * self._estimated) if every_picture else goal
        while self._estimated < goal:
            first = self._estimated
            count = int(np.clip(STEP_SECONDS / seconds_a_photon, 64, LARGEST_CHUNK))
            count = min(count, goal - first, max(next_picture - first, 1))
            started = time.perf_counter()
            stage = self._take_in(first, count)
            seconds_a_photon = 0.5 * seconds_a_photon + 0.5 * (time.perf_counter() - started) / count
            picture = self._estimated >= next_picture or self._estimated == goal
            yield Progress(stage, self._estimated / goal, False)
            if picture:
                self._update()
                next_picture = 2 * self._estimated
                yield Progress("estimating", self._estimated / goal, True)
        if self.photons_traced != goal or self._shown != self._setting():
            self._update()
            yield Progress("done", 1.0, True)

    def _goal(self) -> int:
        return self.photons if len(self.model.emitters.kind) else 0

    def _take_in(self, first: int, count: int) -> str:
        """Bring photons first .. first + count - 1 into the background, tracing those that are new."""
        stage = "estimating"
        missing = first + count - self._store.photons
        if missing > 0:
            m, stage = self.model, "tracing"
            paths, fates = trace_background(
                m.accelerator, m.world, m.static, m.emitters, self.seed, self._store.photons, missing
            )
            self._store.append(paths)
            self._background_fates = _add(self._background_fates, fates)
        paths = self._store.prefix(first + count)
        self._estimate.add_background(segments_of(paths, self.model.eps, first, first + count))
        self._estimated = first + count
        return stage

    # -- every next frame -------------------------------------------------------------------------

    def move(self, name: str, pose: Pose | np.ndarray) -> None:
        """Put one mobile at a pose (a Pose or a rigid (4, 4) matrix) and update irradiance.

        Raises SceneError for a name that no mobile has and for a pose that is not rigid.
        """
        self.move_all({name: pose})

    def move_all(self, poses: Mapping[str, Pose | np.ndarray]) -> None:
        """Put several mobiles at new poses and update irradiance once."""
        checked = {}
        for name, pose in poses.items():
            if name not in self.poses:
                have = ", ".join(f'"{n}"' for n in self.poses) or "none"
                raise SceneError(f'{self.scene.name}: no mobile is called "{name}"; there is {have}')
            checked[name] = as_pose(pose, f'{self.scene.name}: mobile "{name}"')
        self.poses.update(checked)
        self._update()

    def _update(self) -> None:
        """Compute the frame of the current poses from the background."""
        if self._estimate is None:  # settings changed, nothing estimated with them yet
            self._estimate = ESTIMATORS[self.estimator](self.model, self.radius, self.neighbours)
        clock = _Stages()
        paths = self._store.prefix(self._estimated)
        at = self.model.transforms(self.poses)
        self._frame = change(self.model, paths, at, self.seed, self._estimate.reach, self._room, clock)
        sums, area = self._estimate.evaluate(self._frame)
        clock("estimate")
        self.irradiance = self._read_out(sums, area, self._estimated)
        clock("read out")
        f = self._frame
        self.changes = Changes(f.heads.size, f.tails.size, f.heads.size + f.branches.size)
        self.photons_traced = self._estimated
        self._shown = self._setting()
        self.timings = clock.seconds

    def _read_out(self, sums: np.ndarray, area: np.ndarray, photons: int) -> np.ndarray:
        if photons == 0:
            return np.zeros(sums.shape)
        return sums * (self.model.emitters.unit_flux / photons) / area[:, None]

    def _setting(self):
        return self.estimator, self.radius, self.neighbours

    _shown = None

    # -- answers ----------------------------------------------------------------------------------

    def from_scratch(self, poses: Mapping[str, Pose] | None = None) -> np.ndarray:
        """Return irradiance (R, 3) at poses from every photon traced anew through static and mobiles.

        What each frame must equal bit for bit; structures are prebuilt, nothing of the background is used.
        """
        at = self.model.transforms({**self.poses, **(poses or {})})
        n = self._estimated
        parts = (
            current_segments(self.model, at, self.seed, first, min(SCRATCH_CHUNK, n - first))[0]
            for first in range(0, n, SCRATCH_CHUNK)
        )
        return self._read_out(*self._estimate.from_scratch(parts, at), n)

    @property
    def receivers(self) -> Receivers:
        """Receivers at the current poses, in the world."""
        return self.model.receivers_at(self.poses)

    @property
    def surfaces(self) -> Surfaces:
        return self.model.surfaces

    @property
    def probe_irradiance(self) -> dict[str, np.ndarray]:
        """Irradiance (3,) [W/m2] at each probe, as at the receivers."""
        first = self.model.first_probe
        return {p.name: self.irradiance[first + k] for k, p in enumerate(self.scene.probes)}

    @property
    def segments_total(self) -> int:
        """Segments in the background prefix that irradiance belongs to."""
        return int(self._store.prefix(self.photons_traced).offsets[-1]) - self.photons_traced

    @property
    def fates(self) -> dict[str, np.ndarray]:
        """Flux (3,) [W] emitted, absorbed, escaped and truncated at the current poses.

        Exact in fixed-point units: emitted = absorbed + escaped + truncated. Covers all photons traced.
        """
        n = max(self._store.photons, 1)
        total = self._background_fates
        if self._frame is not None and self._frame.photons == self._store.photons:
            total = _add(total, self._frame.fates)
        scale = self.model.emitters.unit_flux / n
        return {name: value * scale for name, value in zip(Fates._fields, total, strict=True)}


class _Stages:
    """Seconds a stage: the only clock in gi_core."""

    def __init__(self):
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now


def _add(a: Fates, b: Fates) -> Fates:
    return Fates(*(x + y for x, y in zip(a, b, strict=True)))


def _number(name: str, value, kept, low, high, kind):
    if value is None:
        return kept
    if not np.isfinite(value) or not low <= value <= high or (kind is float and value <= 0):
        rule = "a finite number > 0" if kind is float else f"a whole number from {low} to {high}"
        raise SceneError(f"{name} must be {rule}, got {value!r}")
    return kind(value)

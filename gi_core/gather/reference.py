"""The unbiased reference: irradiance at points by path tracing.

A path bounces from its point, cosine-distributed, until it leaves the scene or Russian roulette ends it. Each vertex
samples delta lights and area lights; emissive faces that bounces hit count with the weight of the balance heuristic
(Veach 1997). A path that leaves the scene receives the sky. There is no radius and no limit on bounces, so no bias.
Photons share only the surfaces, the accelerator and the reflection model.

reference_irradiance() traces the same number of independent paths at every point. ReferenceRounds is progressive: it
distributes paths by need, can be stopped at any time, and continues from its state.

A pilot of a few paths per point estimates the variance of each point. The paths per round follow from the pilot alone,
in proportions that minimise the total error, and the pilot does not enter the mean. The number of paths is thus
independent of their values, and means are unbiased. The paths of a point in one round are one set of random_numbers.py.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.pause import STEP, Pace
from gi_core.base.random_numbers import Stream, seed_of
from gi_core.base.vectors import frame_of
from gi_core.gather.path_tracer import ByBounce, gather
from gi_core.geometry.error import error_less_noise, luminance, relative_noise, small_sample_bias
from gi_core.lights.lamps import Lights, sum_of_lamps
from gi_core.lights.next_event import least_set
from gi_core.model import Model
from gi_core.scene.types import Pose, Scene

TURN = 8  # a dimension after those of path_tracer.py
PATHS_PER_POINT = 1 << 32  # path k of point i has number i * PATHS_PER_POINT + k, for any number of paths


class Gatherer:
    """Points of a scene, prepared for path tracing."""

    def __init__(
        self, scene: Scene, positions, normals, seed: int, poses=None, model=None, mobiles=True,
        levels=None, per_lamp=False, lights=None, about=None,
    ):  # fmt: skip
        """Arguments and errors are those of ReferenceRounds."""
        positions, normals = _checked(positions, normals)
        self.model = model or Model(scene)
        moved = {**self.model.start_poses(), **self.model.checked_poses(poses or {})}
        self._at = self.model.transforms(moved) if mobiles else self.model.static
        lamps = self.model.emitters.lamps
        self.per_lamp = per_lamp and lamps.count > 1
        levels = lamps.full() if levels is None else levels
        self._lights = self.model.lights if self.per_lamp else lights or self.model.lights_at(levels)
        self._seed = seed_of(Stream.REFERENCE, seed)
        self.least_set = least_set(self._lights.delta)
        length = np.sqrt((normals * normals).sum(axis=1))
        self.lit = np.flatnonzero(length > 0)  # points with a normal
        self._normals = normals / np.where(length > 0, length, 1)[:, None]
        self.positions = positions - self.model.origins[0]
        self._lift = self.model.lifts_at(self._at, self.positions, self._normals)
        self._about = None if about is None else frame_of(about)[:2]
        if about is not None:
            self.positions = self.positions + self._lift[:, None] * self._normals

    def paths(
        self, rows: np.ndarray, first: int, count: int, m: int = 0, stream: int = 0, apart: ByBounce | None = None
    ) -> np.ndarray:
        """Return the estimates of paths first .. first + count - 1 of points `rows`, (rows, count, 3) float64 [W/m2].

        per_lamp: light per lamp follows, in 3 G more columns.
        Paths come in sets of 2^m, see random_numbers.py; stream: a `Stream` of independent paths. apart
        (rows x count): takes the light in place of the estimates.
        """
        path = (rows[:, None] * PATHS_PER_POINT + first + np.arange(count)).reshape(-1)
        *start, lift = (np.repeat(a[rows], count, axis=0) for a in (self.positions, self._normals, self._lift))
        seed = seed_of(stream, self._seed)
        if self._about is not None:
            _spread(seed, path, m, *self._about, start[1])
            m = 0  # the starts of a set differ: lights straight from there are joined per path
        of = self.model, self._at, self._lights, seed, path, *start, m
        values = gather(*of, lift=lift, apart=apart)
        if self.per_lamp:
            values = np.concatenate([sum_of_lamps(values), values], axis=1)
        values = values.reshape(len(rows), count, -1)
        if len(self.lit) < len(self.positions):
            values[~np.isin(rows, self.lit)] = 0.0
        return values


@kernel
def _spread(seed, path, m, east, north, normals):
    """Write normals (n, 3) of paths, uniform round the axis across `east` and `north` (3,), of a set evenly spaced."""
    for k in range(len(path)):
        place = (path[k] & ((1 << m) - 1)) / (1 << m)
        turn = 2.0 * math.pi * (place + random_numbers.independent(seed, path[k] >> m, 0, TURN))
        for c in range(3):
            normals[k, c] = math.cos(turn) * east[c] + math.sin(turn) * north[c]


def _checked(positions, normals) -> tuple[np.ndarray, np.ndarray]:
    positions, normals = np.asarray(positions, np.float64), np.asarray(normals, np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3 or normals.shape != positions.shape:
        raise ValueError(
            f"positions and normals must both have shape (n, 3), got {positions.shape} and {normals.shape}"
        )
    if not (np.isfinite(positions).all() and np.isfinite(normals).all()):
        raise ValueError("positions and normals must be finite")
    return positions, normals


# Independent paths of the pilot: of all points together, then the bounds per point. Light by way of a mirror may come
# on one path in fifty; eight paths missed it (docs/decisions/gathered-light.md).
PILOT, FEWEST_PILOT, MOST_PILOT = 1 << 18, 8, 64
AIM = 0.01  # relative l1 error for which sets are sized, assuming independent paths ...
ROUNDS = 8  # ... in this many rounds; stratified sets need about half of them
FLOOR = 0.1  # of the mean deviation: least deviation of a point, since a pilot's paths may all miss
LARGEST_SQUARE = 1e60  # squared irradiance of the strongest lamps in a scene file
PATHS_AT_ONCE = 1 << 16  # where nothing waits


class ReferenceState(NamedTuple):
    """State of progressive path tracing at n points."""

    pilot: np.ndarray  # (n, 2) float64 [W/m2], luminance: mean and deviation of a path; nan: not yet traced
    log2_set: np.ndarray  # (n,) int8, a round traces 2^m paths at a point; -1: not yet known
    sets: np.ndarray  # (n,) int32, rounds traced at each point
    mean: np.ndarray  # (n, 3) float64 [W/m2], irradiance, 0 before the first set; or more channels
    squares: np.ndarray  # as `mean`, sum of squared differences of sets from the mean

    @classmethod
    def empty(cls, n: int, channels: int = 3) -> ReferenceState:
        """Return the state of n points before the first path."""
        zeros = np.zeros((n, channels))
        return cls(np.full((n, 2), np.nan), np.full(n, -1, np.int8), np.zeros(n, np.int32), zeros, zeros.copy())

    def is_sound(self, n: int, channels: int = 3) -> bool:
        """Return whether this can be a state of n points: files hold any numbers."""
        shapes = (n, 2), (n,), (n,), (n, channels), (n, channels)
        if tuple(a.shape for a in self) != shapes or not all(map(may_be_light, (self.mean, self.squares))):
            return False
        m, never = self.log2_set.astype(np.int64), self.sets == 0
        sizes = ((m >= -1) & (m <= random_numbers.LARGEST_SET) & (never | (m >= 0))).all()
        piloted = np.isnan(self.pilot) | ((self.pilot >= 0) & (self.pilot < LARGEST_SQUARE))
        return bool(
            sizes
            and (self.sets >= 0).all()
            and piloted.all()
            and (self.paths < PATHS_PER_POINT).all()
            and not self.mean[never].any()
        )

    @property
    def rounds(self) -> int:
        """Rounds that have come to all points; 0 without points."""
        return int(self.sets.min()) if len(self.sets) else 0

    @property
    def standard_error(self) -> np.ndarray:
        """Standard error of the mean, float64 [W/m2], shaped as `mean`; inf before the second set."""
        sets = np.maximum(self.sets, 2)[:, None].astype(np.float64)
        return np.where(self.sets[:, None] < 2, np.inf, np.sqrt(self.squares / (sets * (sets - 1))))

    @property
    def paths(self) -> np.ndarray:
        """Paths in the mean of each point, (n,) int64, without the pilot's."""
        return self.sets.astype(np.int64) << np.maximum(self.log2_set, 0).astype(np.int64)

    def noise(self, weights: np.ndarray, rows=slice(None)) -> float:
        """Return the relative l1 noise, inf before two rounds, nan without points."""
        if len(self.sets) and self.rounds < 2:
            return float("inf")
        error = self.standard_error[:, :3] / small_sample_bias(self.sets[:, None])
        return relative_noise(luminance(error), self.mean[:, :3], weights, rows)

    def error(self, E: np.ndarray, weights: np.ndarray) -> float:
        """Return the relative l1 error of E (n, 3) [W/m2] without the noise of this, at points of two sets or more."""
        at = np.flatnonzero(self.sets > 1)
        deviation = luminance(self.standard_error[at, :3]) / small_sample_bias(self.sets[at])
        return error_less_noise(E[at], self.mean[at, :3], deviation, weights[at])


def may_be_light(values: np.ndarray) -> bool:
    """Return whether all values can be irradiance [W/m2] or its square."""
    return bool(((values >= 0) & (values < LARGEST_SQUARE)).all())


def reference_irradiance(
    scene: Scene, positions: np.ndarray, normals: np.ndarray, paths: int, seed: int,
    poses: Mapping[str, Pose | np.ndarray] | None = None, model: Model | None = None,
    levels: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return irradiance at points and its standard error, both (n, 3) float64 [W/m2], by independent paths.

    positions (n, 3) [m] and normals (n, 3) in the world; `paths` >= 1 per point; `poses`: of mobiles by name, where
    they differ from the scene's. `model` is reused if given. levels (G, 3): of the lamps, None: those of the scene
    file. The result depends on seed and arguments alone. Points without a normal get 0. The standard error of one path
    is inf. Raises SceneError for a bad pose, ValueError for bad points or paths.
    """
    if not 1 <= int(paths) < PATHS_PER_POINT:
        raise ValueError(f"paths must be a whole number >= 1, got {paths}")
    gathered = ReferenceRounds(scene, positions, normals, seed, None, poses, model, levels=levels)
    gathered.state.log2_set[:] = 0
    while len(gathered.state.sets) and gathered.state.rounds < paths:
        gathered.step(PATHS_AT_ONCE, int(paths))
    return gathered.state.mean, gathered.state.standard_error


class Rounds:
    """Rounds of paths at points, without end. Each step changes the arrays of `state`, a ReferenceState, in place."""

    def __init__(
        self, paths: Callable[..., np.ndarray], pilot: Callable[[np.ndarray], np.ndarray], weights: np.ndarray | None,
        state: ReferenceState, rounds: int = ROUNDS, smoothed: Callable[[np.ndarray], np.ndarray] = np.asarray,
        least: int = 0, smaller: int = 0,
    ):  # fmt: skip
        """paths(rows, first, count, m, stream): estimates (rows, count, channels), see `Gatherer.paths`.

        pilot(estimates): luminance (rows, count) whose deviation distributes the paths; smoothed(pilots (n, 2)): pilots
        that distribute them; weights, rounds: see ReferenceRounds.
        least: log2 of the paths of a set, at least. smaller: log2 of how much smaller sets are at first, until
        enlarge().
        """
        self.paths, self._pilot, self._smoothed = paths, pilot, smoothed
        self._weights, self._rounds, self.state = weights, rounds, state
        self._least, self.smaller = least, smaller
        self._pace = Pace(1e-5, 1 << 6, PATHS_AT_ONCE)
        self._parts: list[np.ndarray] = []  # estimates of the first paths of a set that takes several steps

    def step(self, paths: int | None = None, end: int | None = None) -> None:
        """Trace paths of the pilot or of one round; end: of several rounds at once, up to that one.

        paths: how many; None: as many as take STEP seconds. Results do not depend on it.
        """
        if not len(self.state.sets):
            return
        began = time.perf_counter()
        rows, count = self._trace(self._pace.fit(STEP) if paths is None else paths, end)
        self._pace.took(len(rows) * count, time.perf_counter() - began)

    @property
    def done(self) -> float:
        """Rounds that have come to all points, as a number of whole ones."""
        return self.state.rounds / (1 << self.smaller)

    def enlarge(self, times: int) -> None:
        """Clear all sums, and give each set 2^times as many paths; `smaller` falls by `times`."""
        s = self.state
        self.smaller -= times
        s.log2_set[:] = -1
        for a in (s.sets, s.mean, s.squares):
            a[:] = 0

    def _trace(self, paths: int, end: int | None) -> tuple[np.ndarray, int]:
        """Trace so many paths, at least one; return the rows and the paths of each."""
        s = self.state
        if self._weights is not None and len(rows := np.flatnonzero(np.isnan(s.pilot[:, 0]))):
            pilot = min(max(PILOT // len(s.sets), FEWEST_PILOT), MOST_PILOT)
            rows = rows[: max(1, paths // pilot)]
            light = self._pilot(self.paths(rows, 0, pilot, 0, Stream.PILOT))
            s.pilot[rows] = np.stack([light.mean(axis=1), light.std(axis=1, ddof=1)], axis=1)
            return rows, pilot
        if s.log2_set.min() < 0:
            w, rounds = self._weights, self._rounds
            whole = 4 if w is None else set_sizes(self._smoothed(s.pilot), w, rounds)  # log2 of paths
            s.log2_set[:] = np.maximum(whole - self.smaller, self._least)
        now = s.rounds
        sets = 1 if end is None else min(end - now, max(1, paths // int((1 << s.log2_set.astype(np.int64)).sum())))
        due = np.flatnonzero(s.sets == now)
        m = int(s.log2_set[due].min())
        rows = due[s.log2_set[due] == m]
        if self._parts:
            sets, rows = 1, rows[:1]  # the one point whose set is begun
        whole = sets << m
        rows = rows[: max(1, paths // whole)]
        first = sum(part.shape[1] for part in self._parts)
        count = min(max(1, paths), whole - first)
        self._parts.append(self.paths(rows, (now << m) + first, count, m, 0))
        if first + count >= whole:
            take_in(np.concatenate(self._parts, axis=1), 1 << m, rows, s.sets, s.mean, s.squares)
            self._parts = []
        return rows, count


class ReferenceRounds(Rounds):
    """Rounds of the reference's paths at points of a scene."""

    def __init__(
        self, scene: Scene, positions: np.ndarray, normals: np.ndarray, seed: int, weights: np.ndarray | None = None,
        poses: Mapping[str, Pose | np.ndarray] | None = None, model: Model | None = None,
        state: ReferenceState | None = None, mobiles: bool = True, rounds: int = ROUNDS,
        levels: np.ndarray | None = None, per_lamp: bool = False,
        smoothed: Callable[[np.ndarray], np.ndarray] = np.asarray, lights: Lights | None = None,
        about: np.ndarray | None = None,
    ):  # fmt: skip
        """Points, poses and options are those of reference_irradiance(); without `mobiles`, of the static part alone.

        weights (n,) >= 0, usually areas: paths are distributed to minimise the weighted l1 error; None: uniformly.
        state: continue from a copy of it, with the same bits as without a break. rounds: rounds of independent paths
        until AIM; more rounds give earlier results, fewer are better stratified. per_lamp: light of G > 1 lamps follows
        that of all, in 3 G more channels, at the levels of the scene file. lights: in place of the model's at `levels`.
        about (3,): cylindrical irradiance instead, the mean over all normals across this axis; rays start off the
        surfaces of `normals`. Raises SceneError for a bad pose, ValueError for bad points, weights, or a state of other
        points.
        """
        gatherer = Gatherer(scene, positions, normals, seed, poses, model, mobiles, levels, per_lamp, lights, about)
        n = len(gatherer.positions)
        if weights is not None:
            weights = np.asarray(weights, np.float64)
            if weights.shape != (n,) or not (np.isfinite(weights).all() and (weights >= 0).all()):
                raise ValueError(f"weights must be {n} finite numbers >= 0, one per point")
        if state is not None and len(state.sets) != n:
            raise ValueError(f"the state has {len(state.sets)} points, but there are {n}")
        channels = 3 + gatherer.model.emitters.lamps.channels * gatherer.per_lamp
        if state is not None and state.mean.shape[1] != channels:
            raise ValueError(f"the state has {state.mean.shape[1]} channels, but there are {channels}")
        state = ReferenceState.empty(n, channels) if state is None else ReferenceState(*(a.copy() for a in state))
        least = gatherer.least_set
        super().__init__(gatherer.paths, luminance_of_all, weights, state, rounds, smoothed, least=least)


def luminance_of_all(values: np.ndarray) -> np.ndarray:
    """Return the luminance (n, count) of estimates (n, count, channels) of all lamps together."""
    return luminance(values[..., :3])


def set_sizes(pilot: np.ndarray, weights: np.ndarray, rounds: int = ROUNDS) -> np.ndarray:
    """Return m (n,) int8 of the sets of 2^m paths, from pilots (n, 2) and weights (n,).

    For a given total, paths proportional to (w s)^(2/3) minimise the sum of w s / sqrt(paths).
    """
    mean, deviation = pilot.T
    light = float((weights * mean).sum())
    if light <= 0:
        return np.zeros(len(pilot), np.int8)
    scatter = np.maximum(deviation, FLOOR * (weights * deviation).sum() / weights.sum())
    share = np.maximum(weights * scatter, 1e-300) ** (2 / 3)
    needed = (np.sqrt(2 / np.pi) * (weights * scatter / np.sqrt(share)).sum() / (AIM * light)) ** 2 * share
    m = np.round(np.log2(np.maximum(needed / rounds, 1)))
    return np.minimum(m, random_numbers.LARGEST_SET).astype(np.int8)


@kernel
def take_in(values, size, rows, sets, mean, squares):
    """Add sets of `size` paths, values (rows, paths, channels), to the running means and squares (Welford 1962)."""
    for k in range(len(rows)):
        i = rows[k]
        for first in range(0, values.shape[1], size):
            sets[i] += 1
            for c in range(values.shape[2]):
                total = 0.0
                for j in range(first, first + size):
                    total += values[k, j, c]
                off = total / size - mean[i, c]
                mean[i, c] += off / sets[i]
                squares[i, c] += off * (total / size - mean[i, c])

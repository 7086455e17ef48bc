"""Final gathering of the static part's light (Reichert 1992; Jensen 2001): one bounce, then the photons' light.

A bounce averages the photons' noise over all surfaces that a receiver sees. Shadow rays go to points on lamps chosen
among candidates (`lights/candidates.py`). So variance is low, and final gathering converges much sooner than full paths
(`reference.py`), but it inherits the photons' error one bounce away.

Paths come in pairs of sets; each pair has twice as many paths as the last, because large sets are better stratified.
The differences within pairs give the noise.
"""

from __future__ import annotations

import copy
import time
from typing import NamedTuple, cast

import numpy as np

from gi_core.base.pace import STEP, Pace
from gi_core.base.pause import pause
from gi_core.base.threads import run_ranges
from gi_core.gather.path_ends import BounceHits, OneBounce, arrive, starts
from gi_core.gather.path_tracer import BLOCK, add_unblocked, scatter
from gi_core.geometry.error import luminance, relative_noise, small_sample_bias
from gi_core.lights.candidates import Candidates, candidates, join_lamps
from gi_core.lights.mix import sum_of_lamps
from gi_core.lights.next_event import picks
from gi_core.model import Model
from gi_core.rays.accelerator import FAR
from gi_core.rays.all_objects import nearest_in_world

STREAM = 0x51D3  # separates these random numbers from those of photons and reference with the same seed
SMALLEST, LARGEST = 3, 10  # log2 of the paths of the first and last sets
FIRST_SECONDS = 1e-5  # per path, before measurements
LEAST, MOST = 1 << 8, 1 << 16  # paths per step
SET = 1 << 40  # stride of set numbers, above the number of receivers
CANDIDATE_SETS = 32  # of points on lamps, one of them for each receiver: neighbours should not share their errors


class BounceSums(NamedTuple):
    """Sums of single bounces at n receivers, by which they go on."""

    per_lamp: np.ndarray  # (n, 3 G) float64 [W/m2]
    last: np.ndarray  # as `per_lamp`, of the last pair alone
    variance: np.ndarray  # (n, 3) float64 [W2/m4]
    lamp_variance: np.ndarray  # (n, 3 G) float64 [W2/m4]
    pairs: int  # of sets


class FinalGather:
    """Irradiance at n receivers of the static part without mobiles.

    positions (n, 3) [m]; normals (n, 3), 0: black; weights (n,) of their noise.
    """

    def __init__(self, model: Model, seed: int, positions: np.ndarray, normals: np.ndarray, weights: np.ndarray):
        self._model, self._seed = model, (int(seed) ^ (STREAM << 40)) & (2**63 - 1)
        self._starts = positions, normals, model.lifts
        self.weights, self._lit = weights, np.flatnonzero((normals * normals).sum(axis=1) > 0)
        self._lights = model.lights
        shape = len(positions), self._lights.channels
        self._variance, self._lamp_variance = np.zeros(positions.shape), np.zeros(shape)
        self._pace = Pace(FIRST_SECONDS, LEAST, MOST)
        self._pairs = 0  # of sets
        self.paths = 0  # per receiver in `mean`; 0: no result yet
        self.per_lamp = self.last = np.zeros(shape)  # (n, 3 G) float64 [W/m2]; `last`: of the last pair alone
        self.mean = np.zeros(positions.shape)  # (n, 3) float64 [W/m2], of all lamps

    def copied(self, model: Model | None) -> FinalGather:
        """Return a copy that goes on from here, of a model with the same `static_key`, None: to be kept without one."""
        other = copy.copy(self)
        other._model = cast(Model, model)
        return other

    @property
    def sums(self) -> BounceSums:
        return BounceSums(self.per_lamp, self.last, self._variance, self._lamp_variance, self._pairs)

    @sums.setter
    def sums(self, sums: BounceSums) -> None:
        self.per_lamp, self.last, self._variance, self._lamp_variance, self._pairs = sums
        self.mean = sum_of_lamps(self.per_lamp)
        self.paths = sum(2 << min(SMALLEST + pair, LARGEST) for pair in range(sums.pairs))

    @property
    def standard_error(self) -> np.ndarray:
        """Standard error of the mean, (n, 3) [W/m2]; rough per receiver, as it comes from few differences."""
        return np.sqrt(self._variance)

    @property
    def lamp_error(self) -> np.ndarray:
        """Standard error of the light of each lamp, (n, 3 G) [W/m2]."""
        return np.sqrt(self._lamp_variance)

    @property
    def noise(self) -> float:
        """Relative l1 noise of the mean, inf before the first result."""
        if not self.paths:
            return float("inf")
        return relative_noise(luminance(self.standard_error) / small_sample_bias(2), self.mean, self.weights)

    def add_pair(self, light: np.ndarray) -> None:
        """Gather the next pair, with a pause every 10 ms. One that is broken off is gathered again.

        light: current irradiance per lamp (n, 3 G) [W/m2] of these receivers.
        """
        m = min(SMALLEST + self._pairs, LARGEST)
        halves = np.zeros((2, *self.last.shape))
        for half in range(2):
            number, first = 2 * self._pairs + half, 0
            on_lamps = candidates(self._seed ^ (number << 20), 1 << m, self._lights.area, CANDIDATE_SETS)
            while first < len(self._lit):
                began, rows = time.perf_counter(), self._lit[first : first + max(1, self._pace.fit(STEP) >> m)]
                self._gather(rows, number, m, on_lamps, light, halves[half])
                first += len(rows)
                self._pace.took(len(rows) << m, time.perf_counter() - began)
                pause()
        self._take_in(halves, 2 << m)

    def _take_in(self, halves: np.ndarray, paths: int) -> None:
        """Average the last pair with those before; all results change after the last pause."""
        total = self.paths + paths
        a, b = self.paths / total, paths / total
        last = 0.5 * (halves[0] + halves[1])
        pause()
        per_lamp = a * self.per_lamp + b * last
        pause()
        apart = halves[0] - halves[1]
        pause()
        lamp_variance = a * a * self._lamp_variance + b * b * 0.25 * apart**2
        pause()
        self._variance = a * a * self._variance + b * b * 0.25 * sum_of_lamps(apart) ** 2
        self.last, self.per_lamp, self._lamp_variance = last, per_lamp, lamp_variance
        self.mean, self.paths, self._pairs = sum_of_lamps(per_lamp), total, self._pairs + 1

    def _gather(
        self, rows: np.ndarray, number: int, m: int, on_lamps: Candidates, field: np.ndarray, out: np.ndarray
    ) -> None:
        """Write the estimates of set `number` of 2^m paths at receivers."""

        def work(_, first, last):
            at_once = max(1, BLOCK >> m)
            for a in range(first, last, at_once):
                part = rows[a : min(a + at_once, last)]
                out[part] = self._block(part, number, m, on_lamps, field) / (1 << m)

        run_ranges(work, len(rows), self._model.threads, max(1, BLOCK >> (m + 2)))

    def _block(self, rows: np.ndarray, number: int, m: int, on_lamps: Candidates, field: np.ndarray) -> np.ndarray:
        model, lights, s, world = self._model, self._lights, self._model.surfaces, self._model.world
        n, count, at, far = len(rows), len(rows) << m, model.static, float(np.float32(FAR * world.size))
        start, total = [a[rows] for a in self._starts], np.zeros((n, lights.channels))
        path = (number * SET + rows[:, None] << m) + np.arange(1 << m)
        pick = picks(self._seed, m, 0, path, lights.delta)
        ends = starts(rows, np.arange(n), *start)
        rays = join_lamps(world.bsdfs, on_lamps, pick, 1 << m, ends, lights, far)
        add_unblocked(model, at, rays, len(rays.row), total)
        each = (np.repeat(a, 1 << m, axis=0) for a in start)
        ends = starts(path.reshape(-1), np.repeat(np.arange(n), 1 << m), *each)
        origin, direction = np.empty((2, count, 3), np.float32)
        scatter(world.bsdfs, self._seed, m, 0, ends, origin, direction)
        limits = np.full(count, far, np.float32)
        distance, face = nearest_in_world(model.accelerator, at, origin, direction, limits)
        bounces = BounceHits(1 << m, np.arange(n + 1) << m, start[1], at.rotation[0], direction, distance, face)
        ending = OneBounce(s.corner_front, s.corner_back, field)
        arrive(world, at, lights.area, lights.sky, bounces, ending, total)
        return total

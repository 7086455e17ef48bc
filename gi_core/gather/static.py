"""Irradiance of the static part without mobiles, by path tracing, in two phases.

Phase 1 is radiosity by kept bounces (`radiosity.py`). Its noise is low within seconds, but light at hits is
interpolated. Whole paths at a sample of receivers measure its error. Phase 2 traces whole paths at all receivers in
rounds (`reference.py`), without bias. It begins when phase 1 has more bias than noise, or little noise, and its light
is used once it has less noise than phase 1 has error. Both are denoised in proportion to their noise (`denoise.py`).
Errors count by importance (`importance.py`), and paths are distributed by area.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np

from gi_core.base.pause import Progress, pause
from gi_core.base.random_numbers import Stream, seed_of
from gi_core.gather.denoise import averaged, denoise
from gi_core.gather.estimate import Estimate, Source, better, variance_per_lamp
from gi_core.gather.importance import areas_in_reach, visual_shares
from gi_core.gather.radiosity import Bounces, Radiosity
from gi_core.gather.reference import ReferenceRounds, ReferenceState, may_be_light
from gi_core.gather.reference_sample import ReferenceSample, draw_by_area
from gi_core.geometry.error import luminance, relative_noise
from gi_core.lights.lamps import sum_of_lamps
from gi_core.model import Model

STAGE = "gathering"
ALL_PATHS = 1 << 30  # paths per receiver of phase 1: as many as there are, before phase 2
ENOUGH = 0.007  # relative l1 noise at which phase 2 ends; with interpolation the error is within a percent
LOW = 1.4  # times ENOUGH: noise at which phase 1 ends, and below which whole paths take over
STATIC_ROUNDS = 32  # until 1 % noise; the first noise is known after two
FIRST_PHASE = 0.15  # of the time, roughly
SAMPLE = 512  # receivers, drawn by weight, that measure the error of phase 1 ...
CLEAR = 2.0  # ... by paths of so many times its noise: their squares are subtracted


class ErrorSample(NamedTuple):
    """Receivers, how often each was drawn, and the state of whole paths there."""

    rows: np.ndarray  # (k,) int64
    times: np.ndarray  # (k,) float64
    state: ReferenceState

    @property
    def reference(self) -> ReferenceSample:
        s = self.state
        return ReferenceSample(self.rows, self.times, s.mean, s.noise(self.times), 1.0)

    def error(self, E: np.ndarray) -> float:
        """Return the relative l1 error of irradiance E (R, 3) without the sample's noise; 0 before two rounds."""
        return self.state.error(E[self.rows], self.times)


class Kept(NamedTuple):
    """What gathering goes on from, also in another session; None: nothing yet."""

    estimate: Estimate | None
    state: ReferenceState | None
    sample: ErrorSample | None
    shares: np.ndarray  # (n,) float64, by which places count for their light; (0,): not known
    numbers: np.ndarray  # (4,) float64: noise; first phase, fraction, done; least noise of whole paths


def denoised(
    model: Model, seed: int, weights: np.ndarray, per_lamp: np.ndarray, standard_error: np.ndarray,
    lamp_error: np.ndarray, exact: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """Return denoised light (n, 3 G), its variance (n, G) as of Estimate, and the share of its noise that is left.

    Arguments as of StaticGather._take_over; weights (n,): of the share.
    """
    if exact is not None:
        per_lamp = per_lamp - exact
    several = per_lamp if per_lamp.shape[1] > 3 else None
    result = denoise(sum_of_lamps(per_lamp), standard_error, model.adjacency, seed, model.threads, several)
    light = result.irradiance.copy()
    light += 0.0 if exact is None else exact
    of_lamps = standard_error if several is None else lamp_error
    of_lamps = luminance(of_lamps.reshape(len(light), -1, 3))
    return light, variance_per_lamp(result.left * luminance(standard_error), of_lamps), result.share(weights)


class StaticGather:
    """Irradiance of the static part's receivers without mobiles, by lamp.

    estimate: the light so far, denoised, None before the first result; noise: its relative l1 noise before denoising,
    inf before. state: the whole paths, or None. All errors are those at the levels of the scene file.
    """

    def __init__(self, model: Model, seed: int):
        rows = model.surfaces.receiver_range(0)
        points, normals = model.evaluation_points
        self._areas = model.object_receivers.areas[rows].copy()
        self._model, self._seed, self._channels = model, seed, model.emitters.lamps.channels
        self._points = points[rows], normals[rows]
        self._radiosity = Radiosity(model, seed, *self._points, self._areas)
        self._in_reach = areas_in_reach(model)[rows]
        self._weigh(np.zeros(0))
        self._sample: ErrorSample | None = None
        self._sampled: ReferenceRounds | None = None  # that change its state
        self._near = model.adjacency
        self.state: ReferenceState | None = None
        self.noise = float("inf")
        self.estimate: Estimate | None = None
        self._first_phase = self._fraction = 0.0  # fractions done
        lit = len(self.weights) and len(model.emitters.kind)
        self._left = float("inf" if lit else "nan")  # least noise of whole paths at a complete round

    def _weigh(self, shares: np.ndarray) -> None:
        """Count places by shares (n,) from now on, see visual_shares(); (0,): all alike."""
        self._shares, shares = shares, shares if len(shares) else np.ones(len(self._areas))
        self.weights = self._radiosity.weights = shares * self._in_reach
        self._paid = shares * self._areas
        # Probes have no area but need light: they get the mean weight.
        self._paid[self._model.first_probe :] = self._paid.mean() if len(shares) else 0.0

    def _weigh_by(self, light: np.ndarray) -> None:
        """Count places by their light (n, 3) [W/m2], once."""
        if not len(self._shares):
            E = self._pooled(luminance(light)[:, None])[:, 0]
            self._weigh(visual_shares(self._model, E, self._areas))

    def copied(self, model: Model | None) -> StaticGather:
        """Return a copy that goes on from here; model: with the same `static_key`, None: to be kept without one."""
        g = copy.copy(self)
        g._model, g._radiosity, g._sampled = cast(Model, model), self._radiosity.copied(model), None
        g.state = None if self.state is None else ReferenceState(*(a.copy() for a in self.state))
        if self._sample is not None:
            g._sample = self._sample._replace(state=ReferenceState(*(a.copy() for a in self._sample.state)))
        return g

    def kept(self, shown: Estimate | None = None) -> Kept:
        """Return the state that gathering goes on from. shown: the light on show, kept if it has less error."""
        numbers = np.array([self.noise, self._first_phase, self._fraction, self._left])
        return Kept(better(self.estimate, shown), self.state, self._sample, self._shares, numbers)

    def empty(self) -> Kept:
        """Return arrays of the shapes and dtypes of kept(), or of more rows, that take no memory."""
        n, c, k = len(self._areas), self._channels, SAMPLE

        def zeros(*shape: int) -> np.ndarray:
            return np.broadcast_to(np.zeros(()), shape)

        estimate = Estimate(Source.RADIOSITY, zeros(n, c), zeros(n, c // 3), 0.0, 0.0)
        sample = ErrorSample(np.zeros(k, np.int64), np.zeros(k), ReferenceState.empty(k))
        return Kept(estimate, ReferenceState.empty(n, self._path_channels), sample, zeros(n), zeros(4))

    @property
    def _path_channels(self) -> int:
        return 3 + self._channels * (self._channels > 3)

    def go_on_from(self, kept: Kept) -> bool:
        """Go on from another session's state; return False, and change nothing, if it is of other receivers."""
        n, c, (light, state, sample, shares, numbers) = len(self._areas), self._channels, kept
        sound = shares.shape in ((0,), (n,)) and may_be_light(shares)
        sound &= numbers.shape == (4,) and bool((numbers >= 0).all())
        if light is not None:
            sound &= (light.light.shape, light.variance.shape) == ((n, c), (n, c // 3))
            sound &= may_be_light(light.light) and may_be_light(light.variance) and min(light.noise, light.error) >= 0
        if state is not None:
            sound &= state.is_sound(n, self._path_channels)
        if sample is not None:
            k = len(sample.rows)
            sound &= sample.state.is_sound(k) and sample.times.shape == (k,) and may_be_light(sample.times)
            sound &= bool(((sample.rows >= 0) & (sample.rows < n)).all())
        if not sound:
            return False
        self.estimate, self.state, self._sample = light, state, sample
        self.noise, self._first_phase, self._fraction, self._left = numbers.tolist()
        if len(shares):
            self._weigh(shares)
        return True

    @property
    def bounces(self) -> Bounces:
        """Bounces of phase 1, to begin an edited scene with."""
        return self._radiosity.bounces

    @property
    def is_measured(self) -> bool:
        """Whether whole paths tell errors."""
        return self._sample is not None and self._sample.state.rounds > 1

    def error_of(self, E: np.ndarray) -> float:
        """Return the relative l1 error of other irradiance E (n, 3) [W/m2] by the sample; 0 before there is one."""
        return 0.0 if self._sample is None else self._sample.error(E)

    def is_early(self, paths: int) -> bool:
        """Whether there are no whole paths, and fewer than so many new ones of phase 1 per receiver."""
        r = self._radiosity
        return not self.enough and self.state is None and r.paths < paths and not r.is_complete

    @property
    def enough(self) -> bool:
        """Whether phase 2 has ended. True without receivers or without light, where the noise is nan."""
        return not self._left > ENOUGH

    @property
    def fraction(self) -> float:
        """Fraction of the paths needed, 0 .. 1, as predicted so far; phase 1 is FIRST_PHASE of it. It never falls."""
        if self.enough:
            return 1.0
        paths = (ENOUGH / self._left) ** 2
        if self.state is not None and len(sets := self.state.sets):
            measured = math.isfinite(self._left)
            paths = float(sets.mean()) / (self.state.rounds / paths if measured else STATIC_ROUNDS)
        now = FIRST_PHASE * self._first_phase + (1 - FIRST_PHASE) * min(paths, 1.0)
        self._fraction = max(self._fraction, now)
        return self._fraction

    def progress(self, picture: bool = False) -> Progress:
        """Return the progress of gathering."""
        return Progress(STAGE, self.fraction, picture)

    def gather(self, new: Callable[[], None] = lambda: None, early: float = math.inf) -> None:
        """Gather until it is enough, with a pause every 10 ms; may be broken off and begun again, with the same result.

        new: called where `estimate` is new.
        early: ends once phase 1 has so many paths per receiver, before whole paths; ALL_PATHS: at its end.
        """
        if not self.enough:
            self._iterate_bounces(new, early)
            if early == math.inf:
                self._whole_paths(new)

    def _iterate_bounces(self, new: Callable[[], None], early: float) -> None:
        f = self._radiosity
        noise_of_paths = np.inf if self.state is None else self._noise_of_paths(self.state)
        if self._first_phase == 1.0:
            return

        biased = not noise_of_paths > LOW * ENOUGH
        while not biased and f.noise > LOW * ENOUGH and not f.is_complete and f.paths < early:
            f.add_pair()
            self._weigh_by(f.mean)
            done = min((LOW * ENOUGH / f.noise) ** 2, 1.0) if f.noise > 0 else 1.0
            self._first_phase = max(self._first_phase, done)
            pause(self.progress() if early == math.inf else None)
            if f.noise < self.noise:
                light = f.per_lamp, f.standard_error, f.lamp_error, f.noise
                pause()
                # A picture comes before its measured error.
                at_once = self._supposed if early < math.inf else self._measure
                self._take_over(new, Source.RADIOSITY, *light, at_once, f.by_delta)
                due = early < math.inf and (f.paths >= 100 or f.noise <= LOW * ENOUGH)
                if due and (shown := self.estimate).source is Source.RADIOSITY:
                    self.estimate = shown._replace(error=self._measure(shown.irradiance, shown.noise))
                    new()
            # Fewer paths may miss bright places, so that noise looks like bias.
            biased = early == math.inf and f.paths >= 100 and self.error_of(f.mean) > math.sqrt(2) * f.noise
        if early >= ALL_PATHS or f.noise <= LOW * ENOUGH:
            f.end()

    def _supposed(self, E: np.ndarray, noise: float) -> float:
        """Return the error of radiosity as far as it is known without more paths at the sample."""
        return max(math.hypot(noise, 0.01), self.error_of(E))  # interpolation adds 1 %

    def _measure(self, E: np.ndarray, noise: float) -> float:
        """Return the error of irradiance E (n, 3) with this noise, from whole paths at the sample."""
        if self._sample is None:
            rows, times = draw_by_area(np.flatnonzero(self.weights > 0), self.weights, SAMPLE, self._seed)
            self._sample = ErrorSample(rows, times, ReferenceState.empty(len(rows)))
        s = self._sample
        if self._sampled is None:
            points, seed = (a[s.rows] for a in self._points), seed_of(Stream.ERROR_SAMPLE, self._seed)
            # Noise of many small rounds is sure, and known soon.
            more = {"model": self._model, "mobiles": False, "rounds": 1024, "state": s.state}
            self._sampled = ReferenceRounds(self._model.scene, *points, seed, s.times, **more)
            self._sample = s = s._replace(state=self._sampled.state)
        # Of point lights on a convex body radiosity has no noise, but whole paths do: they pick a light each.
        looked_at = -1
        while True:
            if s.state.rounds != looked_at:
                looked_at = s.state.rounds
                noise_now = math.inf if looked_at < 8 else s.state.noise(s.times)
                if not noise_now > CLEAR * max(s.error(E), noise, ENOUGH):
                    break
            self._sampled.step()
            pause()
        # The error of the total is known best, as noise averages out there; the rest is only known to a part.
        return max(s.error(E), math.hypot(noise, s.reference.relative_total(E) - 1.0))

    def _whole_paths(self, new: Callable[[], None]) -> None:
        rounds = ReferenceRounds(
            self._model.scene, *self._points, self._seed, self._paid, model=self._model, state=self.state,
            mobiles=False, rounds=STATIC_ROUNDS, per_lamp=True, smoothed=self._pooled_pilots,
        )  # fmt: skip
        looked_at, self._first_phase = 1, 1.0
        while not self.enough:
            if self.state is not None and (done := self.state.rounds) > looked_at:
                looked_at, noise = done, self._noise_of_paths(self.state)
                error = math.inf if self.estimate is None else self.estimate.error
                if noise < max(error, LOW * ENOUGH):
                    mean, deviation = self.state.mean, self.state.standard_error
                    light = mean[:, -self._channels :], deviation[:, :3], deviation[:, 3:], noise
                    self._take_over(new, Source.WHOLE_PATHS, *light)
                self._left = min(noise, self._left)  # a rare bright path raises it again
            else:
                rounds.step()
                self.state = rounds.state
                pause(self.progress())

    def _pooled(self, values: np.ndarray) -> np.ndarray:
        """Return means (n, k) over the surroundings of each receiver."""
        everywhere = np.ones(len(values), bool)
        for _ in range(8):
            values = averaged(self._near, values, everywhere, self._model.threads)
        return values

    def _pooled_pilots(self, pilot: np.ndarray) -> np.ndarray:
        """Return mean and deviation (n, 2) of the pilots of the surroundings. Where most light comes on few paths,
        those of a single receiver miss it, and so would its sets."""
        mean, square = self._pooled(np.stack([pilot[:, 0], (pilot**2).sum(axis=1)], axis=1)).T
        return np.stack([mean, np.sqrt(np.maximum(square - mean**2, 0.0))], axis=1)

    def _noise_of_paths(self, state: ReferenceState) -> float:
        """Return the relative l1 noise of whole paths: inf before two rounds, nan without receivers or light.

        Squared errors are means over surroundings: where no path has met the light, a receiver has no error itself.
        """
        if len(state.sets) and state.rounds < 2:
            return math.inf
        squares = luminance(state.standard_error[:, :3])[:, None] ** 2
        return relative_noise(np.sqrt(self._pooled(squares)[:, 0]), state.mean[:, :3], self.weights)

    def _take_over(
        self, new: Callable[[], None], source: Source, per_lamp: np.ndarray, standard_error: np.ndarray,
        lamp_error: np.ndarray, noise: float, error: Callable[[np.ndarray, float], float] = lambda _, noise: noise,
        exact: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        """Denoise this light and store it; the arrays must not change meanwhile.

        per_lamp (n, 3 G); standard_error (n, 3) of its sum; lamp_error (n, 3 G), or empty for one lamp. error(E,
        noise): returns the error of denoised light (n, 3) with so much noise left. exact (n, 3 G): the part without
        noise, such as sunlight, whose borders stay sharp; None: none.
        """
        light, variance, share = denoised(
            self._model, self._seed, self.weights, per_lamp, standard_error, lamp_error, exact
        )
        left = error(sum_of_lamps(light), share * noise)
        earlier, self.noise = self.estimate, noise
        if earlier is not None and earlier.source is Source.EDITED and earlier.error <= left:
            return  # light that another session has shown
        # Less noise is smoothed less, and bias is traded for noise: the noise left may rise while the error falls.
        self.estimate = Estimate(source, light, variance, share * noise, left)
        new()

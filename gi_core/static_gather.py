"""The static part's light without photons: gathered by paths while nothing else is to be done, smoothed by its noise.

It replaces the photons' own answer as what frames start from (`control_variate.py`) once it is the better of the
two. How far the photons are off is judged from the two alone: the square of their distance is that of the noise of
one, which is known, and that of the error of the other. Until two rounds are over there is but the light of the pilot
(`pilot_light.py`), of whose noise little is known: it must be clearly less than what the photons tell of theirs.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gi_core.error import luminance, relative_error
from gi_core.evaluation_points import evaluation_points
from gi_core.gather_filter import neighbours, smoothed
from gi_core.gather_rounds import PILOT, Gathered, gather_rounds
from gi_core.model import Model
from gi_core.pilot_light import PilotLight

ENOUGH = 0.007  # noise, relative l1: nobody sees it; with what interpolation adds the light is within a percent
ROUNDS = 24  # before 1 % is reached: the first answer that can be judged comes after two
STEP = 1 << 13  # paths a step: some 30 ms, since a drag that begins waits for it
CLEARLY = 2.0  # times the square of its error is the photons', where it is used: grain at single vertices is more
# easily seen than the soft blotches of photons of the same error


class StaticGather:
    """Irradiance of the static part's receivers as it is without mobiles."""

    def __init__(self, model: Model, seed: int, state: Gathered | None = None):
        """state: what an earlier run has gathered with the same scene and seed. Raises ValueError for another."""
        rows = model.surfaces.receiver_range(0)
        points, normals = evaluation_points(model.surfaces, model.object_receivers)
        self.weights = model.object_receivers.areas[rows].copy()
        if state is not None and len(state.sets) != len(self.weights):
            raise ValueError(f"the state is of {len(state.sets)} points, but there are {len(self.weights)}")
        given = model, seed, points[rows], normals[rows]
        paid = self.weights.copy()
        paid[model.first_probe :] = paid.mean() if len(paid) else 0.0  # probes stand for no area, but are read
        self._from_start, self._pilot = state is None, PilotLight(len(paid))
        self.early = 0  # paths of the pilot that `mean` is of; 0: it is of whole rounds, or not known at all
        self._rounds = _rounds(*given, paid, state, self._pilot if self._from_start else None)
        self.state = state
        self.mean, self.noise = np.zeros((0, 3)), float("inf")  # (n, 3) [W/m2] of whole rounds; of these, relative l1
        self._raw, self._share = self.mean, 1.0  # before it was smoothed; of its error, what that has left
        self.deviation = np.zeros(0)  # (n,) [W/m2] standard error of its luminance
        self._seed, self._threads = seed, model.threads
        self._near = neighbours(model.corners(0), rows.stop)
        self._smoothing: Iterator[None] | None = None
        if state is not None and len(state.sets) and state.sets.min() == state.sets.max() > 1:
            for _ in self._take_over(state.mean, state.standard_error, state.noise(self.weights)):
                pass  # else the round is finished first
        self._round = 0 if state is None else _rounds_done(state)

    @property
    def enough(self) -> bool:
        return not (self.noise > ENOUGH or self.early)  # nan: nothing is lit

    @property
    def fraction(self) -> float:
        """Share of the way to ENOUGH, 0 .. 1: noise falls with the root of the paths. 0 until there are rounds."""
        if self.early:
            return 0.0
        return min((ENOUGH / self.noise) ** 2, 1.0) if self.noise > 0 else 1.0

    def step(self) -> bool:
        """Gather a little more; True when `mean` is new."""
        if self._smoothing is not None:
            going_on = next(self._smoothing, self) is None
            self._smoothing = self._smoothing if going_on else None
            return not going_on
        self.state = next(self._rounds)
        done = _rounds_done(self.state)
        if done > self._round and done > 1:
            noise = self.state.noise(self.weights)
            if not (self.early and noise > self.noise):
                self._smoothing = self._take_over(self.state.mean, self.state.standard_error, noise)
        elif self._pilot.paths > self.early and not done:
            p = self._pilot
            self._smoothing = self._take_over(p.mean, p.standard_error, p.noise(self.weights), p.paths)
        self._round = done
        return False

    def _take_over(self, mean, standard_error, noise: float, early: int = 0) -> Iterator[None]:
        """Make this the light of this, in steps; the arrays must not change between them."""
        found = yield from smoothed(mean, standard_error, self.weights, self._near, self._seed, self._threads)
        self.mean, self._raw, self._share = found.irradiance.copy(), mean.copy(), found.share
        self.deviation = found.share * luminance(standard_error)
        self.noise, self.early = noise, early

    @property
    def pilot_due(self) -> bool:
        """Whether light of the pilot is still to come."""
        return self._from_start and self._round == 0 and self.early < PILOT

    def better_than(self, photons: np.ndarray, their_noise: float) -> bool:
        """Tell whether `mean` is clearly nearer to the truth than the photons' irradiance (n, 3).

        their_noise: relative l1, what the photons tell of their own; nan: nothing. Asked where `early`.
        """
        if len(self.mean) != len(photons) or not np.isfinite(self.noise):
            return False
        if np.isnan(apart := relative_error(photons, self._raw, self.weights).l1):
            return False  # black
        if self.early and not their_noise**2 >= CLEARLY * (self._share * self.noise) ** 2:
            return False
        of_photons = apart**2 - self.noise**2
        return of_photons >= CLEARLY * (self._share * self.noise) ** 2


def _rounds(model: Model, seed: int, points, normals, weights, state, early) -> Iterator[Gathered]:
    more = {"model": model, "state": state, "step": STEP, "mobiles": False, "rounds": ROUNDS, "early": early}
    return gather_rounds(model.scene, points, normals, seed, weights, **more)


def _rounds_done(state: Gathered) -> int:
    return int(state.sets.min()) if len(state.sets) else 0

"""The static part's light without photons: gathered by paths while nothing else is to be done, smoothed by its noise.

It replaces the photons' own answer as what frames start from (`control_variate.py`) once it is the better of the
two. How far the photons are off is judged from the two alone: the square of their distance is that of the noise of
one, which is known, and that of the error of the other.

First paths of a single bounce (`final_gather.py`), which end in the photons' light, then in what they have gathered
themselves: each round of them is one more reflection away from what the photons are off by. Within seconds they are
nearly as good as it gets, but for that, and what is lost between vertices. How much it is, whole paths
at a few receivers tell (`spot_check.py`). Then whole paths everywhere in rounds, without bias (`gather_rounds.py`),
from the moment they are the better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from gi_core.error import luminance, relative_error
from gi_core.evaluation_points import evaluation_points
from gi_core.final_gather import FinalGather
from gi_core.gather_filter import smoothed
from gi_core.gather_rounds import Gathered, gather_rounds
from gi_core.mesh_neighbours import neighbours
from gi_core.model import Model
from gi_core.spot_check import SpotCheck

ENOUGH = 0.007  # noise, relative l1: nobody sees it; with what interpolation adds the light is within a percent
QUICK = 1.4  # times ENOUGH: where single bounces leave off, since whole paths have no bias
UNBIASED = 2.0  # times what single bounces are off by is the noise that whole paths may end with to have the last word
BIASED = 0.5  # of what they are off by in all: where their noise is but that, more of them gain nothing
ROUNDS = 24  # before 1 % is reached: the first answer that can be judged comes after two
STEP = 1 << 13  # paths a step: some 30 ms, since a drag that begins waits for it
CLEARLY = 2.0  # times the square of its error is the photons', where it is used: grain at single vertices is more
# easily seen than the soft blotches of photons of the same error


class StaticGather:
    """Irradiance of the static part's receivers as it is without mobiles."""

    def __init__(
        self, model: Model, seed: int, photons: Callable[[], np.ndarray | None], state: Gathered | None = None
    ):
        """photons() returns the irradiance (n, 3) of these receivers that photons tell by now, None without any;
        state: what an earlier run has gathered with the same scene and seed. Raises ValueError for another.
        """
        rows = model.surfaces.receiver_range(0)
        points, normals = evaluation_points(model.surfaces, model.object_receivers)
        self.weights = model.object_receivers.areas[rows].copy()
        if state is not None and len(state.sets) != len(self.weights):
            raise ValueError(f"the state is of {len(state.sets)} points, but there are {len(self.weights)}")
        given = model, seed, points[rows], normals[rows]
        paid = self.weights.copy()
        paid[model.first_probe :] = paid.mean() if len(paid) else 0.0  # probes stand for no area, but are read
        self._final = FinalGather(*given, paid)
        self._check = SpotCheck(*given, paid) if len(paid) else None
        self._photons, self._quick = photons, self._first_answers(photons) if len(paid) else None
        self.early = 0  # paths of a single bounce that `mean` is of; 0: it is of whole rounds, or not known at all
        self._rounds = _rounds(*given, paid, state)
        self.state = state
        self.mean, self.noise = np.zeros((0, 3)), float("inf")  # (n, 3) [W/m2]; of it, relative l1
        lit = len(paid) and len(model.emitters.kind)
        self._left = float("inf" if lit else "nan")  # noise of whole rounds
        self._raw, self._share = self.mean, 1.0  # before it was smoothed; of its error, what that has left
        self.deviation = np.zeros(0)  # (n,) [W/m2] standard error of its luminance
        self._seed, self._threads = seed, model.threads
        self._near = neighbours(model.corners(0), rows.stop)
        self._smoothing: Iterator[None] | None = None
        if state is not None and len(state.sets) and state.sets.min() == state.sets.max() > 1:
            for _ in self._take_over(state.mean, state.standard_error, state.noise(self.weights)):
                pass  # else the round is finished first
            self._left = self.noise
        self._round = 0 if state is None else _rounds_done(state)

    @property
    def enough(self) -> bool:
        return self._smoothing is None and not self._left > ENOUGH  # nan: nothing is there, or nothing is lit

    @property
    def fraction(self) -> float:
        """Share of the way to ENOUGH, 0 .. 1: noise falls with the root of the paths. 0 until there are rounds."""
        return min((ENOUGH / self._left) ** 2, 1.0) if self._left > 0 else 1.0

    def step(self) -> bool:
        """Gather a little more; True when `mean` is new."""
        if self._smoothing is not None:
            going_on = next(self._smoothing, self) is None
            self._smoothing = self._smoothing if going_on else None
            return not going_on
        if self._quick is not None and self._photons() is not None:
            self._smoothing = next(self._quick, self)
            if self._smoothing is self:
                self._quick = self._smoothing = None
            return False
        self.state = next(self._rounds)
        done = _rounds_done(self.state)
        if done > self._round and done > 1:
            self._left = self.state.noise(self.weights)
            allowed = (UNBIASED if self.enough else 1.0) * self._early_error
            if not (self.early and self._left > allowed):
                self._smoothing = self._take_over(self.state.mean, self.state.standard_error, self._left)
        self._round = done
        return False

    def _first_answers(self, photons: Callable[[], np.ndarray | None]) -> Iterator[Iterator[None] | None]:
        """Gather single bounces, in steps; yields what is to be done next, if anything, to take them over."""
        f = self._final
        yield from self._check.steps()
        for new in f.steps(lambda: self._known(photons())):
            yield self._take_over(f.mean, f.standard_error, f.noise, f.paths) if new and f.noise < self.noise else None
            if not f.noise > max(QUICK * ENOUGH, BIASED * self._early_error):
                return

    def _known(self, photons: np.ndarray) -> np.ndarray:
        """Return the light (n, 3) that single bounces end in: what the last of them told, else the photons'.

        A receiver that sees nothing is inside something, at a corner of faces that reach out of it: there the photons'
        discs still tell of the light beside it. How much light there is in all is the photons' to tell, without bias:
        what interpolation between vertices loses would be lost again at every reflection.
        """
        told = self._final.last
        out = np.where(luminance(told)[:, None] > 0, told, photons)
        mine, theirs = self.weights @ out, self.weights @ photons
        return out * np.divide(theirs, mine, out=np.ones(3), where=mine > 0)

    @property
    def _early_error(self) -> float:
        """What single bounces are off by, chance and all (relative l1)."""
        return max(self._share * self.noise, self._check.error(self.mean)) if self.early else 0.0

    def _take_over(self, mean, standard_error, noise: float, early: int = 0) -> Iterator[None]:
        """Make this the light of this, in steps; the arrays must not change between them."""
        found = yield from smoothed(mean, standard_error, self.weights, self._near, self._seed, self._threads)
        self.mean, self._raw, self._share = found.irradiance.copy(), mean.copy(), found.share
        self.deviation = found.share * luminance(standard_error)
        self.noise, self.early = noise, early

    def better_than(self, photons: np.ndarray) -> bool:
        """Tell whether `mean` is clearly nearer to the truth than the photons' irradiance (n, 3)."""
        if len(self.mean) != len(photons) or not np.isfinite(self.noise):
            return False
        if np.isnan(apart := relative_error(photons, self._raw, self.weights).l1):
            return False  # black
        if self.early:
            return self._check.error(photons) ** 2 >= CLEARLY * self._early_error**2
        of_photons = apart**2 - self.noise**2
        return of_photons >= CLEARLY * (self._share * self.noise) ** 2


def _rounds(model: Model, seed: int, points, normals, weights, state) -> Iterator[Gathered]:
    return gather_rounds(
        model.scene, points, normals, seed, weights, model=model, state=state, step=STEP, mobiles=False, rounds=ROUNDS
    )


def _rounds_done(state: Gathered) -> int:
    return int(state.sets.min()) if len(state.sets) else 0

"""How far off light is, told by whole paths, without bias, at a few receivers drawn by area."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gi_core.error import relative_error
from gi_core.error_at_hand import bias_left
from gi_core.gather_rounds import gather_rounds
from gi_core.model import Model

RECEIVERS = 300
NOISE = 0.03  # relative l1, of the truth: errors down to a half of it can be told
MOST_PATHS = 1 << 10  # a receiver: where light is rare that must do
STEP = 1 << 13  # paths between two looks: some 30 ms
STREAM = 0x5C0F


class SpotCheck:
    """A truth of the static part's light, as it is without mobiles, at some of n receivers."""

    def __init__(self, model: Model, seed: int, positions: np.ndarray, normals: np.ndarray, weights: np.ndarray):
        """Positions and normals (n, 3), n > 0, weights (n,), areas."""
        self.noise = float("inf")  # of the truth; inf: not yet known
        self._model, self._seed = model, int(seed) ^ (STREAM << 16)
        share = weights / weights.sum() if weights.sum() > 0 else None
        draw = np.random.default_rng(0).choice(len(weights), RECEIVERS, p=share)  # with replacement: large ones count
        self._rows, self._weights = np.unique(draw, return_counts=True)
        self._points = positions[self._rows], normals[self._rows]
        self._truth = np.zeros((len(self._rows), 3))

    def steps(self) -> Iterator[None]:
        """Gather the truth, in steps of some 30 ms."""
        w = self._weights.astype(np.float64)
        rounds = gather_rounds(
            self._model.scene, *self._points, self._seed, w, model=self._model, step=STEP, mobiles=False
        )
        for state in rounds:
            yield
            noise = state.noise(w)
            if not noise > NOISE or (np.isfinite(noise) and state.paths.sum() > MOST_PATHS * len(w)):
                break
        self.noise, self._truth = noise, state.mean.copy()

    def error(self, irradiance: np.ndarray) -> float:
        """Return the relative l1 error of irradiance (n, 3), the truth's own noise taken out in squares."""
        return bias_left(relative_error(irradiance[self._rows], self._truth, self._weights).l1, self.noise)

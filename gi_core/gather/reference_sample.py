"""The reference at receivers drawn by area, and the error of a picture against it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.gather.reference import ReferenceRounds, ReferenceState
from gi_core.geometry.error import local_deviation, luminance, relative_error
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import evaluation_points
from gi_core.model import Model
from gi_core.scene.types import Pose


class Reached(NamedTuple):
    """Progress of the reference at some points."""

    state: ReferenceState  # changes with the next step
    noise: float  # relative l1; inf before the second round, nan without light
    fraction: float  # 0 .. 1 of the paths needed, estimated


class ReferenceSample(NamedTuple):
    """Receivers and the reference there."""

    rows: np.ndarray  # (n,) receivers
    weights: np.ndarray  # (n,) float64, area or count of draws
    irradiance: np.ndarray  # (n, 3) float64 [W/m2]
    noise: float  # of the reference, relative l1
    fraction: float  # 0 .. 1 of the paths that are needed
    deviation: np.ndarray | float = 0.0  # (n,) float64 [W/m2], standard error of the reference's luminance

    def squared_error(self, E: np.ndarray) -> float:
        """Return the squared relative l1 error of irradiance E (R, 3) less that of the reference's noise.

        It may be negative, so that means over samples are right. 0 where the reference is black.
        """
        l1 = relative_error(E[self.rows], self.irradiance, self.weights).l1
        return 0.0 if math.isnan(l1) else l1 * l1 - self.noise**2

    def error(self, E: np.ndarray) -> float:
        """Return the relative l1 error of irradiance E (R, 3) without the reference's noise."""
        return math.sqrt(max(self.squared_error(E), 0.0))

    def local_deviation(self, E: np.ndarray, receivers: Receivers, reach: float) -> tuple[float, float]:
        """Return median and 90th percentile of the local deviation of irradiance E (R, 3) within `reach` [m]."""
        places = receivers.positions[self.rows], receivers.normals[self.rows], self.weights
        return local_deviation(E[self.rows], self.irradiance, places, reach, self.deviation)

    def relative_total(self, E: np.ndarray) -> float:
        """Return the total of irradiance E (R, 3) over that of the reference; 1 where the reference is black."""
        mine, truth = (float((self.weights * luminance(a)).sum()) for a in (E[self.rows], self.irradiance))
        return mine / truth if truth > 0 else 1.0


def draw_by_area(rows: np.ndarray, areas: np.ndarray, count: int, seed) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (n,), ascending, of `count` draws with replacement from `rows`, and how often each was drawn.

    A row's chance is its share of the areas (R,), so sums weighted by the counts (n,) float64 estimate sums weighted by
    area. Without replacement, few large receivers would count no more than many small ones.
    """
    share = areas[rows] / areas[rows].sum()
    drawn, times = np.unique(np.random.default_rng(seed).choice(rows, count, p=share), return_counts=True)
    return drawn, times.astype(np.float64)


def gather_until(
    rounds: ReferenceRounds, weights: np.ndarray, noise: float, most_paths: float = math.inf, step: int | None = None
) -> Iterator[Reached]:
    """Gather until, after a round, the noise is at most `noise` (relative l1) or `most_paths` paths are traced.

    Yields after each step of some `step` paths, None for steps of some 10 ms, and at the end; a state that is good
    enough gathers nothing.
    """
    s, looked_at, noise_now, needed = rounds.state, -1, math.inf, math.inf
    while True:
        paths = int(s.paths.sum())
        if s.rounds != looked_at:
            looked_at, noise_now = s.rounds, s.noise(weights)
            if not noise_now > noise or (paths >= most_paths and looked_at > 1):
                break
            predictable = noise > 0 and not math.isinf(noise_now)  # a lamp over a floor alone has no noise
            needed = min(paths * (noise_now / noise) ** 2 if predictable else math.inf, most_paths)
        rounds.step(step)
        yield Reached(s, noise_now, min(paths / needed, 1.0))
    yield Reached(s, noise_now, 1.0)


def gather_sample(
    model: Model, poses: Mapping[str, Pose], rows: np.ndarray, weights: np.ndarray, seed: int, noise: float,
    most_paths: float = math.inf, levels: np.ndarray | None = None,
) -> Iterator[ReferenceSample]:  # fmt: skip
    """Gather the reference at some receivers at all mobiles' poses, as gather_until() does; the last is the answer.

    levels (G, 3): of the lamps; None: those of the scene file.
    """
    points, normals = (a[rows] for a in evaluation_points(model.surfaces, model.receivers_at(poses)))
    rounds = ReferenceRounds(model.scene, points, normals, seed, weights, poses, model=model, levels=levels)
    for reached in gather_until(rounds, weights, noise, most_paths):
        s = reached.state
        yield ReferenceSample(
            rows, weights, s.mean, reached.noise, reached.fraction, luminance(s.standard_error[:, :3])
        )

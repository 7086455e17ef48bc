"""Irradiance at one set of poses by paths, with mobiles in place: on mobiles, and where they change static light.

Frames know the change from photons that mobiles cut, and the light of mobiles from single bounces. At rest, paths
replace both.

A path ends in the static part's light, at its first hit beyond the length of the face hit. Nearer hits lie in the
mobile's own shadow, which the corners of the face do not resolve: there and on mobiles it goes on.

Each path from a static receiver is traced twice with the same random numbers, with mobiles and without. Its difference
is 0 unless it meets a mobile, or light that mobiles change. Irradiance then has two estimates:

    W        the mean with mobiles; good in their shadow
    G + D    static light without mobiles, plus the mean difference; good where they change little

Weights of W and G + D minimise the variance (D is a control variate, Kahn and Marshall 1953). Both have the error of
static light: G whole, W in proportion to the light that is left, as its paths end in it. Variances are averaged over
neighbours: weights from a receiver's own few paths would be biased. The mean is denoised as the static part's light is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from gi_core.base.pause import Progress, pause
from gi_core.base.random_numbers import Stream, seed_of
from gi_core.base.results import KEPT
from gi_core.gather import static as static_gather
from gi_core.gather.denoise import averaged, denoise
from gi_core.gather.direct_light import Places
from gi_core.gather.importance import visual_shares
from gi_core.gather.path_ends import WHOLE, InKnownLight, in_known_light
from gi_core.gather.path_tracer import gather
from gi_core.gather.reference import PATHS_PER_POINT, ReferenceState, Rounds
from gi_core.geometry.error import DARK, luminance, relative_error, relative_noise, small_sample_bias
from gi_core.geometry.mesh_neighbours import Neighbours, among
from gi_core.geometry.receiver_classes import AFFECTED
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights.lamps import Lights
from gi_core.lights.next_event import least_set
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms

STAGE = "gathering at these poses"
LAST_ROUND = 47  # rounds until the last result: twice those that noise is sized for
# Times the noise of paths: difference from the frame's light, which contains both errors. At sqrt(2) both are as good.
# Small sets understate their noise by up to 1.8: a room lit by the sky went from 3.9 to 12 % at first.
AS_GOOD, CLEARLY = math.sqrt(2.0), 2.0

# Behind a partition, light interpolated across it is 8.6 % off, and 11.7 % on its dark side; then 2.9 and 1.4 %.
UNEVEN = 0.5

Static = tuple[np.ndarray, np.ndarray]  # irradiance (n, 3) without mobiles, error (n,) of its luminance [W/m2]


class PoseGather:
    """Light at one set of poses.

    rows (n,) int64, ascending: receivers. mean (n, 3) float64 [W/m2]: denoised irradiance there, empty before the first
    result. deviation (n,) [W/m2]: standard error of its luminance. used (n,) bool: frames show it. left: the relative
    l1 noise of static receivers or of mobiles, whichever is higher.
    """

    def __init__(
        self, points: ReceiverPoints, at: Transforms, lights: Lights, irradiance: np.ndarray, static: np.ndarray,
        disc_area: float,
    ):  # fmt: skip
        """lights: of one lamp; irradiance (R, 3) [W/m2] of the frame at these poses, static (n, 3) without mobiles.

        disc_area [m2]: of the frame's estimator; the corners of a larger face say little about its light.
        """
        self._points, self.rows = points, points.changed(irradiance, static)
        self._own = irradiance[self.rows]
        self._paths = PosePaths(points, at, lights, self.rows, disc_area)
        self._static, self._change = static, irradiance[: points.static] - static
        self._paths.end_in(irradiance[: points.static], static)
        mobile = self._paths.mobile
        self._classes = [of for of in (mobile, ~mobile) if of.any()]
        model, areas = points.model, points.model.object_receivers.areas
        # Else a bright room decides for the dark one behind a door, which is in view.
        areas = (areas * visual_shares(model, luminance(irradiance), areas))[self.rows]
        self._weights = np.zeros(len(areas))
        for of in self._classes:  # each counts as much as the other; probes get the mean weight
            mean = areas[of].mean() or 1.0
            self._weights[of] = np.where(areas[of] > 0, areas[of], mean) / (mean * of.sum())
        light = luminance(self._own)
        dark = max(DARK * light.sum() / max(len(light), 1), 1e-300)
        # Paths are distributed by relative error, as feet are dark, and to each vertex of a mobile alike.
        relative = np.where(mobile, 1.0 / max(mobile.sum(), 1), self._weights) / np.maximum(light, dark)
        state, smoothed = ReferenceState.empty(len(self.rows), channels=6), self._paths.smoothed
        rounds, least = static_gather.STATIC_ROUNDS, least_set(lights.delta)
        self._rounds = Rounds(self._paths.traced, _steadier, relative, state, rounds, smoothed, least, smaller=4)
        self.mean, self.deviation, self.used = np.zeros((0, 3)), np.zeros(0), np.zeros(len(self.rows), bool)
        self.left, self._seen = float("inf"), 0.0  # rounds of the last result
        self._least = float("inf")  # of `left` so far: with more paths, less is smoothed and noise may rise again

    @property
    def enough(self) -> bool:
        """Whether gathering has ended. True without receivers or without light, where the noise is nan."""
        return not self.left > static_gather.ENOUGH or self._seen >= LAST_ROUND or not len(self.rows)

    @property
    def fraction(self) -> float:
        """Fraction of the paths needed, 0 .. 1."""
        by_noise = min((static_gather.ENOUGH / self._least) ** 2, 1.0) if self._least > 0 else 1.0
        return max(by_noise, self._seen / LAST_ROUND)

    def gather(self, static: Callable[[], Static | None], new: Callable[[], None]) -> None:
        """Gather until it is enough, with a pause every 10 ms; may be broken off and begun again.

        static() returns the static part's light, None where photons know it best. new: called after each result.
        """
        while not self.enough:
            r = self._rounds
            # noise after denoising is understated with fewer than 4 rounds
            if r.state.rounds >= 4 and r.done > 1.3 * self._seen:
                self._seen = r.done
                self._result(static())
                if r.smaller:
                    r.enlarge(2)
                new()
            else:
                self._know(static())
                self._rounds.step()
                pause(Progress(STAGE, self.fraction, False))

    def _know(self, static: Static | None) -> None:
        """Let the next paths end in this light of the static part, changed by mobiles as at first."""
        if static is not None and static[0] is not self._static:
            self._static = static[0]
            self._paths.end_in(np.maximum(self._static + self._change, 0.0), self._static)

    def _result(self, static: Static | None) -> None:
        p, s, near = self._points, self._rounds.state, self._paths.near
        # Its square is without bias, as denoising needs it: with 1.18 times the variance of four rounds, a tenth of the
        # noise's square counts as less than none.
        mean, error, kept = combined(
            s.mean, s.standard_error, self._paths.mobile, self.rows, static, near, p.model.threads
        )
        used, most, least = self.used.copy(), 0.0, CLEARLY if self._rounds.smaller else AS_GOOD
        denoised = denoise(mean, error, near, p.seed, p.model.threads)
        noise = denoised.left * luminance(error) / small_sample_bias(s.sets)
        deviation = np.hypot(noise, kept)
        for of in self._classes:
            own = relative_error(self._own, denoised.irradiance, self._weights, of).l1
            # Both have the error of static light.
            used |= of & (own > least * relative_noise(noise, mean, self._weights, of))
            most = max(most, relative_noise(deviation, mean, self._weights, of))
        self.mean, self.deviation, self.used, self.left = denoised.irradiance, deviation, used, most
        self._least = min(self._least, most)


class PosePaths:
    """Paths from some receivers at one set of poses. No part of a reference cycle, as it holds the scene."""

    def __init__(self, points: ReceiverPoints, at: Transforms, lights: Lights, rows: np.ndarray, disc_area: float):
        """lights: of one lamp; rows (n,): receivers; disc_area [m2]: paths do not end on larger faces."""
        self._points, self._at, self._lights, self._rows = points, at, lights, rows
        self.mobile, self.near = rows >= points.static, among(points.model.adjacency, rows)
        self._places = Places(*(a[rows] for a in Places.at_poses(points.model, at)))
        self._disc_area, self._ending, self._ending_without = disc_area, WHOLE, WHOLE

    def end_in(self, static: np.ndarray, without: np.ndarray) -> None:
        """Let paths end in irradiance (n, 3) [W/m2] of the static part: with mobiles in place, and without.

        Paths go on from faces whose corners mobiles change unevenly, such as those under a partition.
        """
        model, lengths = self._points.model, self._points.face_lengths
        least = np.where(_changed_unevenly(model.surfaces, static, without), np.inf, lengths)
        self._ending, self._ending_without = (
            in_known_light(model, model.static, E, self._disc_area, least) for E in (static, without)
        )

    def traced(self, rows: np.ndarray, first: int, count: int, m: int, stream: int) -> np.ndarray:
        """Return estimates (rows, count, 6): irradiance with mobiles, and that less the one without (0 on mobiles)."""
        p, receivers = self._points, self._rows[rows]
        path = receivers[:, None] * PATHS_PER_POINT + first + np.arange(count)

        def irradiance(of: np.ndarray, at: Transforms, ending: InKnownLight) -> np.ndarray:
            point, normal, off = (np.repeat(a[rows[of]], count, axis=0) for a in self._places)
            seed, numbers = seed_of(stream, p.seed), path[of].reshape(-1)
            E = gather(p.model, at, self._lights, seed, numbers, point, normal, m=m, ending=ending, lift=off)
            return E.reshape(-1, count, 3)

        out, still = np.zeros((len(rows), count, 6)), receivers < p.static
        out[..., :3] = irradiance(np.ones(len(rows), bool), self._at, self._ending)
        out[still, :, 3:] = out[still, :, :3] - irradiance(still, p.model.static, self._ending_without)
        return out

    def smoothed(self, pilot: np.ndarray) -> np.ndarray:
        """Return pilots (n, 2) averaged over neighbours: a pilot in a dark crease may miss all of its light."""
        everywhere, threads = np.ones(len(pilot), bool), self._points.model.threads
        mean, variance = (averaged(self.near, a, everywhere, threads) for a in (pilot[:, 0], pilot[:, 1] ** 2))
        return np.stack([mean, np.sqrt(variance)], axis=1)


def _changed_unevenly(s: Surfaces, static: np.ndarray, without: np.ndarray) -> np.ndarray:
    """Return the static faces (F,) bool whose corners differ by more than UNEVEN in the share of light that mobiles
    leave; static, without (n, 3) [W/m2]: irradiance with mobiles in place, and without.
    """
    light, before = luminance(static), luminance(without)
    left = np.divide(light, before, out=np.ones_like(light), where=before > 0)
    front, back = (np.ptp(left[corner[s.face_range(0)]], axis=1) > UNEVEN for corner in (s.corner_front, s.corner_back))
    return front | (s.two_sided[s.face_range(0)] & back)


def _steadier(values: np.ndarray) -> np.ndarray:
    """Return the luminance (n, count) of whichever scatters less, of irradiance (n, count, 6) and of its difference.

    The mean is that of irradiance, so that the light of all receivers sizes the rounds.
    """
    whole, difference = luminance(values[..., :3]), luminance(values[..., 3:])
    steadier = (difference.std(axis=1) < whole.std(axis=1)) & (values[..., 3:] != 0).any(axis=(1, 2))
    shifted = difference - difference.mean(axis=1, keepdims=True) + whole.mean(axis=1, keepdims=True)
    return np.where(steadier[:, None], shifted, whole)


def combined(
    mean: np.ndarray, error: np.ndarray, mobile: np.ndarray, rows: np.ndarray, static: Static | None, near: Neighbours,
    threads: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return irradiance (n, 3) of both estimates together, and its standard errors (n, 3) by paths and (n,) by static
    light. The latter is that of luminance; neighbours have it in common, so it is not denoised.

    mean, error (n, 6): irradiance and difference, and their standard errors; mobile (n,) bool; rows (n,) receivers.
    Errors of paths are added as if fully correlated, so the result is not understated.
    """
    W, of_W, of_D = mean[:, :3], error[:, :3], error[:, 3:]
    if static is None or not len(rows):
        return W.copy(), of_W.copy(), np.zeros(len(rows))
    G, deviation = (a[np.where(mobile, 0, rows)] for a in static)
    everywhere = np.ones(len(rows), bool)
    v, u, light, before, squared = (
        averaged(near, a, everywhere, threads)
        for a in (luminance(of_W) ** 2, luminance(of_D) ** 2, luminance(W), luminance(G), deviation**2)
    )
    # Share that mobiles take: W has the rest of static light's error, G all. The share of W minimises the sum.
    taken = 1.0 - np.divide(np.minimum(light, before), before, out=np.ones_like(light), where=before > 0)
    total = v + u + taken**2 * squared
    share = np.minimum(np.divide(u + taken * squared, total, out=np.ones_like(v), where=total > 0), 1.0)
    share[~mean.any(axis=1)] = 0.0  # paths that met no light, with mobiles or without, tell no error either
    of_static = np.where(mobile, 0.0, (1.0 - share * taken) * deviation)
    share = np.where(mobile, 1.0, share)[:, None]
    E = share * W + (1 - share) * (G + mean[:, 3:])
    return np.maximum(E, 0.0), share * of_W + (1 - share) * of_D, of_static


class ReceiverPoints:
    """Receivers of a model where paths may start; shared by all poses."""

    def __init__(self, model: Model, seed: int):
        self.model, self.seed = model, seed_of(Stream.POSES, seed)
        self.static = model.surfaces.receiver_range(0).stop

    @cached_property
    def face_lengths(self) -> np.ndarray:
        """Longest edge (F,) of each static face [m]."""
        s = self.model.surfaces
        corners = self.model.object_receivers.positions[s.corner_front[s.face_range(0)]]
        return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)

    @cached_property
    def _corners(self) -> np.ndarray:
        return np.concatenate([self.model.corners(o) for o in range(self.model.surfaces.objects)])

    def changed(self, irradiance: np.ndarray, static: np.ndarray) -> np.ndarray:
        """Return receivers (n,) on mobiles, and those that mobiles change, with neighbours; see PoseGather.

        A change counts from AFFECTED of the mean: paths to all receivers would cost six times as much in cornell.
        """
        areas, light = self.model.object_receivers.areas[: self.static], luminance(static)
        least = AFFECTED * float(areas @ light) / max(areas.sum(), 1e-300)
        due = np.ones(len(irradiance), bool)
        due[: self.static] = np.abs(luminance(irradiance[: self.static]) - light) > least
        c = self._corners
        due[c[due[c].any(axis=1)]] = True
        return np.flatnonzero(due & (self.model.evaluation_points[1] != 0).any(axis=1))


class PoseGathers:
    """Light of the last KEPT poses, each at some levels of the lamps."""

    def __init__(self, model: Model, seed: int):
        self._points = ReceiverPoints(model, seed)
        self._kept: dict[bytes, tuple[int, PoseGather]] = {}  # by poses: photons of the frame it began from, and light

    def find(self, at: Transforms, levels: np.ndarray) -> PoseGather | None:
        """Return the light at poses and levels (G, 3), None if it has not been begun."""
        return self._kept.get(key_of(at, levels), (0, None))[1]

    def begin(
        self, at: Transforms, levels: np.ndarray, photons: int, irradiance: np.ndarray, static: np.ndarray,
        disc_area: float,
    ) -> PoseGather:  # fmt: skip
        """Return the light at poses and levels, begun now if necessary; arguments as for PoseGather.

        photons: of the frame. Light that is not yet used begins again with the frame of another number of photons.
        """
        key = key_of(at, levels)
        had, gather = self._kept.pop(key, (0, None))
        if gather is None or not (gather.used.any() or had == photons):
            lights = self._points.model.lights_at(levels)
            had, gather = photons, PoseGather(self._points, at, lights, irradiance, static, disc_area)
        self._kept = dict([*self._kept.items(), (key, (had, gather))][-KEPT:])
        return gather


def key_of(at: Transforms, levels: np.ndarray) -> bytes:
    """Return a key of poses and levels (G, 3) of the lamps."""
    return at.rotation.tobytes() + at.position.tobytes() + levels.tobytes()

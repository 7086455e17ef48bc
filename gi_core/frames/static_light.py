"""Light of the static part without mobiles: the best of several estimates (`gi_core.gather.estimate`).

Photons, smoothed in proportion to their noise, light the first pictures. Gathered light (`gi_core.gather.static`) takes
their place once it has less error. After an edit they are replaced by the light before it, changed by the difference
of the photons before and after (`edited_light.py`).

Where points on lamps resolve them, they bring direct light, and photons bounced light alone (Jensen 1996). Borders of
direct light then stay sharp, and pictures may have fine points.

Photons are smoothed by the kernel that averages changes by mobiles (`control_variate.py`). Discs of neighbouring
receivers overlap, but share no photons two radii apart. Each receiver is averaged with some within NEAR radii. A
difference of REACH standard deviations has no weight, so edges of shadows stay. Noise falls with more photons, and
smoothing with it. A photon subset measures the variance; averaged alike, it measures the noise that is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gi_core.base.pause import pause, undivided
from gi_core.frames.background import Background
from gi_core.frames.control_variate import AROUND, REACH, noise_field
from gi_core.frames.edited_light import EditedLight, LightBefore, light_before
from gi_core.gather.denoise import averaged, smoothed_by_subset
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.estimate import Estimate, Source, better, variance_per_lamp
from gi_core.gather.radiosity import Bounces
from gi_core.gather.static import StaticGather
from gi_core.geometry.error import luminance, noise_from_subset, relative_noise, subset_to_compare
from gi_core.geometry.mesh_neighbours import Neighbours, scattered_neighbours
from gi_core.lights.lamps import mix, sum_of_lamps
from gi_core.model import Model

CLOUDY = 2.0  # errors of photons are clouds: per error, a tenth of the view has 1.7 to 2.1 times the local deviation
NEAR = 2.0  # disc radii: 4 serve few photons better, and half a million worse
UNRESOLVED = 0.2  # points bring 0.96 to 1.02 of the light of photons, and half of it where lamps touch surfaces


def smooth_photons(
    b: Background, around: Neighbours, weights: np.ndarray, per_lamp: bool = False, direct: np.ndarray | None = None
) -> Estimate:
    """Smooth the light of all photons of a background; around: receivers near each; weights (n,): of noise.

    per_lamp: keep lamps apart; each takes the averages of their sum. direct (n, 3 G) [W/m2]: light in place of that
    which photons bring straight from lamps, None: theirs. Photons too few to measure their noise stay.
    """
    photons, fewer = b.estimate.photons, subset_to_compare(b.estimate.subsets)

    def light_of(count: int, per_lamp: bool) -> np.ndarray:
        E = b.irradiance_per_lamp(count, direct is None)
        return E if per_lamp else sum_of_lamps(E)

    E = light_of(photons, per_lamp)
    straight = np.zeros_like(E) if direct is None else direct if per_lamp else sum_of_lamps(direct)
    lamps = E.shape[1] // 3
    if fewer is None:
        return Estimate(Source.PHOTONS, E + straight, np.zeros((len(E), lamps)), math.inf, math.inf)
    whole, part = (light_of(n, per_lamp=False) for n in (photons, fewer))
    reached = b.estimate.background(photons)[1] > 0
    light, deviation = smoothed_by_subset(
        whole, part, photons / fewer, REACH, around, reached, weights, b.model.threads, E if per_lamp else None
    )
    light = light + straight
    noise = relative_noise(deviation, sum_of_lamps(light), weights)
    variance = variance_per_lamp(deviation, luminance(light.reshape(len(light), lamps, 3)))
    return Estimate(Source.PHOTONS, light, variance, noise, noise)


def _as_measured(b: Background, weights: np.ndarray) -> Estimate | None:
    """Return the light of all photons as it is; None without photons. weights (n,): of noise."""
    if not (photons := b.estimate.photons):
        return None
    fewer, light = subset_to_compare(b.estimate.subsets), b.irradiance_per_lamp(photons)
    noise = math.inf
    if fewer is not None:
        noise = noise_from_subset(b.irradiance(photons), b.irradiance(fewer), photons, fewer, weights)
    return Estimate(Source.PHOTONS, light, np.zeros((len(light), light.shape[1] // 3)), noise, noise)


class StaticLight:
    """`gathered` is the light of paths so far, None before it begins; `direct` that of points on lamps, known or not.

    best: the estimate in place of photons, None while all photons have less error, as far as compare() knows.
    """

    def __init__(self, model: Model, seed: int, direct: DirectLight):
        self.gathered: StaticGather | None = None
        self.best: Estimate | None = None
        self._model, self._seed, self.direct = model, seed, direct
        self._areas = model.object_receivers.areas[model.surfaces.receiver_range(0)]
        self._before: LightBefore | None = None  # the light before the last edit
        self._edited: EditedLight | None = None  # until gathered light has less error
        self._straight: tuple[Background, int, np.ndarray | None] | None = None  # of the photons of a background
        # Of the last background, per lamp or not, with the direct light in it, and weights.
        self._photons: dict[bool, tuple[Background, int, np.ndarray | None, np.ndarray, Estimate]] = {}
        # Light per lamp, levels, and their light: on show, and direct.
        self._mixed: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._error: tuple[Estimate, np.ndarray, float] | None = None  # of an estimate at levels
        self._field: tuple[tuple[Background, int, bool], np.ndarray] | None = None
        self._around: dict[float, Neighbours] = {}  # static receivers within a distance, of changes and of photons

    def is_early(self, paths: int) -> bool:
        """Whether there is no light but that of photons and of fewer than so many paths per receiver."""
        relit = 0 if self._edited is None else self._edited.paths
        return relit < paths and (self.gathered is None or self.gathered.is_early(paths))

    def irradiance(self, b: Background, levels: np.ndarray) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] at levels of the lamps; the same array for the same light.

        b: whose photons light the static part before there is better light.
        """
        return self.mixed("shown", *self._light_for(b, levels))

    def _light_for(self, b: Background, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return light per lamp and levels that belong together."""
        if self.best is not None:
            return self.best.light, levels
        of, at = self._photons_for(b, levels)
        return of.light, at

    def _photons_for(self, b: Background, levels: np.ndarray) -> tuple[Estimate, np.ndarray]:
        """Return the light of photons, and levels for it: lamps are apart where their levels differ."""
        if (levels == levels[0]).all():  # one factor for all, exactly
            return self.of_photons(b), levels[:1]
        return self.of_photons(b, per_lamp=True), levels

    def deviation(self, b: Background | None, levels: np.ndarray) -> np.ndarray:
        """Return the standard error (n,) [W/m2] of the luminance of irradiance(); (0,) before any light."""
        if self.best is not None:
            return self.best.deviation_at(levels)
        if b is None or not b.estimate.photons:
            return np.zeros(0)
        of, at = self._photons_for(b, levels)
        return of.deviation_at(at)

    def of_photons(self, b: Background, per_lamp: bool = False) -> Estimate:
        """Return the light of all photons of a background, smoothed once; see smooth_photons()."""
        kept, direct, weights = self._photons.get(per_lamp), self.direct_for(b), self._weights
        same = kept is not None and kept[0] is b and kept[1] == b.estimate.photons
        if not same or kept[2] is not direct or kept[3] is not weights:
            around = self.around(NEAR * b.setting.radius)
            pause()
            kept = b, b.estimate.photons, direct, weights, smooth_photons(b, around, weights, per_lamp, direct)
            self._photons = self._photons | {per_lamp: kept}
        return kept[-1]

    @property
    def _weights(self) -> np.ndarray:
        """Weights (n,) of receivers in errors."""
        return self._areas if self.gathered is None else self.gathered.weights

    def direct_for(self, b: Background) -> np.ndarray | None:
        """Return direct light (n, 3 G) [W/m2] in place of that of a background's photons; None where they bring it.

        It is that of points on lamps, as long as these bring about as much light as photons in all; that of photons
        where points are too near to stand for a lamp.
        """
        photons = b.estimate.photons
        if not self.direct.is_known or not photons or not b.estimate.additive:
            return None
        if self._straight is None or self._straight[:2] != (b, photons):
            every, bounced = (b.irradiance_per_lamp(photons, direct) for direct in (True, False))
            theirs, points = every - bounced, self.direct.per_lamp
            total = self._areas @ theirs.sum(axis=1)
            agree = abs(self._areas @ points.sum(axis=1) - total) <= UNRESOLVED * total
            far = self.direct.resolves()
            self._straight = b, photons, np.where(far[:, None], points, theirs) if agree else None
        return self._straight[2]

    def mixed(self, which: str, light: np.ndarray, levels: np.ndarray) -> np.ndarray:
        """Return light (n, 3 G) per lamp at levels (G, 3), mixed to (n, 3); the last result is kept."""
        kept = self._mixed.get(which)
        if kept is None or kept[0] is not light or not np.array_equal(kept[1], levels):
            kept = light, levels, mix(light, levels, self._model.threads)
            self._mixed = self._mixed | {which: kept}
        return kept[2]

    def of_all_lamps(self, b: Background, gathered: bool) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] at the levels of the scene file: the best, if `gathered`, else of photons."""
        if gathered and self.best is not None:
            return self.best.irradiance
        return sum_of_lamps(b.irradiance_per_lamp(b.estimate.photons))

    @undivided()
    def compare(self, shown: Background | None) -> bool:
        """Compare the errors of all estimates; return whether another one than that of photons is the best.

        An error is the larger of an estimate's own and that which whole paths find, so it includes the blur of discs.
        Photons also have the error that they had before an edit, while its light is on show. Theirs counts CLOUDY times.
        """
        if shown is None or not shown.estimate.photons:
            return self.best is not None
        g, edited = self.gathered, None
        if self._edited is not None:
            edited = self._edited.estimate(shown, self.around(AROUND * shown.setting.radius))
            edited = edited and edited._replace(error=max(edited.error, self._error_of(edited)))
        chosen = better(None if g is None else g.estimate, edited)
        if chosen is None:
            return self.best is not None
        if chosen is not edited:
            self._edited = None
        theirs = self.of_photons(shown)
        before = self._edited.before.of_photons if self._edited is not None else 0.0
        early = chosen is not edited and not self.gathered.is_measured  # the blur of photons is unknown too
        worse = early or chosen.error < CLOUDY * max(theirs.noise, self._error_of(theirs), before)
        self.best = chosen if worse else None
        return worse

    def _error_of(self, light: Estimate) -> float:
        """Return the relative l1 error that whole paths at some receivers find; 0 before there are any."""
        return 0.0 if self.gathered is None else self.gathered.error_of(light.irradiance)

    def around(self, distance: float) -> Neighbours:
        """Return some of the static receivers within a distance [m] of each; the last two answers are kept."""
        if distance not in self._around:
            model = self._model
            points, normals = (a[model.surfaces.receiver_range(0)] for a in model.object_receivers[:2])
            table = scattered_neighbours(model.adjacency, points, normals, distance, model.threads)
            self._around = dict([*self._around.items(), (distance, table)][-2:])
        return self._around[distance]

    def noise_field(self, b: Background, direct: bool) -> np.ndarray:
        """Return noise_field() (n,) of a background's photons, kept; direct: with segments that leave lamps."""
        key, near = (b, b.estimate.photons, direct), self.around(AROUND * b.setting.radius)
        if self._field is None or self._field[0] != key:
            threads, fewer = self._model.threads, subset_to_compare(b.estimate.subsets)
            whole, part = (b.irradiance_per_lamp(n or b.estimate.photons, direct).sum(axis=1) for n in (None, fewer))
            if fewer is None:  # too few photons: their noise hides all detail
                part = averaged(near, whole, np.ones(len(whole), bool), threads)
            self._field = key, noise_field(whole, part, near, threads)
        return self._field[1]

    def gather(self, shown: Callable[[], Background | None], new: Callable[[], None], early: float = math.inf) -> None:
        """Gather, or go on (StaticGather).

        shown: returns the background on show; new: called at first and after each result; early: as for it.
        """
        if self.gathered is None:
            self.gathered = StaticGather(self._model, self._seed)
        new()
        self.gathered.gather(lambda: None if (b := shown()) is None else _as_measured(b, self._weights), new, early)

    def error(self, levels: np.ndarray) -> float:
        """Return the relative l1 error at levels of the lamps of the light that is no photons'; inf before any."""
        light = self.best or (None if self.gathered is None else self.gathered.estimate)
        if light is None:
            return math.inf
        if self._error is None or self._error[0] is not light or not np.array_equal(self._error[1], levels):
            self._error = light, levels, light.error_at(levels, self._weights)
        return self._error[2]

    def on_show(self, b: Background | None) -> Estimate | None:
        """Return the light on show per lamp, with its error; None before there is some of known error."""
        if self.best is not None:
            return self.best
        if b is None or not b.estimate.photons:
            return None
        photons = self.of_photons(b, per_lamp=self._model.emitters.lamps.count > 1)
        return (
            photons._replace(error=max(photons.error, self._error_of(photons)))
            if math.isfinite(photons.noise)
            else None
        )

    # -- edits ------------------------------------------------------------------------------------

    def before_edit(self, shown: Background | None, unreached: np.ndarray) -> LightBefore | None:
        """Return the light on show for the scene after an edit; None where there is none of known noise.

        unreached (k,): receivers that light cannot reach. Edits in a row begin with the light before the first.
        """
        if shown is None or not shown.estimate.photons:
            return None
        if self.best is not None and self._edited is not None:
            return self._edited.before
        if self.best is not None:
            return light_before(shown, self.best, self._error_of(self.of_photons(shown)), unreached, self._bounces())
        if not math.isfinite(self.of_photons(shown).noise):
            return None
        return light_before(shown, self.of_photons(shown, per_lamp=True), 0.0, unreached, self._bounces())

    def _bounces(self) -> Bounces | None:
        """Return the bounces of this light, or those before an edit while they are more."""
        before = None if self._before is None else self._before.bounces
        own = None if self.gathered is None else self.gathered.bounces
        return max((b for b in (before, own) if b is not None), key=lambda b: b.paths, default=None)

    def relight(self) -> None:
        """Light the bounces of the scene before an edit, once direct light is known."""
        if self._edited is not None:
            self._edited.relight(self.direct, self._seed)

    def begin_with(self, before: LightBefore | None, gathered: StaticGather | None = None) -> None:
        """Show light before an edit, changed as photons say, until there is better.

        gathered: before an edit that leaves the static part as it was; it goes on.
        """
        self.gathered = None if gathered is None else gathered.copied(self._model)
        self._before, self._edited = before, None if before is None else EditedLight(before, self._model)

    @property
    def shows_earlier(self) -> bool:
        """Whether the light before an edit is to be shown."""
        return self._edited is not None

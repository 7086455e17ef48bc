"""Light of the static part without mobiles: the best of several estimates (`gi_core.gather.estimate`).

Gathered light (`gi_core.gather.static`) has less error than photons, as soon as there is some, unless faces are coarse.
After an edit the light before it is changed by the difference of the photons before and after (`edited_light.py`).

Where points on lamps resolve them, they bring direct light, and photons bounced light alone (Jensen 1996). Borders of
direct light then stay sharp.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gi_core.base.pause import undivided
from gi_core.frames.background import Background
from gi_core.frames.control_variate import AROUND, noise_field
from gi_core.frames.edited_light import EditedLight, LightBefore, light_before
from gi_core.gather.denoise import averaged
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.estimate import Estimate, better
from gi_core.gather.radiosity import Bounces
from gi_core.gather.static import StaticGather
from gi_core.geometry.error import noise_from_subset, subset_to_compare
from gi_core.geometry.mesh_neighbours import Neighbours, scattered_neighbours
from gi_core.lights.lamps import mix, sum_of_lamps
from gi_core.model import Model

CLOUDY = 2.0  # errors of photons are clouds: per error, a tenth of the view has 1.7 to 2.1 times the local deviation
UNRESOLVED = 0.2  # points bring 0.96 to 1.02 of the light of photons, and half of it where lamps touch surfaces


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
        # Of a background, its direct light, levels, and all its light.
        self._photons: tuple[Background, int, np.ndarray | None, np.ndarray, np.ndarray] | None = None
        # Light per lamp, levels, and their light: on show, and direct.
        self._mixed: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._error: tuple[Estimate, np.ndarray, float] | None = None  # of an estimate at levels
        self._field: tuple[tuple[Background, int, bool], np.ndarray] | None = None
        self._around: dict[float, Neighbours] = {}  # static receivers within a distance

    def is_early(self, paths: int) -> bool:
        """Whether there is no light but that of photons and of fewer than so many paths per receiver."""
        relit = 0 if self._edited is None else self._edited.paths
        return relit < paths and (self.gathered is None or self.gathered.is_early(paths))

    def irradiance(self, b: Background, levels: np.ndarray) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] at levels of the lamps; the same array for the same light.

        b: whose photons light the static part before there is better light.
        """
        if self.best is not None:
            return self.mixed("shown", self.best.light, levels)
        photons, direct, kept = b.estimate.photons, self.direct_for(b), self._photons
        same = kept is not None and kept[0] is b and kept[1] == photons and kept[2] is direct
        if not same or not np.array_equal(kept[3], levels):
            self._photons = kept = b, photons, direct, levels, self._of_photons(b, photons, levels)
        return kept[-1]

    def _of_photons(self, b: Background, photons: int, levels: np.ndarray) -> np.ndarray:
        """Return the light (n, 3) [W/m2] of some photons, with direct light of points where these resolve it."""
        direct = self.direct_for(b)
        E = b.irradiance(photons, levels, direct is None)
        return E if direct is None else E + self.mixed("straight", direct, levels)

    def deviation(self, levels: np.ndarray) -> np.ndarray:
        """Return the standard error (n,) [W/m2] of the luminance of irradiance(); nan for that of photons."""
        return np.full(len(self._areas), np.nan) if self.best is None else self.best.deviation_at(levels)

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

        The errors of photons and of light before an edit are the larger of their own and that which whole paths find,
        so the blur of discs counts. Errors of photons count CLOUDY times.
        """
        if shown is None or not shown.estimate.photons:
            return self.best is not None
        g, edited = self.gathered, None
        if self._edited is not None:
            edited = self._edited.estimate(shown, self.around(AROUND * shown.setting.radius))
            edited = edited and edited._replace(error=max(edited.error, self._error_of(edited.irradiance)))
        chosen = better(None if g is None else g.estimate, edited)
        if chosen is None:
            return self.best is not None
        if chosen is not edited:
            self._edited = None
        early = chosen is not edited and not self.gathered.is_measured  # the blur of photons is unknown too
        better_yet = early or chosen.error < CLOUDY * self._error_of_photons(shown)
        self.best = chosen if better_yet else None
        return better_yet

    def _error_of(self, E: np.ndarray) -> float:
        """Return the relative l1 error of E (n, 3) [W/m2] that whole paths at some receivers find; 0 before any."""
        return 0.0 if self.gathered is None else self.gathered.error_of(E)

    def _error_of_photons(self, b: Background) -> float:
        """Return the relative l1 error of the light of all photons; inf before it is measured."""
        photons, fewer = b.estimate.photons, subset_to_compare(b.estimate.subsets)
        if fewer is None:
            return math.inf
        levels, g = self._model.emitters.lamps.full(), self.gathered
        weights = self._areas if g is None else g.weights
        E, part = (self._of_photons(b, n, levels) for n in (photons, fewer))
        return max(noise_from_subset(E, part, photons, fewer, weights), self._error_of(E))

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

    def gather(self, new: Callable[[], None], early: float = math.inf) -> None:
        """Gather, or go on (StaticGather). new: called at first and after each result; early: as for it."""
        if self.gathered is None:
            self.gathered = StaticGather(self._model, self._seed)
        new()
        self.gathered.gather(new, early)

    def error(self, levels: np.ndarray) -> float:
        """Return the relative l1 error at levels of the lamps of the best light; inf before any."""
        g = self.gathered
        light = self.best or (None if g is None else g.estimate)
        if light is None:
            return math.inf
        if self._error is None or self._error[0] is not light or not np.array_equal(self._error[1], levels):
            self._error = light, levels, light.error_at(levels, self._areas if g is None else g.weights)
        return self._error[2]

    # -- edits ------------------------------------------------------------------------------------

    def before_edit(self, shown: Background | None, unreached: np.ndarray) -> LightBefore | None:
        """Return the light on show for the scene after an edit; None where it is that of photons.

        unreached (k,): receivers that light cannot reach. Edits in a row begin with the light before the first.
        """
        if shown is None or not shown.estimate.photons or self.best is None:
            return None
        if self._edited is not None:
            return self._edited.before
        return light_before(shown, self.best, unreached, self._bounces())

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

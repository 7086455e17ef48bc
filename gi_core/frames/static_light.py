"""Light of the static part without mobiles: that of photons, smoothed, or gathered light once it has less error."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Generator, Iterator

import numpy as np

from gi_core.base.steps import finish
from gi_core.frames.background import Background
from gi_core.frames.control_variate import AROUND
from gi_core.frames.earlier_light import EarlierLight, EditedLight, earlier_light
from gi_core.frames.light_setting import LightSetting
from gi_core.frames.progress import Progress
from gi_core.frames.smoothed_photons import NEAR, SmoothedPhotons, smooth_per_lamp, smooth_photons
from gi_core.gather.reference import ReferenceState
from gi_core.gather.static import PhotonLight, StaticGather
from gi_core.geometry.error import luminance, noise_from_subset, subset_to_compare
from gi_core.geometry.mesh_neighbours import Neighbours, neighbours, scattered_neighbours
from gi_core.lights.mix import mix, sum_of_lamps
from gi_core.model import Model


def _photon_noise(b: Background) -> float:
    """Return the relative l1 noise of a background's photons; inf where they are too few to measure it."""
    photons, fewer = b.estimate.photons, subset_to_compare(b.estimate.subsets)
    if fewer is None:
        return math.inf
    return noise_from_subset(b.irradiance(photons), b.irradiance(fewer), photons, fewer, b.weights)


class StaticLight:
    """`gathered` is the light gathered so far (`gi_core.gather.static`), None before it begins."""

    def __init__(self, model: Model, seed: int, setting: LightSetting):
        self.setting = setting
        self.gathered: StaticGather | None = None
        self._model, self._seed = model, seed
        self._edited: EditedLight | None = None  # until `gathered` has light of its own
        self._less_error = False  # gathered light has less error than all photons
        self._smoothed: SmoothedPhotons | None = None  # of the last background
        self._smoothed_per_lamp: tuple[SmoothedPhotons, np.ndarray] | None = None  # once levels differ from the file's
        # Light per lamp, levels, and their light: of photons, gathered, and direct.
        self._mixed: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._noise: tuple[np.ndarray, float] | None = None  # light, and its noise over that at the file's levels
        self._around: dict[float, Neighbours] = {}  # static receivers within a distance, of changes and of photons

    def twin(self, setting: LightSetting, fresh: bool) -> StaticLight:
        """Return static light under another setting, with the same gathered light, or none if `fresh`."""
        other = copy.copy(self)
        other.setting = setting
        if fresh:
            other.gathered, other._edited, other._less_error, other._smoothed = None, None, False, None
        return other

    @property
    def lacks_gathered(self) -> bool:
        """Whether frames may take gathered light, and there is none yet."""
        return self.setting.light == "best" and self.gathered is None

    @property
    def is_gathered(self) -> bool:
        """Whether frames start from gathered light: the setting allows it, and it has less error than photons."""
        return self.setting.takes_gathered and self._less_error

    def irradiance(self, b: Background, photons: int) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] of static receivers, for a frame of `photons` photons."""
        levels = self.setting.levels
        if self.is_gathered:
            return self.gathered_at(levels)
        if self.setting.takes_gathered:
            return self._of_photons_at(b, levels)
        return b.irradiance(photons if self.setting.subset_only else b.estimate.photons, levels)

    def is_own(self, b: Background, photons: int) -> bool:
        """Whether irradiance() is that of the frame's own photons: nothing is a better source."""
        return not self.setting.takes_gathered and (self.setting.subset_only or photons == b.estimate.photons)

    def smooth_steps(self, b: Background) -> Iterator[None]:
        """Smooth the light of all photons of a background in steps, where frames take it."""
        if self.setting.takes_gathered and b.estimate.photons:
            yield from self._smooth(b)

    def _smooth(self, b: Background) -> Generator[None, None, SmoothedPhotons]:
        if self._smoothed is None or not self._smoothed.is_of(b):
            around = self.around(NEAR * b.setting.radius)
            yield
            self._smoothed = yield from smooth_photons(b, around)
        return self._smoothed

    def _of_photons(self, b: Background) -> SmoothedPhotons:
        """Return the smoothed light of all photons of a background."""
        return finish(self._smooth(b))

    def _of_photons_at(self, b: Background, levels: np.ndarray) -> np.ndarray:
        """Return that light at levels of the lamps; the same array for the same light."""
        own = self._of_photons(b)
        if (levels == levels[0]).all():  # one factor for all, exactly
            return self.mixed("photons", own.irradiance, levels[:1])
        return self.mixed("photons", self._of_photons_per_lamp(b), levels)

    def _of_photons_per_lamp(self, b: Background) -> np.ndarray:
        """Return that light by lamp (n, 3 G)."""
        own = self._of_photons(b)
        if self._smoothed_per_lamp is None or self._smoothed_per_lamp[0] is not own:
            self._smoothed_per_lamp = own, finish(smooth_per_lamp(b, self.around(NEAR * b.setting.radius)))
        return self._smoothed_per_lamp[1]

    def mixed(self, which: str, light: np.ndarray, levels: np.ndarray) -> np.ndarray:
        """Return light per lamp at levels; the last result is kept."""
        kept = self._mixed.get(which)
        if kept is None or kept[0] is not light or not np.array_equal(kept[1], levels):
            kept = light, levels, mix(light, levels, self._model.threads)
            self._mixed = self._mixed | {which: kept}
        return kept[2]

    def shown_irradiance(self, shown: Background | None) -> np.ndarray:
        """Return irradiance() for all photons of the background on show; zeros without photons."""
        if shown is None or not (photons := shown.estimate.photons):
            return np.zeros((self._model.surfaces.receiver_range(0).stop, 3))
        return self.irradiance(shown, photons)

    def gathered_at(self, levels: np.ndarray) -> np.ndarray:
        """Return gathered irradiance (n, 3) [W/m2] at levels (G, 3) of the lamps; the same array for the same light."""
        return self.mixed("gathered", self.gathered.per_lamp, levels)

    @property
    def deviation(self) -> np.ndarray:
        """Standard error (n,) [W/m2] of the luminance of irradiance(); (0,) for photons as they are, or before any."""
        levels, own = self.setting.levels, self._smoothed
        if self.is_gathered:
            return self.gathered.deviation_at(levels)
        if own is None or not self.setting.takes_gathered:
            return np.zeros(0)
        full, at = luminance(own.irradiance), luminance(self._of_photons_at(own.background, levels))
        return own.deviation * np.divide(at, full, out=np.zeros_like(at), where=full > 0)

    def of_all_lamps(self, b: Background) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] of static receivers at the levels of the scene file."""
        return sum_of_lamps(self.gathered.per_lamp if self.is_gathered else b.irradiance_per_lamp(b.estimate.photons))

    def compare(self, shown: Background | None) -> bool:
        """Compare the errors of gathered light and of all photons; return whether frames start from gathered light.

        Photons have their noise, or the error that whole paths find, which includes the blur of discs; those before an
        edit, while its light is on show. Photons too few to measure their noise count as worse.
        """
        g, photons = self.gathered, 0 if shown is None else shown.estimate.photons
        if photons and self.shows_earlier:
            self._edited.show(shown, self.around(AROUND * shown.setting.radius), g)
        if photons and g is not None and math.isfinite(g.noise):
            theirs = self._of_photons(shown)
            before = self._edited.earlier.of_photons if self.shows_earlier else 0.0
            self._less_error = g.error < max(theirs.noise, g.error_of(theirs.irradiance), before)
        return self.is_gathered

    def around(self, distance: float) -> Neighbours:
        """Return some of the static receivers within a distance [m] of each; the last two answers are kept."""
        if distance not in self._around:
            model = self._model
            static = model.surfaces.receiver_range(0)
            near = neighbours(model.corners(0), static.stop)
            points, normals = (a[static] for a in model.object_receivers[:2])
            found = scattered_neighbours(near, points, normals, distance, model.threads)
            self._around = dict([*self._around.items(), (distance, found)][-2:])
        return self._around[distance]

    def gather_steps(
        self,
        state: ReferenceState | None,
        shown: Callable[[], Background | None],
        refresh: Callable[[], Iterator[Progress]],
    ) -> Iterator[Progress]:
        """Gather in steps, from `state` or continued; arguments as for StaticGather.

        shown: returns the background on show; refresh: computes its frame again, after each result that has less error
        than photons. Raises ValueError for the state of another scene.
        """
        if self.gathered is None or state is not None:
            self.gathered = StaticGather(self._model, self._seed, state)
        g = self.gathered

        def photons() -> PhotonLight | None:
            b = shown()
            if b is None or not b.estimate.photons:
                return None
            return PhotonLight(b.irradiance_per_lamp(b.estimate.photons), _photon_noise(b))

        for new in itertools.chain((True,), g.steps(photons)):
            if used := bool(new) and self.compare(shown()):
                yield from (p._replace(fraction=g.fraction) for p in refresh())
            yield Progress("gathering", g.fraction, used)

    @property
    def error(self) -> float:
        """Relative l1 error of gathered light at the levels of the setting; inf before there is any.

        That at the levels of the scene file is scaled as the noise is.
        """
        g, levels = self.gathered, self.setting.levels
        if g is None or not len(g.per_lamp):
            return math.inf
        light = self.gathered_at(levels)
        if self._noise is None or self._noise[0] is not light:
            self._noise = light, g.relative_noise(levels)
        return g.error * self._noise[1]

    # -- edits ------------------------------------------------------------------------------------

    def before_edit(self, shown: Background | None, unreached: np.ndarray) -> EarlierLight | None:
        """Return the light on show for the scene after an edit; None where photons alone light frames.

        unreached (k,): receivers that light cannot reach.
        """
        if shown is None or not shown.estimate.photons or self.setting.light == "photons":
            return None
        if self.is_gathered and self.shows_earlier:
            return self._edited.earlier
        own = self._of_photons(shown)
        if self.is_gathered:
            g = self.gathered
            return earlier_light(shown, g.per_lamp, g.deviation, g.error, g.error_of(own.irradiance), unreached)
        if not math.isfinite(own.noise):
            return None
        return earlier_light(shown, self._of_photons_per_lamp(shown), own.deviation, own.noise, 0.0, unreached)

    def begin_with(self, earlier: EarlierLight | None, gathered: StaticGather | None = None) -> None:
        """Show light before an edit, changed as photons say, until there is better.

        gathered: before an edit that leaves the static part as it was; it goes on.
        """
        self.gathered = StaticGather(self._model, self._seed) if gathered is None else gathered.copied(self._model)
        self._edited = None if earlier is None else EditedLight(earlier, self._model)

    @property
    def shows_earlier(self) -> bool:
        """Whether gathered light is that before an edit."""
        g = self.gathered
        return self._edited is not None and g is not None and (g.is_earlier or math.isinf(g.noise))

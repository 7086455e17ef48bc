"""Light of frames besides the estimate of their photons, in parts that do not know each other."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

import numpy as np

from gi_core.base.pause import pause
from gi_core.display.dilation import UnreachedReceivers
from gi_core.frames.background import Background
from gi_core.frames.control_variate import Direct
from gi_core.frames.edited_light import LightAtPoses
from gi_core.frames.frame_gloss import FrameGloss
from gi_core.frames.held_light import Held, HeldLevels
from gi_core.frames.light_setting import PATHS, PATHS_AT_REST, FrameSize, LightSetting
from gi_core.frames.mobile_light import AtRest, MobileLight, PoseLight
from gi_core.frames.static_light import StaticLight
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.estimate import Source
from gi_core.gather.pose_gather import PoseGather, Static
from gi_core.geometry.error import luminance
from gi_core.gloss.light import GlossLight
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange
from gi_core.scene.rules import one_of


class FrameLight:
    """`setting` chooses among the parts.

    A frame begins with the light of the static part (`static`), changed by mobiles according to its photons
    (`control_variate.py`) and by the direct light that they block (`direct`). Paths of the frame light mobiles
    (`mobiles`). At poses that have rested, light gathered with mobiles in place replaces both (`at_poses`). `gloss` has
    the directions of all that light. `unreached` are the receivers that pictures fill. `held` are targets for which
    each frame finds the levels of the lamps, at most those asked for.
    """

    def __init__(self, model: Model, seed: int):
        self._model, self._seed = model, seed
        self.setting = LightSetting(model.emitters.lamps.full())
        self.static = StaticLight(model, seed, DirectLight(model, seed))
        self.unreached = UnreachedReceivers(model)
        self.mobiles = MobileLight(model, seed)
        self.gloss = FrameGloss(model, seed)
        self.at_poses = PoseLight(model, seed)
        self.held: Held | None = None

    def twin(self, fresh: bool) -> FrameLight:
        """Return light with a separate setting and the same gathered light, or none if `fresh`."""
        other = copy.copy(self)
        for name in ("setting", "static", "unreached", "mobiles", "gloss", "at_poses"):
            setattr(other, name, copy.copy(getattr(self, name)))
        if fresh:
            other.static = StaticLight(self._model, self._seed, self.direct)
            other.at_poses = PoseLight(self._model, self._seed)
            other.gloss.forget_gathered()
        return other

    # -- the static part --------------------------------------------------------------------------

    @property
    def is_gathered(self) -> bool:
        """Whether frames start from better light than that of photons: the setting allows it, and there is some."""
        return self.setting.takes_gathered and self.static.best is not None

    @property
    def source(self) -> Source:
        """The source of the static part's light without mobiles."""
        return self.static.best.source if self.is_gathered else Source.PHOTONS

    def static_irradiance(self, b: Background, photons: int) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] of the static part without mobiles, for a frame of `photons` photons."""
        setting = self.setting
        if setting.takes_gathered:
            return self.static.irradiance(b, setting.levels)
        return b.irradiance(photons if setting.subset_only else b.estimate.photons, setting.levels)

    def is_own(self, b: Background, photons: int) -> bool:
        """Whether static_irradiance() is that of the frame's own photons: nothing is a better source."""
        return not self.setting.takes_gathered and (self.setting.subset_only or photons == b.estimate.photons)

    def smooth(self, b: Background) -> None:
        """Smooth the light of all photons of a background, where frames take it."""
        if self.setting.takes_gathered and b.estimate.photons:
            self.static.of_photons(b)

    def gather(self, shown: Callable[[], Background | None], refresh: Callable[[], None]) -> None:
        """Gather static light, and the directions of each result.

        shown: as for StaticLight; refresh: computes the frame on show again, after each result that frames take.
        """

        def take() -> None:
            before = self.is_gathered
            self.static.compare(shown())
            if used := before or self.is_gathered:  # photons may have less error than was known
                refresh()
            pause(self.static.gathered.progress(picture=used))
            if self.is_gathered:
                b, static = shown(), self._model.static
                E = self.static.irradiance(b, self.setting.levels)
                self.gloss.gather(b, static, E, np.arange(len(E)), self.setting, refresh)

        self.static.gather(shown, take)

    # -- direct light -----------------------------------------------------------------------------

    @property
    def direct(self) -> DirectLight:
        """Direct light of static receivers, known or not."""
        return self.static.direct

    def measure_direct(self) -> None:
        """Measure the static part's direct light, where frames take it."""
        if self.setting.takes_gathered:
            self.direct.measure()

    def knows_direct(self, b: Background) -> bool:
        """Whether frames take direct light as it is, and bounced light alone from the photons of a background."""
        return self.setting.takes_gathered and self.static.direct_for(b) is not None

    def direct_at(self, at: Transforms, b: Background) -> Direct:
        """Return direct light at poses; zeros where photons bring it."""
        if not self.knows_direct(b):
            return Direct.unknown(self._model.surfaces.receiver_range(0).stop)
        levels = self.setting.levels
        return Direct(self.static.mixed("direct", self.direct.per_lamp, levels), self.direct.blocked(at, levels))

    def hold(self, held: HeldLevels | None) -> HeldLevels | None:
        """Take the levels that hold targets; None: those asked for."""
        levels = self.setting.asked if held is None else held.levels
        if not np.array_equal(levels, self.setting.levels):
            self.setting.levels = levels  # else the same array: light at it is kept
        return held

    # -- mobiles ----------------------------------------------------------------------------------

    def size(self, photons: int, paths: int | None = None) -> FrameSize:
        """Return the size of a frame. Without photons there are no paths.

        paths: per receiver of a mobile, None: PATHS_AT_REST. Raises SceneError for a number that is not one of PATHS.
        """
        if paths is not None:
            one_of(PATHS).check("the paths per receiver and frame", paths)
        gathers = photons and self.setting.light == "best" and self._model.names
        return FrameSize(photons, (PATHS_AT_REST if paths is None else paths) if gathers else 0)

    def light_mobiles(
        self, E: np.ndarray, at: Transforms, unbiased: np.ndarray, paths: int, b: Background, fresh: bool = False
    ) -> None:
        """Replace irradiance E (R, 3) [W/m2] of receivers on mobiles by light gathered from the static part.

        unbiased (>= n, 3) [W/m2]: of the static part at these poses; fresh: without caches of earlier frames.
        """
        self.mobiles.replace_in(E, at, unbiased, paths, self.setting.levels, self.at_rest(b), fresh)

    def at_rest(self, b: Background) -> AtRest:
        """Return the static part without mobiles, as paths from mobiles see it."""
        static = self.static_irradiance(b, b.estimate.photons)
        return AtRest(static, self.mobiles.reflectance(b, static, self.unreached.static, self.setting.levels))

    # -- resting poses ----------------------------------------------------------------------------

    def gathered_at(self, at: Transforms) -> PoseGather | None:
        """Return the light gathered at poses, None if there is none or frames take none."""
        return self.at_poses.find(at, self.setting.levels) if self.setting.takes_gathered else None

    def rested(self, E: np.ndarray, at: Transforms, b: Background, photons: int) -> np.ndarray:
        """Return irradiance (R, 3) of a frame with light gathered at its poses in its place; E where there is none."""
        if not self.setting.takes_gathered:
            return E
        return self.at_poses.replaced(E, lambda: self.static_irradiance(b, photons), at, self.setting.levels)

    def deviation(
        self, at: Transforms, b: Background | None, of_frame: tuple[np.ndarray, np.ndarray] | None = None
    ) -> np.ndarray:
        """Return the standard error (R,) of the luminance [W/m2] at poses, without that of the change of photons.

        of_frame: the light (R, 3) [W/m2] of a frame there and its deviation by that change (n,), None: of any. With it
        this change counts, and bias, as the static part's light has it on average; nan where paths of the frame light
        mobiles, whose error is not known.
        """
        receivers = len(self._model.object_receivers.areas)
        if not self.setting.takes_gathered:
            return np.full(receivers, 0.0 if of_frame is None else np.nan)
        levels, out = self.setting.levels, np.zeros(receivers)
        static = self.static.deviation(b, levels)
        out[: len(static)] = static
        if of_frame is not None:
            n = self._model.surfaces.receiver_range(0).stop
            now, light = luminance(of_frame[0][:n]), luminance(self.static_irradiance(b, 0))
            kept = np.minimum(np.divide(now, light, out=np.ones(n), where=light > 0), 1.0)  # in shadow, of its error
            kept *= self.static.best.understated if self.static.best is not None else np.nan
            out[:n] = np.hypot(kept * out[:n], of_frame[1])
            out[n:] = np.nan
        return self.at_poses.deviation(at, levels, out)

    def before_edit(
        self, b: Background, photons: int, irradiance: np.ndarray, own: np.ndarray, at: Transforms
    ) -> LightAtPoses | None:
        """Return the light of a frame for the scene after an edit; None where none was gathered at its poses."""
        light = irradiance, own, self.static_irradiance(b, photons), self.deviation(at, b)
        return self.at_poses.before_edit(*light, at, self.setting.levels)

    def gather_at_poses(
        self, shown: Background | None, photons: int, irradiance: np.ndarray, gloss: GlossLight | None, at: Transforms,
        refresh: Callable[[], None],
    ) -> None:  # fmt: skip
        """Gather light at the poses `at`. Nothing is gathered unless the frame has all photons.

        irradiance (R, 3) [W/m2] and gloss are those of the frame of `photons` at these poses. Directions of
        gloss come first, because they take few paths. `refresh` computes the frame again. Settings without gathered
        light gather nothing.
        """
        if shown is None or not 0 < photons == shown.estimate.photons:
            return
        setting = self.setting
        if not self._model.names or not setting.takes_gathered:
            return

        latest: Static | None = None

        def static() -> Static | None:
            nonlocal latest
            if not self.is_gathered:
                return None
            E = self.static.irradiance(shown, setting.levels)
            if latest is None or latest[0] is not E:  # a fifth of a step's time
                best = self.static.best
                latest = E, best.understated * best.deviation_at(setting.levels)
            return latest

        light = self.static_irradiance(shown, photons)
        area = math.pi * shown.setting.radius**2
        if gloss is not None:
            self.gloss.gather(shown, at, irradiance, gloss.owners[gloss.changed], setting, refresh)
        self.at_poses.gather(at, setting.levels, photons, irradiance, light, area, static, refresh)

    # -- gloss ------------------------------------------------------------------------------------

    def gloss_at(
        self, b: Background, change: PoseChange, clock: Callable[[str], None], paths: int
    ) -> GlossLight | None:
        """Return the directional light of a frame; None without glossy faces. clock: called after each step.

        paths: to each receiver of a mobile, which have lit this frame; 0: photons light mobiles.
        """
        return self.gloss.light(b, change, clock, self.setting, self.is_gathered, self.mobiles.write_cells, paths)

    def lacks_gloss(self, shown: Background | None) -> bool:
        """Whether gather() has directions of gathered light to gather."""
        ready = shown is not None and shown.estimate.photons and self.is_gathered
        return bool(ready) and self.gloss.lacks_static(shown, self.setting)

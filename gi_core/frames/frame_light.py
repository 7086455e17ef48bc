"""Light of frames besides the estimate of their photons, in parts."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Iterator

import numpy as np

from gi_core.frames.background import Background
from gi_core.frames.control_variate import Direct
from gi_core.frames.frame_gloss import FrameGloss
from gi_core.frames.light_setting import LightSetting
from gi_core.frames.mobile_light import MobileLight
from gi_core.frames.pose_light import PoseLight
from gi_core.frames.progress import Progress
from gi_core.frames.static_light import StaticLight
from gi_core.frames.unreached import UnreachedReceivers
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.reference import ReferenceState
from gi_core.gloss.light import GlossLight
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms

UNRESOLVED = 0.2  # points bring 0.96 to 1.02 of the light of photons, and half of it where lamps touch surfaces


class FrameLight:
    """`setting` chooses among the parts, which all read it.

    A frame begins with the light of the static part (`static`), changed by mobiles according to its photons
    (`control_variate.py`) and by the direct light that they block (`direct`). Paths of the frame light mobiles
    (`mobiles`). At poses that have rested, light gathered with mobiles in place replaces both (`at_poses`). `gloss` has
    the directions of all that light. `unreached` are the receivers that pictures fill.
    """

    def __init__(self, model: Model, seed: int):
        self._model = model
        self.setting = LightSetting(model.emitters.lamps.full())
        self.static = StaticLight(model, seed, self.setting)
        self.unreached = UnreachedReceivers(model)
        self.mobiles = MobileLight(model, seed, self.static, self.unreached)
        self.gloss = FrameGloss(model, seed, self.static, self.mobiles)
        self.at_poses = PoseLight(model, seed, self.static)
        self.direct = DirectLight(model, seed)
        self._resolved: tuple[Background, int, bool] | None = None  # of the photons of a background

    def twin(self, fresh: bool) -> FrameLight:
        """Return light with a separate setting and the same gathered light, or none if `fresh`."""
        other = copy.copy(self)
        other.setting = copy.copy(self.setting)
        other.static = self.static.twin(other.setting, fresh)
        other.unreached = self.unreached.twin()
        other.mobiles = self.mobiles.twin(other.static, other.unreached)
        other.gloss = self.gloss.twin(other.static, other.mobiles, fresh)
        other.at_poses = self.at_poses.twin(other.static, fresh)
        return other

    def direct_steps(self) -> Iterator[None]:
        """Measure the static part's direct light in steps, where frames take it."""
        return self.direct.steps() if self.setting.takes_gathered else iter(())

    def knows_direct(self, b: Background) -> bool:
        """Whether frames take direct light as it is, and bounced light alone from the photons of a background."""
        known = self.setting.takes_gathered and b.estimate.additive and self.direct.is_known
        if not known or not b.estimate.photons:
            return False
        if self._resolved is None or self._resolved[:2] != (b, b.estimate.photons):
            self._resolved = b, b.estimate.photons, self._resolves(b)
        return self._resolved[2]

    def _resolves(self, b: Background) -> bool:
        """Return whether points on lights bring about as much light as the photons of a background."""
        points = b.weights @ self.direct.per_lamp.sum(axis=1)
        photons = b.weights @ b.direct_irradiance.sum(axis=1)
        return abs(points - photons) <= UNRESOLVED * photons

    def direct_at(self, at: Transforms, b: Background) -> Direct:
        """Return direct light at poses; zeros where photons bring it."""
        if not self.knows_direct(b):
            return Direct.unknown(self._model.surfaces.receiver_range(0).stop)
        levels = self.setting.levels
        return Direct(self.static.mixed("direct", self.direct.per_lamp, levels), self.direct.blocked(at, levels))

    def gather_steps(
        self,
        state: ReferenceState | None,
        shown: Callable[[], Background | None],
        refresh: Callable[[], Iterator[Progress]],
    ) -> Iterator[Progress]:
        """Gather static light in steps, and the directions of each result; arguments as in StaticLight."""
        for p in self.static.gather_steps(state, shown, refresh):
            yield p
            for of_gloss in self.gloss.static_steps(shown()) if p.picture else ():
                if of_gloss.picture:
                    yield from refresh()
                yield of_gloss

    def pose_steps(
        self, shown: Background | None, photons: int, irradiance: np.ndarray, gloss: GlossLight | None, at: Transforms,
        refresh: Callable[[], None],
    ) -> Iterator[Progress]:  # fmt: skip
        """Gather light at poses in steps; irradiance (R, 3) [W/m2] and gloss of the frame of `photons` there.

        Directions come first, as they take few paths. refresh: computes the frame again. Nothing for a frame of few
        photons, and where frames take no gathered light.
        """
        if shown is None or not 0 < photons == shown.estimate.photons:
            return
        if not self._model.names or not self.setting.takes_gathered:
            return
        directions = self.gloss.pose_steps(shown, gloss, irradiance, at)
        for p in itertools.chain(directions, self.at_poses.steps(shown, photons, irradiance, at)):
            if p.picture:
                refresh()
            yield p

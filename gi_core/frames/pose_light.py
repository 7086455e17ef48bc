"""Light gathered at resting poses with mobiles in place; it replaces a frame's own (`gi_core.gather.pose_gather`)."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator

import numpy as np

from gi_core.frames.background import Background
from gi_core.frames.earlier_at_poses import EarlierAtPoses, LightAtPoses
from gi_core.frames.progress import Progress
from gi_core.frames.static_light import StaticLight
from gi_core.gather.pose_gather import PoseGather, PoseGathers, Static
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms


class PoseLight:
    """Light of the last poses, each at some levels of the lamps."""

    def __init__(self, model: Model, seed: int, static: StaticLight):
        self._model, self._seed, self._static = model, seed, static
        self._gathers = PoseGathers(model, seed)
        self._earlier: EarlierAtPoses | None = None

    def twin(self, static: StaticLight, fresh: bool) -> PoseLight:
        """Return the light of poses beside other static light: the same, or none if `fresh`."""
        other = copy.copy(self)
        other._static = static
        if fresh:
            other._gathers, other._earlier = PoseGathers(self._model, self._seed), None
        return other

    def find(self, at: Transforms) -> PoseGather | None:
        """Return the light gathered at poses, None if there is none or frames take none."""
        setting = self._static.setting
        return self._gathers.find(at, setting.levels) if setting.takes_gathered else None

    def replaced(self, irradiance: np.ndarray, at: Transforms, b: Background, photons: int) -> np.ndarray:
        """Return irradiance (R, 3) at poses, with light gathered there in its place; the same array where none was.

        photons: of the frame, from this background.
        """
        out = irradiance
        if (earlier := self._earlier_at(at)) is not None:
            out = irradiance.copy()
            out[earlier.rows] = earlier.light_now(irradiance, self._static.irradiance(b, photons))
        if (found := self.find(at)) is not None and (shown := self._shown(found, earlier)).any():
            out = irradiance.copy() if out is irradiance else out
            out[found.rows[shown]] = found.mean[shown]
        return out

    def _shown(self, found: PoseGather, earlier: EarlierAtPoses | None) -> np.ndarray:
        """Return which receivers (n,) bool show gathered light: in the end all do in place of light before an edit."""
        ended = earlier is not None and found.enough and len(found.mean) > 0
        return np.ones(len(found.rows), bool) if ended else found.used

    def _earlier_at(self, at: Transforms) -> EarlierAtPoses | None:
        setting, earlier = self._static.setting, self._earlier
        fits = earlier is not None and setting.takes_gathered and earlier.is_at(at, setting.levels)
        return earlier if fits else None

    def before_edit(
        self, irradiance: np.ndarray, own: np.ndarray, at: Transforms, b: Background, photons: int
    ) -> LightAtPoses | None:
        """Return the light of a frame for the scene after an edit; None where none was gathered at its poses.

        irradiance, own (R, 3) [W/m2]: with that light and without; photons: as in replaced(). The light before edits
        in a row is that before the first.
        """
        if own is irradiance:
            return None
        earlier, found = self._earlier_at(at), self.find(at)
        if earlier is not None and (found is None or not self._shown(found, earlier).any()):
            return earlier.light
        light = irradiance, own, self._static.irradiance(b, photons), self.deviation(at)
        return LightAtPoses(self._model, at, self._static.setting.levels, *light)

    def begin_with(self, light: LightAtPoses | None) -> None:
        """Show light before an edit, changed as frames say, until there is better; the static part is the same."""
        self._earlier = None if light is None else EarlierAtPoses(light, self._model)

    def deviation(self, at: Transforms) -> np.ndarray:
        """Return the standard error (R,) of the luminance at poses [W/m2], where the change of photons is not its
        source.
        """
        out, static = np.zeros(len(self._model.object_receivers.areas)), self._static.deviation
        out[: len(static)] = static
        if (earlier := self._earlier_at(at)) is not None:
            out[earlier.rows] = earlier.light.deviation[earlier.rows_before]
        if (found := self.find(at)) is not None and (shown := self._shown(found, earlier)).any():
            out[found.rows[shown]] = found.deviation[shown]
        return out

    def steps(self, b: Background, photons: int, irradiance: np.ndarray, at: Transforms) -> Iterator[Progress]:
        """Gather at poses in steps, see `PoseGather.steps`; `picture` where frames change.

        irradiance (R, 3) [W/m2]: of the frame of all `photons` there.
        """
        light, levels = self._static, self._static.setting.levels
        given = photons, irradiance, light.irradiance(b, photons), math.pi * b.setting.radius**2
        begun = self._gathers.begin(at, levels, *given)
        yield Progress("gathering at these poses", begun.fraction, False)
        known: Static | None = None

        def static() -> Static | None:
            nonlocal known
            if not light.is_gathered:
                return None
            E = light.gathered_at(levels)
            if known is None or known[0] is not E:  # a fifth of a step's time
                known = E, light.gathered.deviation_at(levels)
            return known

        for changed in begun.steps(static):
            ended = begun.enough and self._earlier_at(at) is not None
            yield Progress("gathering at these poses", begun.fraction, bool(changed) or ended)

"""Light gathered at resting poses with mobiles in place; it replaces a frame's own (`gi_core.gather.pose_gather`)."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator

import numpy as np

from gi_core.frames.background import Background
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

    def twin(self, static: StaticLight, fresh: bool) -> PoseLight:
        """Return the light of poses beside other static light: the same, or none if `fresh`."""
        other = copy.copy(self)
        other._static = static
        if fresh:
            other._gathers = PoseGathers(self._model, self._seed)
        return other

    def find(self, at: Transforms) -> PoseGather | None:
        """Return the light gathered at poses, None if there is none or frames take none."""
        setting = self._static.setting
        return self._gathers.find(at, setting.levels) if setting.takes_gathered else None

    def replace_in(self, irradiance: np.ndarray, at: Transforms) -> None:
        """Replace irradiance (R, 3) where light was gathered at these poses."""
        if (found := self.find(at)) is not None and found.used.any():
            irradiance[found.rows[found.used]] = found.mean[found.used]

    def deviation(self, at: Transforms) -> np.ndarray:
        """Return the standard error (R,) of the luminance at poses [W/m2], where the change of photons is not its
        source.
        """
        out, static = np.zeros(len(self._model.object_receivers.areas)), self._static.deviation
        out[: len(static)] = static
        if (found := self.find(at)) is not None and found.used.any():
            out[found.rows[found.used]] = found.deviation[found.used]
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
            yield Progress("gathering at these poses", begun.fraction, bool(changed))

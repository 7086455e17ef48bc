"""Directions of the light at glossy receivers in frames: from photons, from gathered light, from paths to mobiles."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from gi_core.frames.background import Background
from gi_core.frames.gathered_gloss import GatheredGloss
from gi_core.frames.mobile_light import MobileLight
from gi_core.frames.progress import Progress
from gi_core.frames.static_light import StaticLight
from gi_core.gather.gloss_gather import GlossGather
from gi_core.gloss.cells import StaticCells
from gi_core.gloss.light import GlossLight
from gi_core.gloss.source import OPENED, QUADTREE, GlossSource
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange


class KeptGloss(NamedTuple):
    """Directions of the static part's light, that edits of mobiles keep."""

    cells: StaticCells | None  # of photons
    gathered: GlossGather | None
    levels: np.ndarray  # (G, 3), of the lamps, at which they were gathered


class FrameGloss:
    """`source` has the directions of photons; gathered ones replace them where the setting allows it."""

    def __init__(self, model: Model, seed: int, static: StaticLight, mobiles: MobileLight):
        self.source = GlossSource(model)
        self._model, self._seed, self._static, self._mobiles = model, seed, static, mobiles
        self._gathered = GatheredGloss(model, seed, self.source)

    def twin(self, static: StaticLight, mobiles: MobileLight, fresh: bool) -> FrameGloss:
        """Return gloss for other light, with the same gathered directions, or none if `fresh`."""
        other = copy.copy(self)
        other._static, other._mobiles = static, mobiles
        if fresh:
            other._gathered = GatheredGloss(self._model, self._seed, self.source)
        return other

    def kept(self, b: Background) -> KeptGloss:
        """Return a copy of the directions of a background's light, for the scene after an edit."""
        levels, light = self._static.setting.levels, None
        if self._static.setting.takes_gathered_gloss and (found := self._gathered.static_light(b, levels)) is not None:
            light = found.copied(self._model)
        return KeptGloss(self.source.static_cells, light, levels)

    def begin_with(self, kept: KeptGloss, b: Background) -> None:
        """Go on from directions of a scene of the same static part; b: its background here."""
        self.source.begin_with(kept.cells, b.store)
        if kept.gathered is not None:
            self._gathered.begin_with(kept.gathered, b, kept.levels)

    def reach(self, radius: float, paths: int) -> float:
        """Return the distance [m] within which photons near mobiles matter; arguments as for light()."""
        return 0.0 if self._by_paths(paths) else self.source.reach(radius, self._static.setting.gloss)

    def _by_paths(self, paths: int) -> bool:
        """Whether paths give the directions of light on mobiles: single rays come from photons."""
        return paths > 0 and self._static.setting.gloss == QUADTREE

    def light(
        self, b: Background, change: PoseChange, clock: Callable[[str], None], paths: int = 0
    ) -> GlossLight | None:
        """Return the directional light of a frame; None without glossy faces. clock: called after each step.

        paths: to each receiver of a mobile, which have lit this frame; 0: photons light mobiles.
        """
        setting = self._static.setting
        levels, gathers = setting.levels, setting.takes_gathered_gloss
        photons = b.store, b.store.subset(b.estimate.photons)[0], b.store.weights(levels)
        rest = self._gathered.at_rest(b, levels) if self._static.is_gathered and gathers else None
        on_mobiles = self._mobiles.write_cells if self._by_paths(paths) else None
        light = self.source.light(setting.gloss, b.setting.radius, photons, change, clock, rest, on_mobiles)
        if light is None or not gathers:
            return light
        return self._gathered.settle(light, b, change.at, levels)

    def is_kept_as_chosen(self, light: GlossLight | None) -> bool:
        """Return whether a frame's directional light is kept in the way of the setting."""
        return light is None or light.opened == OPENED[self._static.setting.gloss]

    # -- gathering --------------------------------------------------------------------------------

    def lacks_static(self, shown: Background | None) -> bool:
        """Whether static_steps() has directions of gathered light to gather."""
        setting, gathered = self._static.setting, self._static.is_gathered
        ready = shown is not None and shown.estimate.photons and gathered and setting.takes_gathered_gloss
        return bool(ready) and not self._gathered.is_enough(shown, setting.levels)

    def static_steps(self, shown: Background) -> Iterator[Progress]:
        """Gather the directions of the static part's gathered light, in steps; `picture` where frames change."""
        setting = self._static.setting
        if setting.takes_gathered_gloss:
            light = self._static.gathered_at(setting.levels)
            every = np.arange(len(light))
            yield from self._gathered.steps(shown, self._model.static, setting.levels, light, every)

    def pose_steps(
        self, b: Background, light: GlossLight | None, irradiance: np.ndarray, at: Transforms
    ) -> Iterator[Progress]:
        """Gather directions at poses as static_steps() does; light and irradiance (R, 3) [W/m2] of the frame there."""
        setting = self._static.setting
        if light is not None and setting.takes_gathered_gloss:
            changed = light.owners[light.changed]
            yield from self._gathered.steps(b, at, setting.levels, irradiance, changed)

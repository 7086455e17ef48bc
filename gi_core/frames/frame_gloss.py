"""Directions of the light at glossy receivers in frames: from photons, from gathered light, from paths to mobiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from gi_core.frames.background import Background
from gi_core.frames.gathered_gloss import GatheredGloss
from gi_core.frames.light_setting import LightSetting
from gi_core.frames.progress import Progress
from gi_core.gather.gloss_gather import GlossGather
from gi_core.gloss.cells import StaticCells
from gi_core.gloss.light import CellWriter, GlossLight
from gi_core.gloss.source import QUADTREE, GlossSource
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

    def __init__(self, model: Model, seed: int):
        self.source = GlossSource(model)
        self._model, self._seed = model, seed
        self.forget_gathered()

    def forget_gathered(self) -> None:
        """Begin without gathered directions."""
        self._gathered = GatheredGloss(self._model, self._seed, self.source)

    def kept(self, b: Background, setting: LightSetting) -> KeptGloss:
        """Return a copy of the directions of a background's light, for the scene after an edit."""
        light = self._gathered.static_light(b, setting.levels) if setting.takes_gathered_gloss else None
        return KeptGloss(self.source.static_cells, light and light.copied(self._model), setting.levels)

    def begin_with(self, kept: KeptGloss | None, b: Background) -> None:
        """Go on from directions of a scene of the same static part; b: its background here."""
        if kept is None:
            return
        self.source.begin_with(kept.cells, b.store)
        if kept.gathered is not None:
            self._gathered.begin_with(kept.gathered, b, kept.levels)

    def reach(self, radius: float, paths: int, way: str) -> float:
        """Return the distance [m] within which photons near mobiles matter; arguments as for light()."""
        return 0.0 if _by_paths(paths, way) else self.source.reach(radius, way)

    def light(
        self, b: Background, change: PoseChange, clock: Callable[[str], None], setting: LightSetting, gathered: bool,
        write_cells: CellWriter, paths: int,
    ) -> GlossLight | None:  # fmt: skip
        """Return the directional light of a frame; None without glossy faces. clock: called after each step.

        gathered: the static part's light is. paths: to each receiver of a mobile, which have lit this frame and which
        write_cells() reads; 0: photons light mobiles.
        """
        levels, gathers = setting.levels, setting.takes_gathered_gloss
        photons = b.store, b.store.subset(b.estimate.photons)[0], b.store.weights(levels)
        rest = self._gathered.at_rest(b, levels) if gathered and gathers else None
        on_mobiles = write_cells if _by_paths(paths, setting.gloss) else None
        light = self.source.light(setting.gloss, b.setting.radius, photons, change, clock, rest, on_mobiles)
        if light is None or not gathers:
            return light
        return self._gathered.settle(light, b, change.at, levels)

    # -- gathering --------------------------------------------------------------------------------

    def lacks_static(self, shown: Background, setting: LightSetting) -> bool:
        """Whether static_steps() has directions to gather."""
        return setting.takes_gathered_gloss and not self._gathered.is_enough(shown, setting.levels)

    def static_steps(self, shown: Background, light: np.ndarray, setting: LightSetting) -> Iterator[Progress]:
        """Gather the directions of the static part's light (n, 3) [W/m2], in steps; `picture` where frames change."""
        if setting.takes_gathered_gloss:
            every = np.arange(len(light))
            yield from self._gathered.steps(shown, self._model.static, setting.levels, light, every)

    def pose_steps(
        self, b: Background, light: GlossLight | None, irradiance: np.ndarray, at: Transforms, setting: LightSetting
    ) -> Iterator[Progress]:
        """Gather directions at poses as static_steps() does; light and irradiance (R, 3) [W/m2] of the frame there."""
        if light is not None and setting.takes_gathered_gloss:
            changed = light.owners[light.changed]
            yield from self._gathered.steps(b, at, setting.levels, irradiance, changed)


def _by_paths(paths: int, way: str) -> bool:
    """Return whether paths give the directions of light on mobiles: single rays come from photons."""
    return paths > 0 and way == QUADTREE

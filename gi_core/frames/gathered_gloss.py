"""Directions of gathered light in frames: of the static part without mobiles, and at resting poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gi_core.frames.background import Background
from gi_core.frames.progress import Progress
from gi_core.gather.gloss_gather import ROUNDS, GlossGathers
from gi_core.gloss.cells import GlossLight, as_light, settled
from gi_core.gloss.source import GlossSource
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms

STAGE = "gathering gloss"


class GatheredGloss:
    """Belongs to the cells of `source`."""

    def __init__(self, model: Model, seed: int, source: GlossSource):
        self._model, self._source, self._gathers = model, source, GlossGathers(model, seed)

    def is_enough(self, b: Background, levels: np.ndarray) -> bool:
        """Return whether the static part's light without mobiles is gathered, or has no directions to gather."""
        cells = self._source.cells(b.setting.radius)
        found = None if cells is None else self._gathers.find(cells.discs, self._model.static, levels)
        return cells is None or (found is not None and found.enough)

    def at_rest(self, b: Background, levels: np.ndarray) -> np.ndarray | None:
        """Return the static part's light without mobiles, as GlossCells.evaluate() takes it; None before a result."""
        cells = self._source.cells(b.setting.radius)
        found = None if cells is None else self._gathers.find(cells.discs, self._model.static, levels)
        return None if found is None else found.mean

    def settle(self, light: GlossLight, b: Background, at: Transforms, levels: np.ndarray) -> GlossLight:
        """Return the light of a frame with the directions gathered at its poses, if there are any."""
        cells = self._source.cells(b.setting.radius)
        found = None if cells is None or len(at.position) == 1 else self._gathers.find(cells.discs, at, levels)
        return (
            light if found is None else settled(light, np.searchsorted(light.owners, found.rows), as_light(found.mean))
        )

    def steps(
        self, b: Background, at: Transforms, levels: np.ndarray, irradiance: np.ndarray, changed: np.ndarray
    ) -> Iterator[Progress]:
        """Gather at poses in steps of some 30 ms, see `GlossGather`; `picture` where frames change.

        irradiance: of the objects in `at` [W/m2]; changed (n,) int64: receivers of the static part that mobiles change,
        or all of them for `at` without mobiles.
        """
        cells = self._source.cells(b.setting.radius)
        if cells is None:
            return
        rows, objects = cells.discs.rows, len(at.position)
        static = rows[: cells.discs.first[1]]
        rows = np.concatenate([np.intersect1d(static, changed), rows[len(static) : cells.discs.first[objects]]])
        area = math.pi * b.setting.radius**2
        gather = self._gathers.begin(cells.discs, at, levels, rows, irradiance, area)
        yield from (Progress(STAGE, gather.rounds / ROUNDS, new) for new in gather.steps())

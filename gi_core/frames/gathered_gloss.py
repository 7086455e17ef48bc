"""Directions of gathered light in frames: of the static part without mobiles, and at resting poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gi_core.frames.background import Background
from gi_core.frames.progress import Progress
from gi_core.gather.gloss_gather import GlossGather, GlossGathers
from gi_core.gather.pose_gather import KEPT
from gi_core.geometry.mesh_neighbours import Neighbours, neighbours, scattered_neighbours
from gi_core.gloss.cells import GlossCells
from gi_core.gloss.discs import GlossDiscs
from gi_core.gloss.light import GlossLight, settled
from gi_core.gloss.shares import as_light
from gi_core.gloss.source import GlossSource
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms

STAGE = "gathering gloss"


class GatheredGloss:
    """Belongs to the cells of `source`."""

    def __init__(self, model: Model, seed: int, source: GlossSource):
        self._model, self._source, self._gathers = model, source, GlossGathers(model, seed)
        self._near: tuple[GlossDiscs, Neighbours] | None = None
        self._spread: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # by gather: its light, and that over discs

    def static_light(self, b: Background, levels: np.ndarray) -> GlossGather | None:
        """Return the static part's light without mobiles, None before a result."""
        cells = self._source.cells(b.setting.radius)
        return None if cells is None else self._gathers.find(cells.discs, self._model.static, levels)

    def begin_with(self, light: GlossGather, b: Background, levels: np.ndarray) -> None:
        """Go on from static_light() of a scene of the same static part, if its glossy receivers are the same."""
        cells = self._source.cells(b.setting.radius)
        if cells is not None and np.array_equal(light.rows, cells.discs.rows[: cells.discs.first[1]]):
            self._gathers.begin_with(light.copied(self._model), cells.discs, levels)

    def is_enough(self, b: Background, levels: np.ndarray) -> bool:
        """Return whether the static part's light without mobiles is gathered, or has no directions to gather."""
        found = self.static_light(b, levels)
        return self._source.cells(b.setting.radius) is None or (found is not None and found.enough)

    def at_rest(self, b: Background, levels: np.ndarray) -> np.ndarray | None:
        """Return the static part's light without mobiles, as GlossCells.evaluate() takes it; None before a result."""
        cells, found = self._source.cells(b.setting.radius), self.static_light(b, levels)
        return None if cells is None or found is None else self._over_discs(cells, found)

    def settle(self, light: GlossLight, b: Background, at: Transforms, levels: np.ndarray) -> GlossLight:
        """Return the light of a frame with the directions gathered at its poses, if there are any."""
        cells = self._source.cells(b.setting.radius)
        found = None if cells is None or len(at.position) == 1 else self._gathers.find(cells.discs, at, levels)
        if found is None:
            return light
        return settled(light, np.searchsorted(light.owners, found.rows), as_light(self._over_discs(cells, found)))

    def _over_discs(self, cells: GlossCells, found: GlossGather) -> np.ndarray:
        """Return light, that of the static part averaged over gloss discs, as photons have it.

        A lamp narrower than a cell moves from cell to cell in steps, which show as spots.
        """
        kept = self._spread.get(id(found))
        if kept is None or kept[0] is not found.mean:
            model, static = self._model, self._model.surfaces.receiver_range(0)
            if self._near is None or self._near[0] is not cells.discs:
                points, normals = (a[static] for a in model.object_receivers[:2])
                given = neighbours(model.corners(0), static.stop), points, normals, cells.discs.radius, model.threads
                self._near = cells.discs, scattered_neighbours(*given)
            owner = np.full(static.stop + 1, -1)
            some = cells.rows < static.stop
            owner[cells.rows[some]] = cells.owners[cells.place[some]]
            kept = found.mean, _averaged(found.mean, found.rows, owner, self._near[1])
            self._spread = {} if len(self._spread) > KEPT else self._spread
            self._spread[id(found)] = kept
        return kept[1]

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
        yield from (Progress(STAGE, gather.rounds / gather.most, new) for new in gather.steps())


def _averaged(light: np.ndarray, rows: np.ndarray, owner: np.ndarray, near: Neighbours) -> np.ndarray:
    """Return the means of light (n, CELLS, SUMS) at rows (n,) over the owners of their neighbours that are rows too."""
    out, count = light.copy(), np.ones(len(rows))
    place = np.full(len(owner), -1)
    own = np.flatnonzero(rows < len(owner) - 1)
    place[rows[own]] = own
    first, last = near.first[rows[own]], near.first[rows[own] + 1]
    for k in range(int((last - first).max(initial=0))):
        has = first + k < last
        there = place[owner[near.of[(first + k)[has]]]]
        to = own[has][there >= 0]
        out[to] += light[there[there >= 0]]
        count[to] += 1
    return out / count[:, None, None]

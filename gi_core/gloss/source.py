"""Gloss of frames: cells alone, the list of rays of report 2.10, or the QuadTree that keeps all rays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.geometry.surfaces import glossy_receivers
from gi_core.gloss.cells import GlossCells, StaticCells
from gi_core.gloss.discs import GlossDiscs
from gi_core.gloss.light import CellWriter, GlossLight
from gi_core.gloss.rays import RayLists
from gi_core.gloss.sharp import is_sharp
from gi_core.model import Model
from gi_core.photons.paths import PathVertices
from gi_core.retrace.cuts import PoseChange

QUADTREE, LIST, ALL_RAYS = WAYS = ("quadtree", "list", "all_rays")
OPENED = {QUADTREE: 0.0, LIST: -1.0, ALL_RAYS: 1 / 16}  # share of light above which rays are read, gloss-cells.md
# Receivers that lie close together share the cells of one of them, their site: gloss discs are many receivers wide on a
# fine mesh, so neighbours have nearly the same rays. Irradiance, eye and normal stay those of each receiver.
SPACING = 0.7  # of the radius of a gloss disc
NORMAL_STEP = 0.05  # of a normal, per component: flat surfaces share cells, a ball of 2,562 vertices none
RADII = 2.0  # radius of gloss discs, times that of irradiance: directions need more rays


class GlossSource:
    """Directional light of a model's glossy receivers. Not thread safe."""

    def __init__(self, model: Model):
        self._model = model
        self._cells: GlossCells | None = None
        self._kept: tuple[float, bool] = (0.0, True)  # radius and way of the cells
        self._lists: RayLists | None = None
        self._earlier: tuple[StaticCells, object] | None = None  # sums that the next cells begin with, their photons

    @property
    def static_cells(self) -> StaticCells | None:
        """A copy of the sums of the static part's receivers; None without any."""
        return None if self._cells is None or not self._cells.photons else self._cells.static_cells()

    def begin_with(self, sums: StaticCells | None, store: object) -> None:
        """Let the first cells begin with sums of a scene of the same static part; store: their photons here."""
        self._earlier = None if sums is None else (sums, store)

    def cells(self, radius: float, way: str = QUADTREE) -> GlossCells | None:
        """Return the cells of glossy receivers; radius [m]: of irradiance. None without glossy faces.

        way: one of WAYS. With cells alone, receivers drawn from probes have none. The others share those of a site.
        """
        if self._cells is None or self._kept != (radius, way == QUADTREE):
            s = self._model.surfaces
            glossy = owners = rows = glossy_receivers(s)
            place = np.arange(len(glossy), dtype=np.int32)
            if way == QUADTREE:  # a list is that of its receiver
                own = glossy_receivers(s, besides=is_sharp(s))
                rows, site = sites(self._model, own, radius * RADII)
                even = np.setdiff1d(glossy, own)
                owners = np.union1d(rows, even)
                place[np.searchsorted(glossy, even)] = np.searchsorted(owners, even)
                place[np.searchsorted(glossy, own)] = np.searchsorted(owners, rows)[site]
            self._cells = GlossCells(GlossDiscs(self._model, radius * RADII, rows), glossy, owners, place)
            self._kept, self._lists = (radius, way == QUADTREE), None
            if self._earlier is not None:
                self._cells.begin_with(*self._earlier)
                self._earlier = None
        return self._cells if len(self._cells.rows) else None

    def lists(self, radius: float) -> RayLists | None:
        """Return the lists of rays; arguments as for cells()."""
        cells = self.cells(radius, LIST)
        if cells is not None and self._lists is None:
            self._lists = RayLists(cells.discs)
        return self._lists

    def reach(self, radius: float, way: str) -> float:
        """Return the distance [m] within which rays near mobiles matter, 0: none do; arguments as for cells()."""
        cells = self.cells(radius, way)
        return cells.discs.radius if cells is not None and cells.discs.on_mobiles else 0.0

    def light(
        self, way: str, radius: float, photons: tuple[object, PathVertices, np.ndarray], change: PoseChange,
        clock: Callable[[str], None], gathered: np.ndarray | None = None, on_mobiles: CellWriter | None = None,
    ) -> GlossLight | None:  # fmt: skip
        """Return the directional light of a frame; None without glossy faces or photons.

        way: one of WAYS; radius [m]: of irradiance; photons: as for GlossCells.bring_in(); clock: called after each
        step; gathered, on_mobiles: as for GlossCells.evaluate().
        """
        cells = self.cells(radius, way)
        if cells is None or len(photons[1].offsets) < 2:
            return None
        cells.bring_in(*photons)
        light = cells.evaluate(change, gathered, on_mobiles)
        if way != QUADTREE and (lists := self.lists(radius)) is not None:
            lists.bring_in(*photons)
            light = light._replace(tree=lists.evaluate(change), opened=OPENED[way])
        clock("gloss")
        return light


def sites(model: Model, rows: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the receivers (m,) int64, ascending, that stand for receivers rows (n,), and the site (n,) int32 of each.

    radius [m]: of the gloss discs. Members of a site lie on the same side of one surface.
    """
    r = model.object_receivers
    box = np.floor(r.positions[rows] / (SPACING * radius)).astype(np.int64)
    turn = np.round(r.normals[rows] / NORMAL_STEP).astype(np.int64)
    group = group_of([model.receiver_sides[rows].astype(np.int64), *box.T, *turn.T])
    m = int(group.max(initial=-1)) + 1
    count = np.maximum(np.bincount(group, minlength=m), 1)
    middle = np.stack([np.bincount(group, r.positions[rows, c], m) for c in range(3)], axis=1) / count[:, None]
    off = ((r.positions[rows] - middle[group]) ** 2).sum(axis=1)
    order = np.lexsort((rows, off, group))
    owner = rows[order[np.flatnonzero(np.diff(group[order], prepend=-1))]]
    rank = np.argsort(np.argsort(owner))
    return np.sort(owner), rank[group].astype(np.int32)

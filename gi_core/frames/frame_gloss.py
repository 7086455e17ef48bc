"""Directions of the light at glossy receivers in frames: from photons, from gathered light, from paths to mobiles.

Photons are kept as cells alone, as the list of rays of report 2.10, or as the QuadTree that keeps all rays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.base.pause import pause
from gi_core.base.results import KEPT
from gi_core.frames.background import Background
from gi_core.frames.light_setting import LIST, OPENED, QUADTREE, LightSetting
from gi_core.gather.denoise import averaged
from gi_core.gather.gloss_gather import GlossGather, GlossGathers
from gi_core.geometry.mesh_neighbours import Neighbours, scattered_neighbours
from gi_core.geometry.surfaces import glossy_receivers
from gi_core.gloss.cells import GlossCells, StaticCells, as_light
from gi_core.gloss.discs import GlossDiscs
from gi_core.gloss.light import CellWriter, GlossLight, settled
from gi_core.gloss.rays import RayLists
from gi_core.gloss.sharp import is_sharp
from gi_core.model import Model
from gi_core.photons.paths import PathVertices
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange

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
        """Whether gather() has directions without mobiles to gather."""
        return setting.takes_gathered_gloss and not self._gathered.is_enough(shown, setting.levels)

    def gather(
        self, b: Background, at: Transforms, irradiance: np.ndarray, changed: np.ndarray, setting: LightSetting,
        refresh: Callable[[], None],
    ) -> None:  # fmt: skip
        """Gather directions at poses where frames take them; arguments as for GatheredGloss."""
        if setting.takes_gathered_gloss:
            self._gathered.gather(b, at, setting.levels, irradiance, changed, refresh)


def _by_paths(paths: int, way: str) -> bool:
    """Return whether paths give the directions of light on mobiles: single rays come from photons."""
    return paths > 0 and way == QUADTREE


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
        gathered = self.static_light(b, levels)
        return self._source.cells(b.setting.radius) is None or (gathered is not None and gathered.enough)

    def at_rest(self, b: Background, levels: np.ndarray) -> np.ndarray | None:
        """Return the static part's light without mobiles, as GlossCells.evaluate() takes it; None before a result."""
        cells, gathered = self._source.cells(b.setting.radius), self.static_light(b, levels)
        return None if cells is None or gathered is None else self._over_discs(cells, gathered)

    def settle(self, light: GlossLight, b: Background, at: Transforms, levels: np.ndarray) -> GlossLight:
        """Return the light of a frame with the directions gathered at its poses, if there are any."""
        cells = self._source.cells(b.setting.radius)
        gathered = None if cells is None or len(at.position) == 1 else self._gathers.find(cells.discs, at, levels)
        if gathered is None:
            return light
        return settled(light, np.searchsorted(light.owners, gathered.rows), as_light(self._over_discs(cells, gathered)))

    def _over_discs(self, cells: GlossCells, gathered: GlossGather) -> np.ndarray:
        """Return light, that of the static part averaged over gloss discs, as photons have it.

        A lamp narrower than a cell moves from cell to cell in steps, which show as spots.
        """
        kept = self._spread.get(id(gathered))
        if kept is None or kept[0] is not gathered.mean:
            model, static = self._model, self._model.surfaces.receiver_range(0)
            if self._near is None or self._near[0] is not cells.discs:
                points, normals = (a[static] for a in model.object_receivers[:2])
                radius = cells.discs.radius
                self._near = cells.discs, scattered_neighbours(model.adjacency, points, normals, radius, model.threads)
            owner = np.full(static.stop + 1, -1)
            on_static = cells.rows < static.stop
            owner[cells.rows[on_static]] = cells.owners[cells.place[on_static]]
            near, every = _among(gathered.rows, owner, self._near[1]), np.ones(len(gathered.rows), bool)
            kept = gathered.mean, averaged(near, gathered.mean, every, model.threads)
            self._spread = {} if len(self._spread) > KEPT else self._spread
            self._spread[id(gathered)] = kept
        return kept[1]

    def gather(
        self, b: Background, at: Transforms, levels: np.ndarray, irradiance: np.ndarray, changed: np.ndarray,
        refresh: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        """Gather at poses, see `GlossGather`; refresh: called where frames change.

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
        while not gather.enough:
            gather.add_round()
            refresh()
            pause(gather.progress(picture=True))


def _among(rows: np.ndarray, owner: np.ndarray, near: Neighbours) -> Neighbours:
    """Return the neighbours of rows (n,) among each other, by place: owners of their neighbours; owner -1: none."""
    place = np.full(len(owner), -1)
    own = np.flatnonzero(rows < len(owner) - 1)
    place[rows[own]] = own
    first, count = near.first[rows[own]], np.diff(near.first)[rows[own]]
    at = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
    of, to = np.repeat(own, count), place[owner[near.of[at]]]
    ends = np.cumsum(np.bincount(of[to >= 0], minlength=len(rows)))
    return Neighbours(np.concatenate([[0], ends]), to[to >= 0].astype(np.int32))

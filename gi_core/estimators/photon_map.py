"""Photon Maps (Jensen 2001; report 1.2, 2.9): the k nearest hits, no farther than the radius.

With k hits inside, E = flux of the k - 1 nearest / (pi r_k^2). The k-th hit defines the radius only, which makes the
estimate unbiased (Garcia, Urena, Sbert 2012). The setting `textbook` counts it too, which overestimates by k / (k - 1).
With fewer than k hits, E = flux of all / (pi radius^2). Photons of a Sobol sequence are more even than random ones,
so the estimate is up to 1 / 2k too low. Distances are those in the world.

Eq. 2.8 is false here, because r_k depends on all hits. A frame estimates each stale receiver again: each one with a
changed hit within its radius.

At a border the surface covers only alpha / 2 pi of a disc. With `border_correction` a receiver there uses hits on its
own side of its own patch, and divides by that part of the disc (2.9.1). Without it, hits on all surfaces in Jensen's
sphere count, so a second wall partly compensates. All other receivers use Jensen's sphere: near an edge, half of their
hits lie on the other wall.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gi_core.base import vectors
from gi_core.base.jit import kernel
from gi_core.base.pause import pieces
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.base.vec import cell_of, difference, dot
from gi_core.discs.stale_receivers import ControlFacts
from gi_core.estimators.base import Estimator, Setting
from gi_core.estimators.counting import Counts, Find, Place, circle, ends
from gi_core.geometry.receivers import NONE
from gi_core.model import Model
from gi_core.photons.flux_sums import CHUNK_BITS, NOT_ADDITIVE, CutFlux, Evaluated, SubsetStore, chunks_of
from gi_core.photons.hit_grid import OTHER_SIDE, HitGrid, Hits, Nearest, build, gather, hits_of, room_for_hits
from gi_core.photons.paths import ADDED, KEPT, Segments, rows_of
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange
from gi_core.scene.pose import to_world_at

CELL_SHARE = 0.25  # of the radius: finer cells cost more visits than they save tests
NEVER = np.int32(1 << 30)  # bounce of the cut of a photon that is not cut


class _Prepared(NamedTuple):
    """The estimate of the background from the hits of some photons."""

    sums: np.ndarray  # (n, 3 G) int64 of static receivers
    area: np.ndarray  # (n,) float64 [m2]
    reach2: np.ndarray  # (n,) float32 [m2], squared distance within which a changed hit makes a receiver stale
    grid: HitGrid
    cut_bounce: np.ndarray  # (photons,) int32, NEVER except while a frame is computed


class PhotonMap(Estimator):
    """The estimator of the module; `radius` [m] bounds the search, `k` is the number of hits."""

    about = "Photon Maps (Jensen 2001): the k nearest hits, no farther than the radius."
    additive, smoothing = False, "neighbours"
    bytes_per_hit = 96  # each hit is stored twice: as added, and sorted

    def __init__(self, model: Model, setting: Setting):
        super().__init__(model, setting)
        self._channels = model.emitters.lamps.channels
        self.radius, self.k, self.textbook = setting.radius, setting.neighbours, setting.textbook
        # The share of a disc that the surface covers; where it is below 1, the side on which hits count.
        whole = np.ones(len(model.object_receivers.areas))
        self._share = model.covered_share if setting.border_correction else whole
        self._side = np.where(self._share < 1, model.receiver_sides, NONE).astype(np.int32)
        self.control_facts = ControlFacts(float((self._share < 1).mean()) if len(self._share) else 0.0, 0, 0)
        self._parts: list[Hits] = []
        self._static = model.surfaces.receiver_range(0)
        points, normals = self._receivers(model.static, self._static)
        # Receivers as hits; `photon` is the receiver's index.
        as_hits = room_for_hits(len(points))._replace(position=points, normal=normals, photon=np.arange(len(points)))
        self._receiver_grid = build([as_hits], self.radius)

    def copied(self, model: Model, setting: Setting) -> PhotonMap:
        other = PhotonMap(model, setting)
        other._parts, other.photons = list(self._parts), self.photons
        kept = {n: p._replace(cut_bounce=np.full_like(p.cut_bounce, NEVER)) for n, p in self.subsets.items()}
        other.subsets = SubsetStore(kept)
        return other

    @staticmethod
    def summary(setting: Setting) -> str:
        return f"k {setting.neighbours}" + (", as in textbooks" if setting.textbook else "")

    def add_background(self, segments: Segments, thread: int) -> None:
        self._parts.append(self._hits(segments, self.model.static))

    def prepare(self, photons: int) -> None:
        grid = build(self._parts, CELL_SHARE * self.radius)
        uncut = np.full(max(photons, 1), NEVER, np.int32)
        points, normals = self._receivers(self.model.static, self._static)
        nothing = build([], self.radius)
        estimates = []
        for rows in pieces(len(points)):
            estimates.append(self._query(rows, points[rows], normals[rows], (grid, nothing), uncut))
        sums, area, reach2 = (np.concatenate(a) for a in zip(*estimates, strict=True))
        self.subsets[photons] = _Prepared(sums, area, reach2, grid, uncut)
        self.photons = photons

    def background(self, photons: int, direct: bool = True) -> tuple[np.ndarray, np.ndarray]:
        assert direct, "sums of the k nearest hits are not additive"
        return self.subsets[photons].sums, self.subsets[photons].area

    def evaluate(self, frame: PoseChange) -> Evaluated:
        assert frame.direct, "sums of the k nearest hits are not additive"
        background = self.subsets[frame.photons]
        changed = [self._hits(s, frame.at) for s in (frame.kept_prefixes, frame.new_suffixes)]
        added = build(changed, CELL_SHARE * self.radius)
        removed = self._hits(frame.removed_suffixes.segments(self.model.threads), frame.at)

        # Static receivers with a changed hit within their radius are stale.
        stale = np.zeros(self._static.stop, bool)
        for hits in (removed, added.hits):
            _mark(hits.position, self._receiver_grid, background.reach2, self.radius, stale)
        rows = np.flatnonzero(stale)
        sums = np.zeros((len(self.model.object_receivers.areas), self._channels), np.int64)
        area = np.zeros(len(sums))
        sums[self._static], area[self._static] = background.sums, background.area
        if frame.near_mobiles:
            rows = np.concatenate([rows, np.arange(self._static.stop, len(sums))])
        # The background hits of a cut photon are removed from the end of the cut segment on.
        points, normals = self._receivers(frame.at, rows)
        try:
            background.cut_bounce[frame.removed_suffixes.photon] = frame.removed_suffixes.bounce
            grids = background.grid, added
            for part in pieces(len(rows)):
                estimate = self._query(rows[part], points[part], normals[part], grids, background.cut_bounce)
                sums[rows[part]], area[rows[part]], _ = estimate
        finally:
            background.cut_bounce[frame.removed_suffixes.photon] = NEVER
        changed = np.zeros(chunks_of(len(sums)), bool)
        changed[rows >> CHUNK_BITS] = True
        changed[self._static.stop >> CHUNK_BITS :] = len(sums) > self._static.stop
        return Evaluated(sums, area, changed, *self._not_additive())

    def counted(self, place: Place, find: Find) -> Counts:
        """Return the nearest hits within the radius. The k-th gives the radius of the estimate alone.

        Where fewer photons are searched than the picture has, the radius of the picture's estimate holds.
        """
        s, world, share = self.model.surfaces, self.model.world, self._share[place.row]
        point = place.position.astype(np.float32)

        def near(origin: np.ndarray, end: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            off = end - point
            rows = np.flatnonzero((side != NONE) & (vectors.dot(off, off) <= np.float32(self.radius) ** 2))
            face, back = side[rows] >> 1, side[rows] & 1
            turned = np.einsum("nij,nj->ni", place.at.rotation[world.face_object[face]], world.normals[face])
            facing = np.where(back == 1, -1.0, 1.0) * (turned @ place.normal) > OTHER_SIDE
            if share < 1:
                facing &= 2 * s.patch[face] + back == self._side[place.row]
            return ends(np.isin(np.arange(len(side)), rows[facing]), origin, end)

        parts = find(near, of_hits=True)
        far = [np.sqrt(((hits.hit - point) ** 2).sum(axis=1)) for hits in parts]
        now = np.sort(np.concatenate([far[KEPT], far[ADDED]]))
        if place.searched < place.photons and place.area > 0:
            radius = math.sqrt(place.area / (math.pi * share))
            about = f"hits within {radius:.3g} m, the radius of the picture's {place.photons:,} photons"
            inside = [d <= radius for d in far]
        else:
            full = len(now) >= self.k
            radius = float(now[self.k - 1]) if full else self.radius
            inside = [d < radius if full and not self.textbook else d <= radius for d in far]
            count = int(inside[KEPT].sum() + inside[ADDED].sum())
            about = f"hits, the {count:,} nearest, within {radius:.3g} m"
        kept, removed, added = (rows_of(hits, rows) for hits, rows in zip(parts, inside, strict=True))
        return Counts((kept, removed, added), circle(place, radius), about)

    def from_scratch(self, parts: Iterable[Segments], at: Transforms, direct: bool = True) -> Evaluated:
        assert direct, "sums of the k nearest hits are not additive"
        grid, nothing = build([self._hits(p, at) for p in parts], CELL_SHARE * self.radius), build([], self.radius)
        uncut = np.full(int(grid.hits.photon.max(initial=0)) + 1, NEVER, np.int32)
        points, normals = self._receivers(at, slice(None))
        sums, area, _ = self._query(slice(None), points, normals, (grid, nothing), uncut)
        return Evaluated.of_all(sums, area, *self._not_additive())

    def _not_additive(self) -> tuple[np.ndarray, CutFlux]:
        """Return marks of all receivers: sums of the k nearest hits are not additive. Flux at cuts is not read."""
        return np.full((len(self._share), 1), NOT_ADDITIVE), CutFlux.none(self._channels // 3)

    def _hits(self, segments: Segments, at: Transforms) -> Hits:
        return hits_of(segments, self.model.world, self.model.surfaces.patch, at)

    def _receivers(self, at: Transforms, rows) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and normals (n, 3) float32 of some receivers in the world."""
        r, s = self.model.object_receivers, self.model.surfaces
        index = np.arange(len(r.areas))[rows]
        o = s.object_of(index)
        o = np.minimum(o, len(at.position) - 1)
        points = to_world_at(at.rotation[o], at.position[o], r.positions[index])
        normals = to_world_at(at.rotation[o], np.zeros((len(o), 3)), r.normals[index])
        return points.astype(np.float32), normals.astype(np.float32)

    def _query(self, rows, points, normals, grids, cut_bounce):
        """Return sums (n, 3 G) int64, area (n,), and the squared reach (n,) float32 of each estimate."""
        n = len(points)
        sums, area, reach2 = np.zeros((n, self._channels), np.int64), np.empty(n), np.empty(n, np.float32)
        receivers = points, normals, self._side[rows], self._share[rows]
        radius, counted = np.float32(self.radius), self.k if self.textbook else self.k - 1

        def work(_, first, last):
            to = sums, area, reach2
            _estimate(receivers, radius, counted, grids, cut_bounce, first, last, Nearest.of(self.k), to)

        run_ranges(work, n, self.model.threads, COSTLY)
        return sums, area, reach2


@kernel
def _estimate(receivers, radius, counted, grids, cut_bounce, first, last, heap, out):
    """Write sums, area and squared reach of receivers first .. last - 1 to `out`; a heap of k serves each in turn."""
    (points, normals, side, share), (background, added), (sums, area, reach2) = receivers, grids, out
    k, flux, more, lamps, more_lamps = len(heap.d2), background[0][2], added[0][2], background[0][6], added[0][6]
    for r in range(first, last):
        n = gather(points[r], normals[r], side[r], radius, background, 0, cut_bounce, heap, 0)
        n = gather(points[r], normals[r], side[r], radius, added, 1, cut_bounce, heap, n)
        full = n == k and heap.d2[0] > 0.0
        reach2[r] = heap.d2[0] if full else radius * radius
        area[r] = math.pi * reach2[r] * share[r]
        # The root of the heap is the k-th hit.
        for h in range(1 if full and counted < k else 0, n):
            index = heap.hit[h] >> 1
            first_channel = 3 * (more_lamps[index] if heap.hit[h] & 1 else lamps[index])
            for c in range(3):
                sums[r, first_channel + c] += more[index, c] if heap.hit[h] & 1 else flux[index, c]


@kernel
def _mark(position, receivers, reach2, radius, stale):
    """Mark receivers with one of the positions within their radius as stale."""
    (points, _, _, index, _, _, _), low, cell, shape, first = receivers
    for k in range(len(position)):
        x, y, z = position[k, 0], position[k, 1], position[k, 2]
        x0, x1 = cell_of(x - radius, low[0], cell), cell_of(x + radius, low[0], cell)
        y0, y1 = cell_of(y - radius, low[1], cell), cell_of(y + radius, low[1], cell)
        z0, z1 = cell_of(z - radius, low[2], cell), cell_of(z + radius, low[2], cell)
        for i in range(max(x0, 0), min(x1, shape[0] - 1) + 1):
            for j in range(max(y0, 0), min(y1, shape[1] - 1) + 1):
                for m in range(max(z0, 0), min(z1, shape[2] - 1) + 1):
                    c = (i * shape[1] + j) * shape[2] + m
                    for h in range(first[c], first[c + 1]):
                        if not stale[index[h]]:
                            off = difference(points[h], position[k])
                            if dot(off, off) <= reach2[index[h]] * np.float32(1.0001):
                                stale[index[h]] = True

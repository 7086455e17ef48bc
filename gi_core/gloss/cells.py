"""Directions of light at the receivers of glossy faces: integer moments in a fixed hierarchy of cells.

Report 2.10 stores the rays that reach a glossy vertex, and 2.10.1 summarises them in a QuadTree, whose list "gets
degraded after repeated insertion and deletion". Here a cell holds integer sums of its rays: flux per channel, and flux
times direction. Inserting and removing a ray cancel exactly, so no history degrades them.

Cells describe how light is distributed over directions; its irradiance comes from the frame, so gloss shares the
estimator, gathered light and artifact control of the diffuse part. Rays are the segments that cross the receiver's
disc, with any estimator. A frame takes its rays in the order of receivers, and computes only the cells that they reach.
On mobiles whose light is gathered, paths give the directions (`gi_core.gather.mobile_gloss`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.pause import pause
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.base.vec import weighted
from gi_core.gloss.discs import DIRECTION_BITS, FLUX_SHIFT, Arrivals, GlossDiscs, Intake, add_rays, arrivals, deposit
from gi_core.gloss.hemisphere import CELLS, SUMS, axes_of, even_light
from gi_core.gloss.light import FIELDS, CellWriter, GlossLight
from gi_core.photons.paths import PathVertices, Segments, segments_of
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange


class StaticCells(NamedTuple):
    """Sums of the static part's glossy receivers, apart from their cells."""

    radius: float  # of the gloss discs [m]
    rows: np.ndarray  # (n,) int64, receivers
    photons: int
    weights: np.ndarray  # (G, 3), of the lamps' flux
    sums: np.ndarray  # (n, CELLS, SUMS) int64


class GlossCells:
    """Sums of a scene's glossy receivers. Not thread safe."""

    def __init__(self, discs: GlossDiscs, glossy: np.ndarray, owners: np.ndarray, place: np.ndarray):
        """discs: of the owners that have cells, others have even light; glossy (n,): all glossy receivers, ascending.

        owners (m,), ascending, and place (n,): see GlossLight.
        """
        self.discs, self.rows, self.owners, self.place, count = discs, glossy, owners, place, discs.count(0)
        self._place = np.searchsorted(owners, discs.rows)
        self._intake = Intake(discs.model.emitters.lamps.count)
        none = np.empty((0, CELLS, SUMS))
        photons, totals = np.zeros((count, CELLS, SUMS), np.int64), np.zeros((count, 3))
        unlit = np.empty((0, CELLS, FIELDS), np.float32)  # until there are photons
        self._static = StaticSums(photons, none, totals, self._place[:count], unlit)
        self._better: tuple[np.ndarray, int, StaticSums] | None = None  # gathered light, photons, and their sums
        self._lit_by = 0  # photons in `_static.light`

    @property
    def photons(self) -> int:
        """Photons in the sums."""
        return self._intake.photons

    def _unlit(self) -> np.ndarray:
        """Return the light (m, CELLS, 6) of all owners before any ray: none where there are cells."""
        out = np.empty((len(self.owners), CELLS, FIELDS), np.float32)
        even, normals = even_light(), self.discs.model.object_receivers.normals[self.owners]

        def work(_, begin, end):
            turn(even, normals[begin:end], out[begin:end])

        run_ranges(work, len(out), self.discs.model.threads, COSTLY)
        out[self._place, :, :3] = 0.0
        return out

    def static_cells(self) -> StaticCells:
        """Return a copy of the sums of the static part's receivers."""
        rows, intake = self.discs.rows[: self.discs.first[1]], self._intake
        return StaticCells(self.discs.radius, rows, intake.photons, intake.weights, self._static.photons.copy())

    def begin_with(self, earlier: StaticCells, store: object) -> None:
        """Take over sums, if they are those of the same receivers and discs; store: of the photons, see bring_in()."""
        own = self.discs.rows[: self.discs.first[1]]
        if earlier.radius == self.discs.radius and np.array_equal(earlier.rows, own):
            self._static.photons[:] = earlier.sums
            self._intake.begin_with(store, earlier.weights, earlier.photons)

    def bring_in(self, store: object, paths: PathVertices, weights: np.ndarray) -> None:
        """Add the photons of `paths` that are not yet in the sums; weights (G, 3): of the lamps' flux.

        store: identifies the photons. The sums begin anew when it or the weights differ from the last call.
        """
        if self._intake.begins_anew(store, weights):
            self._lit_by = 0
            self._static.photons[:] = 0
        # A fourth of the photons leaves twice the error, docs/decisions/gloss-cells.md.
        count, model = min(len(paths.offsets) - 1, 1 << 20), self.discs.model
        while self.photons < count:
            last = self._intake.end_of_part(count)
            self._deposit([(1, segments_of(paths, self.photons, last))], model.static, self._static.photons)
            self._intake.photons = last
            pause()
        if self._lit_by != self.photons:
            self._static = self._static._replace(light=self._unlit())
            normalise(self._static.photons, self._place, self._static.light, self._static.totals)
            self._lit_by = self.photons

    def _without_mobiles(self, gathered: np.ndarray | None) -> StaticSums:
        """Return the light without mobiles: of photons, or gathered (static rows, CELLS, SUMS), see `GlossGather`."""
        if gathered is None:
            return self._static
        if self._better is None or self._better[0] is not gathered or self._better[1] != self.photons:
            unit = self.discs.model.emitters.unit_flux / max(self.photons, 1) / (math.pi * self.discs.radius**2)
            weight = 1.0 / (unit * (1 << FLUX_SHIFT))
            sums = gathered * np.array([1 / unit] * 3 + [weight * (1 << DIRECTION_BITS)] * 3 + [weight])
            totals, light = np.empty_like(self._static.totals), self._unlit()
            normalise(sums, self._place, light, totals)
            self._better = gathered, self.photons, self._static._replace(gathered=sums, totals=totals, light=light)
        return self._better[2]

    def evaluate(
        self, change: PoseChange, gathered: np.ndarray | None = None, on_mobiles: CellWriter | None = None
    ) -> GlossLight:
        """Return the light of a frame's poses. Its photons may be fewer or more than those in the sums.

        gathered (static rows, CELLS, SUMS): light without mobiles by paths, in place of photons; see `GlossGather`.
        Mobiles then take the share of a cell's light that they take of its photons: a difference would leave the
        noise of photons in shadows. on_mobiles: writes the cells of receivers on mobiles, in place of photons.
        """
        static, first = self._without_mobiles(gathered), self.discs.first
        parts = [self._changes(change)]
        if on_mobiles is None:
            parts += [[(1, segments)] for segments in change.near_mobiles]
        reached = [arrivals(self.discs, o, rays, change.at, self._intake.weights) for o, rays in enumerate(parts)]
        places = [self._place[first[o] : first[o + 1]][a.rows] for o, a in enumerate(reached)]
        by_paths = self._place[first[1] : first[1 if on_mobiles is None else len(change.at.position)]]
        rows = np.concatenate([*places, by_paths])
        cells = np.empty((len(rows), CELLS, FIELDS), np.float32)
        parts_of_cells = np.split(cells, np.cumsum([len(place) for place in places]))
        scale = self.photons / max(change.photons, 1)
        for o, (a, out) in enumerate(zip(reached, parts_of_cells[:-1], strict=True)):
            own = static._replace(place=self._place[first[o] : first[o + 1]])
            if o > 0:
                own = own._replace(photons=static.photons[:0], gathered=static.gathered[:0])
            self._write_frame(o, a, own, scale if o == 0 else 1.0, out)
        if on_mobiles is not None:
            on_mobiles(self.owners[by_paths], by_paths, static.light, parts_of_cells[-1])
        return GlossLight(self.rows, self.owners, self.place, static.light, rows, cells)

    def _write_frame(self, o: int, reached: Arrivals, static: StaticSums, scale: float, out: np.ndarray) -> None:
        """Write the cells of object o's receivers that rays reach; their rays count `scale` times."""

        def work(_, begin, end):
            frame_cells(reached, begin, end, self.discs.normals_of(o), static, scale, Scratch.new(), out)

        run_ranges(work, len(reached.rows), self.discs.model.threads, COSTLY)

    def _changes(self, change: PoseChange) -> list[tuple[int, Segments]]:
        return [(-1, change.removed_suffixes.segments(self.discs.model.threads)), (1, change.new_suffixes)]

    def _deposit(self, parts: list[tuple[int, Segments]], at: Transforms, sums: np.ndarray) -> None:
        """Add the rays of segments, times their sign, to the cells of the static part's receivers."""
        reached = arrivals(self.discs, 0, parts, at, self._intake.weights)

        def work(_, begin, end):
            deposit(reached, begin, end, self.discs.normals_of(0), sums)

        run_ranges(work, len(reached.rows), self.discs.model.threads, COSTLY)


# Sums of cells become shares of irradiance and mean directions ------------------------------------------------


class StaticSums(NamedTuple):
    """Sums of the receivers of one object without mobiles, and the light that is made of them. Mobiles have no sums."""

    photons: np.ndarray  # (n, CELLS, SUMS) int64
    gathered: np.ndarray  # (n, CELLS, SUMS) float64, in place of photons, in their units; (0, ...): none
    totals: np.ndarray  # (n, 3) float64, of the cells
    place: np.ndarray  # (n,) int64 into `light`
    light: np.ndarray  # (m, CELLS, FIELDS) float32, see GlossLight.resting


class Scratch(NamedTuple):
    """Scratch memory of frame_cells()."""

    added: np.ndarray  # (CELLS, SUMS) int64, zeros before and after
    gone: np.ndarray  # (CELLS, SUMS) int64, zeros before and after
    now: np.ndarray  # (CELLS, SUMS) float64
    reached: np.ndarray  # (CELLS,) int64

    @classmethod
    def new(cls) -> Scratch:
        return cls(*np.zeros((2, CELLS, SUMS), np.int64), np.empty((CELLS, SUMS)), np.empty(CELLS, np.int64))


def as_light(sums: np.ndarray) -> np.ndarray:
    """Return cells (n, CELLS, 6) float32, as of a GlossLight, of gathered sums (n, CELLS, SUMS), see `GlossGather`."""
    scaled = sums * np.array([1.0] * 3 + [1 << DIRECTION_BITS] * 3 + [1.0])
    out = np.zeros((len(sums), CELLS, FIELDS), np.float32)
    normalise(scaled, np.arange(len(sums)), out, np.empty((len(sums), 3)))
    return out


@kernel
def turn(even, normals, out):
    """Write even light (CELLS, 6) around normals (n, 3) to out (n, CELLS, 6)."""
    for i in range(len(normals)):
        a, b, n = axes_of(normals[i])
        for c in range(CELLS):
            e = even[c]
            out[i, c, 0], out[i, c, 1], out[i, c, 2] = e[0], e[1], e[2]
            out[i, c, 3], out[i, c, 4], out[i, c, 5] = weighted((e[3], e[4], e[5]), a, b, n)


@kernel
def _write_mean(x, y, z, weight, out):
    """Write the mean direction of a cell's sums, if there is any light."""
    size = math.sqrt(x * x + y * y + z * z)
    if size > 0.0:
        size = max(size, weight * (1 << DIRECTION_BITS))
        out[3], out[4], out[5] = x / size, y / size, z / size


@kernel
def normalise(sums, place, out, totals):
    """Write shares and mean directions of sums (n, CELLS, SUMS) to rows place (n,) of out, and totals (n, 3)."""
    for i in range(len(sums)):
        of, to = sums[i], out[place[i]]
        for k in range(3):
            total = 0.0
            for c in range(CELLS):
                total += of[c, k]
            for c in range(CELLS):
                to[c, k] = of[c, k] / total if total > 0.0 else 0.0
            totals[i, k] = total
        for c in range(CELLS):
            _write_mean(float(of[c, 3]), float(of[c, 4]), float(of[c, 5]), float(of[c, 6]), to[c])


@kernel
def _left(scale, gone, photons):
    """Return the share of a cell's light that mobiles leave: that of its photons."""
    return max(0.0, 1.0 + scale * gone / photons) if photons > 0 else 1.0


@kernel
def _move(static, i, c, scale, room):
    """Write the sums of cell c of receiver i at a frame's poses; return how much red, green and blue they change.

    The cell's added and removed sums become zeros.
    """
    added, gone, now = room.added[c], room.gone[c], room.now[c]
    red = green = blue = 0.0
    if i >= len(static.photons):
        for k in range(SUMS):
            now[k] = scale * (added[k] + gone[k])
    elif not len(static.gathered):
        before = static.photons[i, c]
        red, green, blue = float(before[0]), float(before[1]), float(before[2])
        for k in range(SUMS):
            now[k] = scale * (added[k] + gone[k]) + float(before[k])
    else:
        better, photons = static.gathered[i, c], static.photons[i, c]
        red, green, blue = better[0], better[1], better[2]
        for k in range(3):
            now[k] = _left(scale, gone[k], photons[k]) * better[k] + scale * added[k]
        left = _left(scale, gone[6], photons[6])  # directions lose the share that their weight does
        for k in range(3, SUMS):
            now[k] = left * better[k] + scale * added[k]
    for k in range(SUMS):
        added[k] = gone[k] = 0
    for k in range(3):
        now[k] = max(0.0, now[k])
    return now[0] - red, now[1] - green, now[2] - blue


@kernel
def frame_cells(arrivals, first, last, normals, static, scale, room, out):
    """Write shares and mean directions of receivers, rows first .. last - 1, to rows of out (k, CELLS, 6).

    static: a StaticSums, without these rays, which count `scale` times; room: a Scratch.
    """
    for j in range(first, last):
        i = arrivals.rows[j]
        resting, to, n = static.light[static.place[i]], out[j], 0
        bits = add_rays(arrivals, j, normals[i], room.added, room.gone)
        for c in range(CELLS):
            if (bits >> np.uint64(c)) & np.uint64(1):
                room.reached[n] = c
                n += 1
        red = green = blue = 0.0
        if i < len(static.photons):
            red, green, blue = static.totals[i, 0], static.totals[i, 1], static.totals[i, 2]
        r, g, b = red, green, blue
        for m in range(n):
            more = _move(static, i, room.reached[m], scale, room)
            r, g, b = r + more[0], g + more[1], b + more[2]
        # Shares of the cells that no ray reaches change with the totals alone.
        red, green, blue = red / r if r > 0.0 else 0.0, green / g if g > 0.0 else 0.0, blue / b if b > 0.0 else 0.0
        for c in range(CELLS):
            to[c, 0], to[c, 1], to[c, 2] = red * resting[c, 0], green * resting[c, 1], blue * resting[c, 2]
            to[c, 3], to[c, 4], to[c, 5] = resting[c, 3], resting[c, 4], resting[c, 5]
        for m in range(n):
            c = room.reached[m]
            now = room.now[c]
            to[c, 0] = now[0] / r if r > 0.0 else 0.0
            to[c, 1] = now[1] / g if g > 0.0 else 0.0
            to[c, 2] = now[2] / b if b > 0.0 else 0.0
            _write_mean(now[3], now[4], now[5], now[6], to[c])

"""Path changes of a pose: cut photons, their kept prefixes, removed suffixes and new suffixes (fig. 2.2).

A cut is the first hit of a background path on a mobile. The path is kept up to the cut. The removed suffix is
subtracted, and the new suffix, reflected off the mobile, is added. Each frame is computed from the background alone, so
nothing drifts.

A suffix is stored as photon, vertex and distance. Its segments are copied from the background on demand only: an
estimator that caches disc intersections needs none.

A broad phase finds the background segments near a mobile by a conservative test of all of them, at 6 bytes per vertex.
Path vertices are rounded to 65,536 levels per axis over the reach of light. Vector instructions test segments against
the mobiles' bounding spheres, grown by the rounding. At a million photons memory bounds the time: half the bytes take
half the time. A hierarchy over bundled segments was tried: sorting takes a second per million photons, and a third of
the blocks of cornell lie near the pawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.fixed_point import MAX_PATH
from gi_core.base.jit import inlined, kernel, lowest_bit
from gi_core.base.threads import CHEAP, COSTLY, run_ranges
from gi_core.base.vec import difference, rotate_back
from gi_core.geometry.receivers import NONE
from gi_core.model import Model
from gi_core.photons.paths import (
    PathVertices,
    Segments,
    bounced,
    concatenate,
    empty_segments,
    grown,
    rows_of,
    segments_at,
    segments_behind,
)
from gi_core.photons.trace import Fates, add_fates_behind, add_to, emitted_rays, follow, no_flux, reflected
from gi_core.rays.accelerator import CUT_PAD, FAR, Transforms, passes_box
from gi_core.rays.all_objects import World, nearest_mobile
from gi_core.rays.structures import new_ray

LANES = 16  # segments per vector test
PAD = 1e-3  # of the world's size: covers the rounding of the test; the grid's is one level
QUANTISATION = 65_535


class Grid(NamedTuple):
    """Quantisation of positions: level = (x - low) * per_metre."""

    low: np.ndarray  # (3,) float64 [m]
    per_metre: float


class Coarse(NamedTuple):
    """Quantised path vertices, photon-major, padded by LANES vertices of later photons or of none."""

    x: np.ndarray  # (n + LANES,) uint16
    y: np.ndarray
    z: np.ndarray
    photon: np.ndarray  # (n + LANES,) int32, -1: none
    grid: Grid


def grid_for(world: World, centre: np.ndarray, radius: float) -> Grid:
    """Return the grid that covers all path vertices of a scene.

    Paths start on the static part or within 1.5 `radius` [m] of `centre` (3,), and end at most FAR world sizes away.
    """
    reach = 1.5 * max(radius, 0.5 * world.size) + 1.01 * FAR * world.size
    return Grid(np.asarray(centre, np.float64) - reach, QUANTISATION / (2 * reach))


def same_grid(a: Grid, b: Grid) -> bool:
    return np.array_equal(a.low, b.low) and a.per_metre == b.per_metre


class CoarseStore:
    """Append-only store of the quantised vertices of photons 0 .. N - 1."""

    def __init__(self, grid: Grid):
        self.grid = grid
        self._levels = [np.zeros(LANES, np.uint16) for _ in range(3)]
        self._photon = np.full(LANES, -1, np.int32)
        self._count = 0

    def copied(self) -> CoarseStore:
        """Return a copy."""
        other, n = CoarseStore(self.grid), self._count
        other._levels, other._photon = [a[: n + LANES].copy() for a in self._levels], self._photon[: n + LANES].copy()
        other._photon[n:], other._count = -1, n
        return other

    def append(self, parts: Sequence[PathVertices], first: int, room: int, threads: int) -> None:
        """Append the paths of photons from `first` on, part by part; `room`: number of vertices to reserve."""
        photons = np.cumsum([first, *(len(p.offsets) - 1 for p in parts)])
        starts = np.cumsum([self._count, *(len(p.side) for p in parts)])
        n = int(starts[-1])
        room = max(room, n) + LANES
        self._levels, self._photon = [grown(a, room) for a in self._levels], grown(self._photon, room)

        def work(_, a, b):
            for p, photon, start in zip(parts[a:b], photons[a:b], starts[a:b], strict=True):
                _round(p.offsets, p.position, *self.grid, photon, start, *self._levels, self._photon)

        run_ranges(work, len(parts), threads, 1)
        self._photon[n : n + LANES] = -1
        self._count = n

    def subset(self, vertices: int) -> Coarse:
        """Return views of the first `vertices` vertices."""
        n = vertices + LANES
        return Coarse(*(a[:n] for a in self._levels), self._photon[:n], self.grid)


@kernel
def _round(offsets, position, low, per_metre, first, row, x, y, z, photon):
    for i in range(len(offsets) - 1):
        for k in range(offsets[i], offsets[i + 1]):
            x[row] = np.uint16(min(max((position[k, 0] - low[0]) * per_metre + 0.5, 0.0), float(QUANTISATION)))
            y[row] = np.uint16(min(max((position[k, 1] - low[1]) * per_metre + 0.5, 0.0), float(QUANTISATION)))
            z[row] = np.uint16(min(max((position[k, 2] - low[2]) * per_metre + 0.5, 0.0), float(QUANTISATION)))
            photon[row] = first + i
            row += 1


@inlined
def _near(x, y, z, first, cx, cy, cz, r2):
    """Return a bit mask of the LANES segments from vertex `first` on that pass within a sphere.

    The nearest point of each is computed without branches or divisions in a loop of fixed length: LLVM vectorises it.
    """
    bits = np.uint32(0)
    for lane in range(np.uint64(LANES)):
        k = np.uint64(first) + lane
        ox, oy, oz = np.float32(x[k]), np.float32(y[k]), np.float32(z[k])
        dx, dy, dz = (
            np.float32(x[k + np.uint64(1)]) - ox,
            np.float32(y[k + np.uint64(1)]) - oy,
            np.float32(z[k + np.uint64(1)]) - oz,
        )
        ax, ay, az = cx - ox, cy - oy, cz - oz
        length2 = dx * dx + dy * dy + dz * dz
        along = min(max(ax * dx + ay * dy + az * dz, np.float32(0.0)), length2)
        # Both sides are multiplied by length2, which saves a division.
        px, py, pz = along * dx - length2 * ax, along * dy - length2 * ay, along * dz - length2 * az
        yes = px * px + py * py + pz * pz <= r2 * length2 * length2
        bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits


@kernel
def _scan(x, y, z, first, last, centres, radii, out):
    """List the vertices first .. last - 1 whose segment to the next vertex passes near any mobile; return their number.

    out (last - first,).
    """
    n = 0
    for block in range(first, last, LANES):
        bits = np.uint32(0)
        for m in range(len(radii)):
            bits = np.uint32(
                bits | _near(x, y, z, block, centres[m, 0], centres[m, 1], centres[m, 2], radii[m] * radii[m])
            )
        while bits != 0:
            k = block + lowest_bit(bits)
            bits &= bits - np.uint32(1)
            if k < last:
                out[n] = k
                n += 1
    return n


@kernel
def _segments_only(photon, rows, photons):
    """Drop the last vertices of paths, which start no segment, and write photons; return the number of rows left.

    A separate loop, so that its memory accesses are independent and overlap.
    """
    n = 0
    for j in range(len(rows)):
        k = rows[j]
        rows[n], photons[n] = k, photon[k]
        n += photon[k] == photon[k + 1]
    return n


def find_near(world: World, coarse: Coarse, at: Transforms, margin, threads: int) -> tuple[np.ndarray, np.ndarray]:
    """Return photon and vertex (n,) int64 of background segments within a margin of a mobile's sphere, in order.

    margin: [m], one number or (mobiles,).
    """
    grid = coarse.grid
    centres = np.empty((len(at.position) - 1, 3), np.float32)
    for o in range(1, len(at.position)):
        c, R = world.sphere_centre[o], at.rotation[o]
        for i in range(3):
            x = R[i, 0] * c[0] + R[i, 1] * c[1] + R[i, 2] * c[2] + at.position[o, i]
            centres[o - 1, i] = (x - grid.low[i]) * grid.per_metre
    radii = ((world.sphere_radius[1:] + margin + PAD * world.size) * grid.per_metre + 2).astype(np.float32)
    vertices, levels = len(coarse.photon) - LANES, (coarse.x, coarse.y, coarse.z)

    def work(_, first, last):
        rows = np.empty(last - first, np.int64)  # untouched memory costs nothing
        n = _scan(*levels, first, last, centres, radii, rows)
        photons = np.empty(n, np.int64)
        n = _segments_only(coarse.photon, rows[:n], photons)
        return photons[:n], rows[:n]

    photons, rows = zip(*run_ranges(work, vertices, threads, 1 << 16), strict=True)  # 1 << 16 vertices per thread
    return np.concatenate(photons), np.concatenate(rows)


class RemovedSuffixes(NamedTuple):
    """Removed suffixes of n cut photons, photon-major."""

    paths: PathVertices  # of the background
    photon: np.ndarray  # (n,) int64
    vertex: np.ndarray  # (n,) int64, start vertex of the cut segment
    low: np.ndarray  # (n,) float32 [m], distance along it where the suffix begins; -1: with the whole segment

    @property
    def size(self) -> int:
        """Number of segments, including the cut ones."""
        return int((self.paths.offsets[self.photon + 1] - 1 - self.vertex).sum())

    @property
    def bounce(self) -> np.ndarray:
        """Bounce index of the cut segment, (n,) int64."""
        return self.vertex - self.paths.offsets[self.photon]

    def of(self, rows) -> RemovedSuffixes:
        """Return the suffixes of the given rows."""
        return self._replace(photon=self.photon[rows], vertex=self.vertex[rows], low=self.low[rows])

    def bounced(self) -> RemovedSuffixes:
        """Return the suffixes without direct segments."""
        bounced = self.paths.offsets[self.photon] + self.paths.direct[self.photon]
        vertex, low = np.maximum(self.vertex, bounced), np.where(self.vertex < bounced, np.float32(-1.0), self.low)
        left = vertex < self.paths.offsets[self.photon + 1] - 1
        return self._replace(vertex=vertex, low=low).of(left)

    def segments(self, threads: int = 1) -> Segments:
        """Return the suffixes as segments, photon-major."""
        return segments_behind(self.paths, self.photon, self.vertex, self.low, threads)


def no_removed_suffixes(paths: PathVertices) -> RemovedSuffixes:
    """Return the removed suffixes of no photon."""
    nobody = np.empty(0, np.int64)
    return RemovedSuffixes(paths, nobody, nobody, empty_segments(0).low)


class Wanted(NamedTuple):
    """Current segments that an estimator needs besides the path changes."""

    reach: float  # [m], distance from a mobile's box within which segments are needed; 0 if no mobiles
    boxes: np.ndarray  # (b, 2, 3) float64 [m], corners low and high: boxes whose segments are needed
    around: np.ndarray  # (mobiles,) float64 [m], radius round the centre of each that covers the boxes
    mobiles: bool = True  # False: light of mobiles, and segments near them, are not needed

    @classmethod
    def changes(cls, model: Model, mobiles: bool) -> Wanted:
        """Return the needs of an estimator that reads hits: path changes only."""
        return cls(0.0, np.empty((0, 2, 3)), np.zeros(model.surfaces.objects - 1), mobiles)


class PoseChange(NamedTuple):
    """Difference of the current paths from the background, at one pose."""

    at: Transforms
    photons: int
    kept_prefixes: Segments  # the cut segment of each cut photon, up to the cut
    removed_suffixes: RemovedSuffixes  # that segment behind the cut, and all later ones
    new_suffixes: Segments  # paths from the cut onwards, among mobiles
    near_mobiles: tuple[Segments, ...]  # per mobile, if needed: current segments that may cross a disc on it
    near_boxes: Segments  # current segments that pass one of the boxes needed
    new_fates: Fates  # of the flux that the cut photons bring to their cuts
    direct: bool = True  # segments that leave lamps count

    def bounced(self) -> PoseChange:
        """Return the change without direct segments, apart from kept prefixes."""
        removed, near = self.removed_suffixes.bounced(), tuple(bounced(s) for s in self.near_mobiles)
        new, boxes = bounced(self.new_suffixes), bounced(self.near_boxes)
        return self._replace(
            removed_suffixes=removed, new_suffixes=new, near_mobiles=near, near_boxes=boxes, direct=False
        )

    @property
    def fates(self) -> Fates:
        """Fates of all photons at these poses, minus those of the background."""
        sums, paths = np.zeros((3, len(self.new_fates.emitted)), np.int64), self.removed_suffixes.paths
        photon, vertex = self.removed_suffixes.photon, self.removed_suffixes.vertex
        add_fates_behind(paths.offsets, paths.side, paths.flux, paths.lamp, photon, vertex, sums)
        fates = Fates(*(flux.copy() for flux in self.new_fates))
        add_to(fates, sums, -1)
        return fates


class _Lines(NamedTuple):
    """Background segments near mobiles, as far as tests read them."""

    photon: np.ndarray  # (n,) int64, photon-major
    vertex: np.ndarray  # (n,) int64, start vertex
    origin: np.ndarray  # (n, 3) float32 [m]
    end: np.ndarray  # (n, 3) float32 [m]
    side: np.ndarray  # (n,) int32, side at the origin or NONE


def change(
    model: Model,
    paths: PathVertices,
    coarse: Coarse,
    at: Transforms,
    seed: int,
    wanted: Wanted,
    clock,
) -> PoseChange:
    """Return the difference of current paths from the background at the poses `at`.

    `paths` and `coarse` hold the same photons. `clock(stage)` is called at the end of each stage.
    """
    photons = len(paths.offsets) - 1
    if photons == 0 or len(at.position) == 1:
        nothing = empty_segments(0)
        removed_suffixes, near = (
            no_removed_suffixes(paths),
            (nothing,) * (len(at.position) - 1) * wanted.mobiles,
        )
        unchanged = no_flux(model.emitters.lamps.count)
        return PoseChange(at, photons, nothing, removed_suffixes, nothing, near, nothing, unchanged)

    # Find the first segment of each photon that any mobile cuts.
    rows = candidate_segments(model, coarse, at, wanted)
    clock("scan")
    near = _lines(paths, *rows, model.threads)
    cut, cut_side = _cuts(model, at, near)
    first_cut = _first_of_each(near.photon, np.flatnonzero(cut_side != NONE))
    clock("cuts")

    # Split these paths into kept prefix and removed suffix, and trace the new suffixes off the mobiles.
    photon, vertex, high = near.photon[first_cut], near.vertex[first_cut], cut[first_cut]
    kept_prefixes = segments_at(paths, photon, vertex, model.threads)
    kept_prefixes = kept_prefixes._replace(high=high, cut_side=cut_side[first_cut])
    removed_suffixes = RemovedSuffixes(paths, photon, vertex, high)
    hit, new_suffixes, fates = _new_suffixes(model, at, seed, kept_prefixes, high)
    kept_prefixes = kept_prefixes._replace(hit=hit)
    clock("suffixes")

    near_boxes, near_mobiles = _seen(model, at, wanted, paths, near, kept_prefixes, new_suffixes)
    clock("mobiles")
    return PoseChange(at, photons, kept_prefixes, removed_suffixes, new_suffixes, near_mobiles, near_boxes, fates)


def candidate_segments(model: Model, coarse: Coarse, at: Transforms, wanted: Wanted):
    """Return photon and vertex (n,) int64 of the background segments that pass the broad phase."""
    margin = np.maximum(wanted.reach, wanted.around - model.world.sphere_radius[1:])
    return find_near(model.world, coarse, at, margin, model.threads)


def _lines(paths: PathVertices, photons: np.ndarray, vertices: np.ndarray, threads: int) -> _Lines:
    """Return the background segments that leave the given vertices (n,) of the given photons (n,)."""
    n = len(vertices)
    lines = _Lines(photons, vertices, *np.empty((2, n, 3), np.float32), np.empty(n, np.int32))
    run_ranges(lambda _, *rows: _read_lines(paths.position, paths.side, *lines[1:], *rows), n, threads, CHEAP)
    return lines


@kernel
def _read_lines(position, sides, vertex, origin, end, side, first, last):
    for j in range(first, last):
        k = vertex[j]
        for c in range(3):
            origin[j, c], end[j, c] = position[k, c], position[k + 1, c]
        side[j] = sides[k]


def _seen(
    model: Model, at: Transforms, wanted: Wanted, paths: PathVertices, near: _Lines, kept_prefixes: Segments,
    new_suffixes: Segments,
):  # fmt: skip
    """Collect current segments (uncut background, kept prefixes, new suffixes) near boxes and mobiles.

    Returns the segments that pass the needed boxes and, per mobile if needed, those near it.
    """
    if not wanted.mobiles and not len(wanted.boxes):
        return empty_segments(0), ()
    reach = wanted.reach if wanted.mobiles else None
    uncut, *changed = (
        select(model, at, lines.origin, lines.end, reach, wanted.boxes) for lines in (near, kept_prefixes, new_suffixes)
    )

    def collected(o: int) -> Segments:
        rows = np.flatnonzero(uncut[o])
        photon, vertex = near.photon[rows], near.vertex[rows]
        bounce = vertex - paths.offsets[photon]
        before = _before_cut(photon, bounce, kept_prefixes.photon, kept_prefixes.bounce)
        background = segments_at(paths, photon[before], vertex[before], model.threads)
        parts = zip((kept_prefixes, new_suffixes), changed, strict=True)
        return concatenate([background, *(rows_of(segments, np.flatnonzero(passes[o])) for segments, passes in parts)])

    near_boxes, *near_mobiles = (collected(o) for o in range(len(at.position) if wanted.mobiles else 1))
    return near_boxes, tuple(near_mobiles)


def _cuts(model: Model, at: Transforms, near: _Lines) -> tuple[np.ndarray, np.ndarray]:
    """Return the results of nearest_mobile() for all lines, on all threads."""
    n = len(near.side)
    cut, cut_side = np.empty(n, np.float32), np.empty(n, np.int32)

    def work(_, first, last):
        lines = (a[first:last] for a in (near.origin, near.end, near.side, cut, cut_side))
        nearest_mobile(model.accelerator.scenes, new_ray(), model.world, at, *lines)

    run_ranges(work, n, model.threads, CHEAP)
    return cut, cut_side


def _first_of_each(photon: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the first row of each photon; rows are photon-major."""
    p = photon[rows]
    return rows[np.concatenate([[True], p[1:] != p[:-1]])] if len(rows) else rows


def _before_cut(photon, bounce, cut_photon, cut_bounce) -> np.ndarray:
    """Return (n,) bool: the segment is not cut and not behind a cut. Both lists are photon-major."""
    if not len(cut_photon):
        return np.ones(len(photon), bool)
    k = np.minimum(np.searchsorted(cut_photon, photon), len(cut_photon) - 1)
    return (cut_photon[k] != photon) | (bounce < cut_bounce[k])


def _new_suffixes(model: Model, at: Transforms, seed: int, kept_prefixes: Segments, cut: np.ndarray):
    """Trace cut photons off the mobiles, on all threads.

    Returns the positions (n, 3) float32 of the cuts, the new suffixes, and the fates of the flux at the cuts.
    """

    def work(_, first, last):
        part, fates = slice(first, last), no_flux(model.emitters.lamps.count)
        ended = Segments(*(a[part] for a in kept_prefixes))
        hit, rays = reflected(model.world, at, seed, ended, cut[part], fates)
        return hit, follow(model.accelerator, model.world, at, seed, rays, fates), fates

    hits, new_suffixes, fates = zip(*run_ranges(work, kept_prefixes.size, model.threads, COSTLY), strict=True)
    return np.concatenate(hits), concatenate(list(new_suffixes)), _together(fates)


def _together(fates) -> Fates:
    return Fates(*(sum(parts) for parts in zip(*fates, strict=True)))


def current_segments(model: Model, at: Transforms, seed: int, first: int, count: int) -> tuple[Segments, Fates]:
    """Trace photons first .. first + count - 1 from scratch at the poses `at`.

    Independent of background and cuts: every frame must equal this.
    """

    def work(_, a, b):
        fates = no_flux(model.emitters.lamps.count)
        rays = emitted_rays(model.emitters, seed, first + a, b - a, fates)
        return follow(model.accelerator, model.world, at, seed, rays, fates), fates

    segments, fates = zip(*run_ranges(work, count, model.threads, COSTLY), strict=True)
    return concatenate(list(segments)), _together(fates)


def split_at_cuts(segments: Segments) -> tuple[Segments, Segments]:
    """Return the cut segments, and those behind cuts; segments: all current ones of some photons."""
    cut = np.flatnonzero(segments.cut_side != NONE)
    photon = segments.photon - segments.photon.min(initial=0)
    first = np.full(photon.max(initial=-1) + 1, MAX_PATH, np.int64)
    np.minimum.at(first, photon[cut], segments.bounce[cut])
    kept_prefixes = cut[segments.bounce[cut] == first[photon[cut]]]
    return rows_of(segments, kept_prefixes), rows_of(segments, segments.bounce > first[photon])


# Culling against boxes: those of mobiles, padded by the reach of a disc, and those of a frame's stale receivers -----


def select(
    model: Model, at: Transforms, origin: np.ndarray, end: np.ndarray, reach: float | None, boxes: np.ndarray
) -> np.ndarray:
    """Return (1 + mobiles, n) bool: row 0, the lines that pass any of the boxes; row o, those that pass mobile o's box.

    origin, end: (n, 3) float32 [m], of the lines.
    reach: growth of the mobiles' boxes [m], None leaves their rows False. boxes: (b, 2, 3) float64 [m], corners low and
    high.
    """
    size = model.world.size
    out = np.zeros((len(at.position), len(origin)), bool)
    seen = [(0, low, high, CUT_PAD * size) for low, high in boxes]
    if reach is not None:
        low, high, pad = model.world.box_low, model.world.box_high, reach + (PAD + CUT_PAD) * size
        seen += [(o, low[o], high[o], pad) for o in range(1, len(at.position))]

    def work(_, first, last):
        for o, low, high, pad in seen:
            _pass(origin, end, at.rotation[o], at.position[o], low, high, pad, first, last, out[o])

    run_ranges(work, len(origin), model.threads, CHEAP)
    return out


@kernel
def _pass(origin, end, R, p, low, high, pad, first, last, out):
    for k in range(first, last):
        ox, oy, oz = rotate_back(R, difference(origin[k], p))
        ex, ey, ez = rotate_back(R, difference(end[k], p))
        out[k] |= passes_box(ox, oy, oz, ex, ey, ez, low, high, pad)

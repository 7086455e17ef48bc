"""Lower bounds of frame time: the rays, disc tests, disc intersections and bytes of a frame, counted, as bare loops.

Calls of the disc search are recorded, and rays are rebuilt from segments, so both can be repeated without the rest of
the frame. Disc tests and additions run on data in the nearest cache. The caller measures time: `Work.run()` does
`batch` units, a frame needs `count`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.base.threads import run_ranges
from gi_core.discs.search.disc_grid import CELL_RADII
from gi_core.estimators import ESTIMATORS
from gi_core.photons.flux_sums import Sums
from gi_core.photons.paths import Segments, empty_segments, segments_at, segments_of, take
from gi_core.rays.accelerator import FAR, ORIGIN_LIFT, rays_to_object
from gi_core.retrace.broad_phase import PAD, ScanBuffers
from gi_core.retrace.cuts import candidate_segments
from gi_core.retrace.select_segments import select
from gi_core.solver import Solver

VERTEX_BYTES = 28  # per path vertex: position, side, flux
SUM_BYTES = 24  # per receiver: three int64, or three float64
HIT_BYTES = 24  # per photon hit: position and flux
IN_CACHE = 1024  # discs, or receivers: 24 kB, fit into any level-1 cache
TEST_LINES = 2048  # lines per batch against those discs
ADDITIONS = 1 << 20
CHUNK = 1 << 16  # photons
LEAST_COPY = 1 << 12  # bytes


class Work(NamedTuple):
    """One kind of work of one stage."""

    stage: str
    unit: str  # "rays", "disc tests", "crossings", "bytes"
    count: int  # units in the frame
    batch: int  # units per call of run(), on all threads
    run: Callable[[], object]


def work_of_frame(solver: Solver, poses) -> list[Work]:
    """Compute the frame at `poses` and return its work, by stage."""
    lines = _recorded(solver, poses)
    threads = solver.model.threads
    vertices = solver.segments_total + solver.photons_traced
    changes, row = solver.changes, sum(a.itemsize * a[0].size for a in empty_segments(1))
    receivers = len(solver.irradiance)
    estimate = estimate_of(solver)
    moved = [
        ("scan", 12 * vertices),
        ("suffixes", row * changes.new_segments),
        ("estimate", 2 * SUM_BYTES * receivers + VERTEX_BYTES * changes.old_segments),
        ("read out", (2 * SUM_BYTES + 8) * receivers),
    ]
    if hasattr(estimate, "stale"):  # a query of k nearest hits reads k hits at the least
        moved.append(("estimate", (estimate.stale + _on_mobiles(solver)) * estimate.k * HIT_BYTES))
    work = [w for w in _rays(solver) if w.count]
    work += [copied(stage, size, threads) for stage, size in moved if size]
    if lines:
        tests = sum(candidates(discs, *ends) for discs, ends, _ in lines)
        crossings = sum(found for _, _, found in lines) + _looked_up(
            estimate, solver.frame_parts().change.removed_suffixes
        )
        work += [tested(tests, threads), added(crossings, threads)]
    elif getattr(estimate, "on_faces", False):
        hits = changes.old_segments + changes.new_segments
        work.append(added(3 * hits, threads))  # each hit adds to three corners of its face
    return work


def estimate_of(solver: Solver):
    """Return the estimator of the solver's frames."""
    return solver.frame_parts().background.estimate


def full_estimate(solver: Solver) -> Callable[[], None]:
    """Return a call that estimates all static receivers from the background, as the first frame does."""
    twin = ESTIMATORS[solver.estimator](solver.model, solver.setting)
    for _ in twin.build():
        pass
    photons = solver.photons_traced
    paths = solver.frame_parts().photons.prefix(photons)[0]
    for first in range(0, photons, CHUNK):
        last = min(first + CHUNK, photons)
        twin.add_background(segments_of(paths, solver.model.eps, first, last), 0)

    def run() -> None:
        for _ in twin.prepare(photons):
            pass

    return run


# Recording a frame --------------------------------------------------------------------------------------


class _Recorder:
    """Proxy of an object that records copies of the arguments and results of one method."""

    def __init__(self, inner, method: str):
        self._inner, self.calls = inner, []
        call = getattr(inner, method)

        def kept(*given):
            given_copy = tuple(_copy(g) for g in given)
            result = call(*given)
            self.calls.append((given_copy, result))
            return result

        setattr(self, method, kept)

    def __getattr__(self, name: str):
        return getattr(self._inner, name)


def _copy(value):
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*(_copy(v) for v in value))
    return value


def _recorded(solver: Solver, poses):
    """Compute the frame at `poses`; return the lines of its searches [(discs, ends, intersections)]."""
    estimate = estimate_of(solver)
    searches = getattr(estimate, "_searches", None)
    recorders = [_Recorder(s, "splat") for s in searches or ()]
    if searches:
        estimate._searches = recorders
    try:
        solver.move_all(poses)
    finally:
        if searches:
            estimate._searches = searches
    lines = []
    for recorder in recorders:
        for (given, _sign, _sums, part, _parts), found in recorder.calls:
            # Parts of a call receive the same lines: count those of the first part.
            some = slice(None if part == 0 else 0)
            ends = given.origin[some], given.direction[some], given.low[some], given.high[some]
            lines.append((recorder.discs, ends, int(found)))
    return lines


def _rays(solver: Solver) -> list[Work]:
    """Return the rays of the last frame: along candidates for cuts, and along new suffixes, each also past mobiles."""
    model, frame = solver.model, solver.frame_parts().change
    paths, coarse = solver.frame_parts().photons.prefix(frame.photons)
    wanted = estimate_of(solver).wanted(frame.at, mobiles=bool(frame.near_mobiles))
    rows = candidate_segments(model, coarse, frame.at, wanted, ScanBuffers())
    near = segments_at(paths, model.eps, *rows, model.threads)
    work = [_cast(solver, "suffixes", 0, *_as_rays(solver, 0, frame.new_suffixes))]
    for stage, segments in (("cuts", near), ("suffixes", frame.new_suffixes)):
        pass_by = select(model, frame.at, segments, -PAD * model.world.size, wanted.boxes[:0])
        for o in range(1, len(pass_by)):
            work.append(_cast(solver, stage, o, *_as_rays(solver, o, take(segments, np.flatnonzero(pass_by[o])))))
    return work


def _as_rays(solver: Solver, o: int, segments: Segments):
    """Return origins, directions and limits of segments in object o's space, lifted off their origins."""
    model, at = solver.model, solver.frame_parts().change.at
    way = segments.end.astype(np.float64) - segments.origin
    length = np.maximum(np.sqrt((way * way).sum(axis=1)), 1e-30)
    d = way / length[:, None]
    origins, directions = segments.origin + ORIGIN_LIFT * model.world.size * d, d
    limits = np.full(len(length), FAR * model.world.size) if o == 0 else length
    return *rays_to_object(at, o, origins.astype(np.float32), directions.astype(np.float32)), limits


def _looked_up(estimate, removed_suffixes) -> int:
    """Return the number of disc intersections of removed suffixes that are subtracted without a search."""
    static = estimate.background(estimate.photons)[0]
    return estimate._crossings.take_out(removed_suffixes, 0, len(removed_suffixes.photon), Sums.zeros(len(static)))


def _on_mobiles(solver: Solver) -> int:
    return len(solver.irradiance) - solver.surfaces.receiver_range(0).stop


def _cast(solver: Solver, stage: str, o: int, origins, directions, limits) -> Work:
    accelerator = solver.model.accelerator
    n, limits = len(origins), limits.astype(np.float32)
    return Work(stage, "rays", n, n, lambda: accelerator.nearest(o, origins, directions, limits))


# Bytes --------------------------------------------------------------------------------------------------


def copied(stage: str, size: int, threads: int) -> Work:
    """Return work that moves `size` bytes: it reads one half and writes the other."""
    half = np.zeros(max(size, LEAST_COPY) // 2, np.uint8)
    other = np.ones_like(half)

    def part(_, first, last):
        np.copyto(other[first:last], half[first:last])

    return Work(stage, "bytes", size, 2 * len(half), lambda: run_ranges(part, len(half), threads, 1 << 18))


# Disc tests and crossings -------------------------------------------------------------------------------


def tested(count: int, threads: int) -> Work:
    """Return work that tests lines against discs in the nearest cache, with vector instructions."""
    rng = np.random.default_rng(0)
    discs = rng.random((6, IN_CACHE), np.float32)
    lines = rng.random((TEST_LINES, 6), np.float32)

    def part(_, first, last):
        return _test(*discs, lines, first, last, np.float32(0.01), np.empty(IN_CACHE, np.uint8))

    batch = TEST_LINES * IN_CACHE
    return Work("estimate", "disc tests", count, batch, lambda: run_ranges(part, TEST_LINES, threads, 1))


@kernel
def _test(cx, cy, cz, nx, ny, nz, lines, first, last, r2, yes):
    """Write one byte per test: 0.4 ns; counting the hits instead takes 0.9 ns."""
    for k in range(first, last):
        ox, oy, oz, dx, dy, dz = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3], lines[k, 4], lines[k, 5]
        for j in range(np.uint64(IN_CACHE)):
            slope = dx * nx[j] + dy * ny[j] + dz * nz[j]
            ax, ay, az = cx[j] - ox, cy[j] - oy, cz[j] - oz
            t = (ax * nx[j] + ay * ny[j] + az * nz[j]) / slope
            px, py, pz = t * dx - ax, t * dy - ay, t * dz - az
            yes[j] = (t >= np.float32(0.0)) & (t < np.float32(1.0)) & (px * px + py * py + pz * pz <= r2)
    return yes[0]


def added(count: int, threads: int) -> Work:
    """Return work that adds a flux to the sums of random receivers, all in the nearest cache."""
    rng = np.random.default_rng(0)
    index = rng.integers(0, IN_CACHE, ADDITIONS).astype(np.int32)
    flux = rng.integers(0, 1 << 20, (IN_CACHE, 3)).astype(np.int32)

    def part(_, first, last):
        return _add(index, flux, first, last, np.zeros((IN_CACHE, 3), np.int64))

    return Work("estimate", "crossings", count, ADDITIONS, lambda: run_ranges(part, ADDITIONS, threads, 1 << 16))


@kernel
def _add(index, flux, first, last, sums):
    for k in range(first, last):
        i = index[k]
        for c in range(3):
            sums[i, c] += flux[k & (IN_CACHE - 1), c]
    return sums[0, 0]


def candidates(discs, origin, direction, low, high) -> int:
    """Return the number of disc tests of a uniform grid of CELL_RADII cells: discs in the cells that lines pass.

    A disc counts in every cell that its box touches. The two sides of a two-sided surface are one disc.
    """
    lit = discs.regions.area > 0
    if not lit.any() or not len(origin):
        return 0
    p, n = discs.positions[lit], discs.normals[lit]
    facing = np.where(n[np.arange(len(n)), np.abs(n).argmax(axis=1)] < 0, -1, 1)[:, None]
    both = np.unique(np.concatenate([p, n * facing], axis=1), axis=0)
    p, n = both[:, :3].astype(np.float64), both[:, 3:].astype(np.float64)
    half = float(discs.radius) * np.sqrt(np.clip(1 - n * n, 0, 1))
    corner = (p - half).min(axis=0)
    extent = (p + half).max(axis=0) - corner
    cell = max(CELL_RADII * float(discs.radius), float(extent.max()) / 256)
    shape = np.floor(extent / cell).astype(np.int64) + 1
    inside = np.zeros(shape, np.int32)
    first = np.clip(np.floor((p - half - corner) / cell).astype(np.int64), 0, shape - 1)
    last = np.clip(np.floor((p + half - corner) / cell).astype(np.int64), 0, shape - 1)
    _fill(first, last, inside)
    return int(_walk(corner, cell, inside, origin, direction, low, high))


@kernel
def _fill(first, last, inside):
    for j in range(len(first)):
        for x in range(first[j, 0], last[j, 0] + 1):
            for y in range(first[j, 1], last[j, 1] + 1):
                for z in range(first[j, 2], last[j, 2] + 1):
                    inside[x, y, z] += 1


@allocating
def _walk(corner, cell, inside, origin, direction, low, high):
    """Return the number of discs in the cells that lines pass; slow, run once."""
    total = 0
    at, step = np.empty(3, np.int64), np.empty(3, np.int64)
    wall, width = np.empty(3), np.empty(3)
    for k in range(len(origin)):
        t0, t1 = float(low[k]), float(high[k])
        for c in range(3):
            o, d, end = float(origin[k, c]), float(direction[k, c]), corner[c] + inside.shape[c] * cell
            if d == 0.0:
                if not corner[c] <= o <= end:
                    t1 = t0 - 1.0
                continue
            a, b = (corner[c] - o) / d, (end - o) / d
            t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
        if not t0 < t1:
            continue
        for c in range(3):
            o, d = float(origin[k, c]), float(direction[k, c])
            at[c] = min(max(int(np.floor((o + t0 * d - corner[c]) / cell)), 0), inside.shape[c] - 1)
            step[c] = 1 if d > 0.0 else -1
            wall[c] = (corner[c] + (at[c] + (1 if d > 0.0 else 0)) * cell - o) / d if d != 0.0 else np.inf
            width[c] = cell / abs(d) if d != 0.0 else np.inf
        while True:
            total += inside[at[0], at[1], at[2]]
            c = 0 if wall[0] <= wall[1] and wall[0] <= wall[2] else (1 if wall[1] <= wall[2] else 2)
            if wall[c] >= t1:
                break
            at[c] += step[c]
            wall[c] += width[c]
            if at[c] < 0 or at[c] >= inside.shape[c]:
                break
    return total

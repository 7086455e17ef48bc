"""Lower bounds of frame time: the work that the stages of a frame cannot avoid, timed alone on this machine.

    python -m studies.lower_bounds tree --photons 100000 --estimator tangent_plane

The rays, disc tests, disc crossings and bytes of the median frame are counted and run as bare loops. Rays and the lines
of disc searches are rebuilt from the segments of that frame. Disc tests and additions run on data in the nearest cache.
The table has a row per stage: measured time [ms], bound [ms], their ratio, and the counts with their rates.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app.cli.progress import Bar, compile_kernels, solve
from app.cli.terminal import say
from app.draw import motion
from app.measure.bench.measure import walk
from app.measure.bench.report_times import best_seconds
from app.settings import STEP, Settings, make_solver, open_moving_scene
from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges
from gi_core.discs.search.disc_grid import CELL_RADII, discs_in_cells
from gi_core.discs.search.predicate import Discs, Lines, lines, to_list
from gi_core.estimators import ESTIMATORS, Estimator
from gi_core.estimators.photon_map import PhotonMap
from gi_core.instruments.search_timing import search_run
from gi_core.photons.paths import Segments, empty_segments, segments_at, segments_of, take
from gi_core.rays.accelerator import FAR, LIFT
from gi_core.rays.all_objects import rays_to_object
from gi_core.retrace.broad_phase import PAD, ScanBuffers
from gi_core.retrace.cuts import candidate_segments, select
from gi_core.solver import Solver

VERTEX_BYTES = 28  # per path vertex: position, side, flux
SUM_BYTES = 24  # per receiver: three int64, or three float64
HIT_BYTES = 24  # per photon hit: position and flux
IN_CACHE = 1024  # discs, or receivers: 24 kB, fit into any level-1 cache
TEST_LINES = 2048  # lines per batch against those discs
ADDITIONS = 1 << 20
POINTS = 8  # of a line
CHUNK = 1 << 16  # photons
LEAST_COPY = 1 << 12  # bytes
COPY_BYTES = 128_000_000  # of the copy that measures bandwidth: larger than any cache


class Bound(NamedTuple):
    """The bound of one stage."""

    ms: float
    work: dict[str, tuple[int, float]]  # unit -> count, and the units per second of the bare loop


class Found(NamedTuple):
    """Bounds of the median frame of a walk, beside its measured medians."""

    stages_ms: dict[str, float]
    bounds: dict[str, Bound]  # by stage; some are not timed apart
    frame_ms: float
    cpu_ms: float  # of all threads
    threads: int
    queries: Queries | None

    @property
    def bound_ms(self) -> float:
        """Bound of the whole frame."""
        return sum(b.ms for b in self.bounds.values())


class Queries(NamedTuple):
    """Cost of the queries of stale receivers, which photon_map estimates again."""

    stale_share: float  # of the static receivers
    count: float  # queries per frame, those on mobiles included
    us_per_query: float
    full_estimate_ms: float  # of all static receivers

    @property
    def allowed_ms(self) -> float:
        """Time of a full estimate times the share of stale receivers."""
        return self.full_estimate_ms * self.stale_share


def measure(solver: Solver, frames: int, bar: Bar) -> Found:
    """Time a walk of a solved solver, and bound its median frame. Leaves the solver at that frame."""
    lap = motion.walk(motion.paths_of(solver), STEP * solver.scene_size, frames)
    walked = walk(solver, lap, bar)
    ms, stages_ms = np.array(walked.frames["ms"]), {name: float(np.median(v)) for name, v in walked.stages.items()}
    bar("bounds", 0.0)
    middle = float(np.median(ms))
    bounds = bounds_of(work_of_frame(solver, lap[int(np.abs(ms - middle).argmin())]))
    cpu_ms, threads = float(np.median(walked.frames["cpu ms"])), solver.model.threads
    return Found(stages_ms, bounds, middle, cpu_ms, threads, queries(solver, stages_ms["estimate"]))


def bounds_of(works: list[Work]) -> dict[str, Bound]:
    """Run all works; return the bound of each stage."""
    stages: dict[str, dict[str, list[float]]] = {}
    for work in works:
        seconds = work.count * best_seconds(work.run) / work.batch
        total = stages.setdefault(work.stage, {}).setdefault(work.unit, [0, 0.0])
        total[0] += work.count
        total[1] += seconds
    return {
        stage: Bound(1e3 * sum(s for _, s in units.values()), {u: (int(n), n / s) for u, (n, s) in units.items()})
        for stage, units in stages.items()
    }


def queries(solver: Solver, estimate_ms: float) -> Queries | None:
    """Return the queries of photon_map in the last frame; None for other estimators."""
    estimate, static = estimate_of(solver), solver.surfaces.receiver_range(0).stop
    if not isinstance(estimate, PhotonMap):
        return None
    count = estimate.stale + _on_mobiles(solver)
    full = 1e3 * best_seconds(full_estimate(solver))
    return Queries(estimate.stale / max(static, 1), count, 1e3 * estimate_ms / max(count, 1), full)


def table(found: Found) -> list[str]:
    """Return the lines of the printed table."""
    out = [f"{'stage':<12}{'ms':>9}{'bound ms':>10}{'ratio':>8}  work"]
    for stage in dict.fromkeys((*found.stages_ms, *found.bounds)):
        out.append(_row(stage, found.stages_ms.get(stage), found.bounds.get(stage)))
    out.append(_row("whole frame", found.frame_ms, Bound(found.bound_ms, {})))
    out.append(_row("CPU / thread", found.cpu_ms / found.threads, Bound(found.bound_ms, {})))
    if (q := found.queries) is not None:
        share = f"{100 * q.stale_share:.2f} % of the static receivers are stale"
        out.append(f"{share}; {q.count:,.0f} queries of {q.us_per_query:.2f} us each")
        out.append(f"full estimate {q.full_estimate_ms:.0f} ms, times that share {q.allowed_ms:.2f} ms")
    return out


def _row(name: str, ms: float | None, bound: Bound | None) -> str:
    text = f"{name:<12}" + (f"{ms:9.3f}" if ms is not None else " " * 9)
    if bound is None:
        return text
    ratio = f"{ms / bound.ms:8.1f}" if ms is not None and bound.ms else " " * 8
    work = (f"{_amount(n, unit)} at {_amount(rate, unit)}/s" for unit, (n, rate) in bound.work.items())
    return f"{text}{bound.ms:10.3f}{ratio}  {', '.join(work)}".rstrip()


def _amount(n: float, unit: str) -> str:
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if n >= factor:
            return f"{n / factor:.3g} {prefix}{'B' if unit == 'bytes' else ' ' + unit}"
    return f"{n:.0f} {'B' if unit == 'bytes' else unit}"


# Work of a frame -----------------------------------------------------------------------------------------


class Work(NamedTuple):
    """One kind of work of one stage."""

    stage: str
    unit: str  # "rays", "disc tests", "crossings", "bytes"
    count: int  # units in the frame
    batch: int  # units per call of run(), on all threads
    run: Callable[[], object]


def work_of_frame(solver: Solver, poses) -> list[Work]:
    """Compute the frame at `poses` and return its work, by stage."""
    solver.move_all(poses)
    threads = solver.model.threads
    vertices = solver.frame.segments + solver.frame.photons
    changes, row = solver.frame.changes, sum(a.itemsize * a[0].size for a in empty_segments(1))
    receivers = len(solver.irradiance)
    estimate = estimate_of(solver)
    moved = [
        ("scan", 12 * vertices),
        ("suffixes", row * changes.new_segments),
        ("estimate", 2 * SUM_BYTES * receivers + VERTEX_BYTES * changes.old_segments),
        ("read out", (2 * SUM_BYTES + 8) * receivers),
    ]
    if isinstance(estimate, PhotonMap):  # a query of k nearest hits reads k hits at the least
        moved.append(("estimate", (estimate.stale + _on_mobiles(solver)) * solver.setting.neighbours * HIT_BYTES))
    work = [w for w in _rays(solver) if w.count]
    work += [copied(stage, size, threads) for stage, size in moved if size]
    if searches := _searches(solver):
        tests = sum(candidates(discs, over) for discs, over, _ in searches)
        crossings = sum(found for _, _, found in searches) + _looked_up(solver)
        work += [tested(tests, threads), added(crossings, threads)]
    elif estimate.on_faces:
        hits = changes.old_segments + changes.new_segments
        work.append(added(3 * hits, threads))  # each hit adds to three corners of its face
    return work


def estimate_of(solver: Solver) -> Estimator:
    """Return the estimator of the solver's frames."""
    return solver.frame.background.estimate


def full_estimate(solver: Solver) -> Callable[[], None]:
    """Return a call that estimates all static receivers from the background, as the first frame does."""
    twin = ESTIMATORS[solver.setting.estimator](solver.model, solver.setting)
    for _ in twin.build():
        pass
    photons = solver.frame.photons
    paths = solver.frame.store.subset(photons)[0]
    for first in range(0, photons, CHUNK):
        last = min(first + CHUNK, photons)
        twin.add_background(segments_of(paths, first, last), 0)

    def run() -> None:
        for _ in twin.prepare(photons):
            pass

    return run


# Rays and searches of a frame ----------------------------------------------------------------------------


def _searches(solver: Solver) -> list[tuple[Discs, Lines, int]]:
    """Return discs, lines and number of disc intersections of each search of the last frame; none without discs."""
    model, change = solver.model, solver.frame.change
    out = []
    segments_of_objects = change.new_suffixes, *change.near_mobiles  # mobiles that gather are not searched
    for o, (search, segments) in enumerate(zip(estimate_of(solver).searches, segments_of_objects, strict=False)):
        over = lines(segments, change.at.rotation[o], change.at.position[o], model, solver.setting.radius)
        out.append((search.discs, over, search_run(search, over)()))
    return out


def _looked_up(solver: Solver) -> int:
    """Return the number of disc intersections of removed suffixes, which frames look up in a cache."""
    model, removed = solver.model, solver.frame.change.removed_suffixes.segments(solver.model.threads)
    over = lines(removed, model.static.rotation[0], model.static.position[0], model, solver.setting.radius)
    return search_run(estimate_of(solver).searches[0], over)()


def _rays(solver: Solver) -> list[Work]:
    """Return the rays of the last frame: along candidates for cuts, and along new suffixes, each also past mobiles."""
    model, frame = solver.model, solver.frame.change
    paths, coarse = solver.frame.store.subset(frame.photons)
    wanted = estimate_of(solver).wanted(frame.at, mobiles=bool(frame.near_mobiles))
    rows = candidate_segments(model, coarse, frame.at, wanted, ScanBuffers())
    near = segments_at(paths, *rows, model.threads)
    work = [_cast(solver, "suffixes", 0, *_as_rays(solver, 0, frame.new_suffixes))]
    for stage, segments in (("cuts", near), ("suffixes", frame.new_suffixes)):
        pass_by = select(model, frame.at, segments.origin, segments.end, -PAD * model.world.size, wanted.boxes[:0])
        for o in range(1, len(pass_by)):
            work.append(_cast(solver, stage, o, *_as_rays(solver, o, take(segments, np.flatnonzero(pass_by[o])))))
    return work


def _as_rays(solver: Solver, o: int, segments: Segments):
    """Return origins, directions and limits of segments in object o's space, lifted off their origins."""
    model, at = solver.model, solver.frame.change.at
    way = segments.end.astype(np.float64) - segments.origin
    length = np.maximum(np.sqrt((way * way).sum(axis=1)), 1e-30)
    d = way / length[:, None]
    origins, directions = segments.origin + LIFT * np.abs(segments.origin).max(axis=1, keepdims=True) * d, d
    limits = np.full(len(length), FAR * model.world.size) if o == 0 else length
    return *rays_to_object(at, o, origins.astype(np.float32), directions.astype(np.float32)), limits


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


# Disc tests and intersections ---------------------------------------------------------------------------


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


def candidates(discs: Discs, over: Lines) -> int:
    """Return the number of disc tests for lines in a uniform grid with cells of CELL_RADII radii.

    A two-sided surface counts as one disc. Occupancy is sampled at POINTS points of each line.
    """
    listed = np.flatnonzero(to_list(discs))
    if not len(listed) or not len(over.low):
        return 0
    cell, corner, shape, count = discs_in_cells(discs, listed, CELL_RADII)
    origin, direction = over.origin.astype(np.float64), over.direction.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = (np.stack([corner, corner + shape * cell])[:, None] - origin) / direction
    first = np.maximum(over.low, np.nan_to_num(walls.min(axis=0), nan=-np.inf).max(axis=1))
    length = np.maximum(np.minimum(over.high, np.nan_to_num(walls.max(axis=0), nan=np.inf).min(axis=1)) - first, 0)
    inside = length > 0
    origin, direction, first, length = origin[inside], direction[inside], first[inside], length[inside]
    cells, held = 1 + np.abs(direction).sum(axis=1) * length / cell, 0.0
    for k in range(POINTS):
        at = origin + (first + (k + 0.5) / POINTS * length)[:, None] * direction
        at = np.floor((at - corner) / cell).astype(np.int64).clip(0, shape - 1)
        held = held + count[np.ravel_multi_index(tuple(at.T), tuple(shape))]
    return int((cells * held / POINTS).sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scene")
    parser.add_argument("--photons", type=int, help="(default: the scene's)")
    parser.add_argument("--estimator", choices=ESTIMATORS)
    parser.add_argument("--no-control", dest="control", action="store_false", help="without artifact control")
    parser.add_argument("--frames", type=int, default=100, help="timed frames (default 100)")
    a = parser.parse_args()
    settings = Settings(a.scene, photons=a.photons, estimator=a.estimator, control=a.control, light="photons")
    with Bar() as bar:
        compile_kernels(bar)
        solver = make_solver(open_moving_scene(settings), settings)
        solve(solver, bar)
        found = measure(solver, a.frames, bar)
        copy = copied("", COPY_BYTES, found.threads)
    say(table(found))
    say([f"copying {1e-9 * copy.batch / best_seconds(copy.run):.1f} GB/s, read and written"])


if __name__ == "__main__":
    main()

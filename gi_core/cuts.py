"""What a pose changes: photons cut by mobiles, the tails they lose, the branches they gain (fig. 2.2).

Computed each frame from the background alone, never from the last frame, so nothing drifts. A photon
keeps its *head* up to the first cut of its background path; the *tail* behind it is taken out; the
*branch* reflected off the mobile is put in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.accelerator import Transforms, passes_box, to_local
from gi_core.fixed_point import MAX_SEGMENTS
from gi_core.jit import kernel
from gi_core.model import Model
from gi_core.near_scan import PAD, Coarse, Room, find_near
from gi_core.paths import NONE, PathVertices, Segments, concatenate, empty_segments, interval, segments_at, take
from gi_core.photon_trace import (
    Fates,
    Rays,
    advance,
    emitted_rays,
    no_flux,
    scatter_all,
)
from gi_core.tails import Tails, no_tails
from gi_core.threads import run_ranges
from gi_core.two_level import CUT_PAD, nearest_mobile

CUT_GRAIN = 2048  # segments a thread
FOLLOW_GRAIN = 512  # photons a thread: a bounce costs some 60 us of Python, however few there are


class Wanted(NamedTuple):
    """Which current segments an estimator asks for, besides what changes."""

    reach: float  # of a disc on a mobile [m]: segments that come so near to its box
    boxes: np.ndarray  # (b, 2, 3) float64 [m], corners low and high: segments that pass one of these
    around: np.ndarray  # (mobiles,) float64 [m] round the middle of each: nothing in the boxes is farther off

    @classmethod
    def near_mobiles(cls, model: Model, reach: float) -> Wanted:
        """Return what an estimator wants that looks `reach` [m] round mobiles only."""
        return cls(reach, np.empty((0, 2, 3)), np.zeros(model.surfaces.objects - 1))


class Frame(NamedTuple):
    """Everything about the current poses that differs from the background."""

    at: Transforms
    photons: int
    heads: Segments  # of cut photons: the segment that a mobile cuts, up to the cut
    tails: Tails  # what they lose: the rest of that segment and all later ones
    branches: Segments  # what they gain, from the mobile onwards
    near: tuple[Segments, ...]  # a mobile: every current segment that may cross a disc on it
    beside: Segments  # every current segment that passes one of the boxes wanted
    fates: Fates  # of all photons at these poses, less those of the background


def change(
    model: Model, paths: PathVertices, coarse: Coarse, at: Transforms, seed: int, wanted: Wanted, room: Room, clock
) -> Frame:
    """Find what the mobiles at `at` change of the background.

    `paths` and `coarse` hold the same photons; `clock(stage)` is called as each stage ends.
    """
    photons = len(paths.offsets) - 1
    if photons == 0 or len(at.position) == 1:
        nothing = empty_segments(0)
        tails, near = no_tails(paths, model.eps), (nothing,) * (len(at.position) - 1)
        return Frame(at, photons, nothing, tails, nothing, near, nothing, no_flux())

    # Find the first segment of each photon that any mobile cuts.
    margin = np.maximum(wanted.reach, wanted.around - model.world.sphere_radius[1:])
    rows = find_near(model.world, model.grid, coarse, at, margin, room, model.threads)
    clock("scan")
    near = segments_at(paths, model.eps, *rows, model.threads)
    cut, cut_side = _cuts(model, at, near)
    first_cut = _first_of_each(near.photon, np.flatnonzero(cut_side != NONE))

    clock("cuts")

    # Split those photons into head and tail, and follow them off the mobile.
    high = cut[first_cut] + model.eps
    heads = take(near, first_cut)._replace(high=high, cut_side=cut_side[first_cut])
    tails = Tails(paths, model.eps, heads.photon, rows[1][first_cut], high)
    fates = no_flux()
    hit, _, rays = scatter_all(model.world, at, seed, heads, cut[first_cut], fates)
    heads = heads._replace(hit=hit)
    branches = follow_all(model, at, seed, rays, fates)
    _subtract_background_fates(tails, fates)

    clock("branches")

    # Collect what mobile receivers can see: untouched background nearby, heads, branches.
    alive = _before_cut(near.photon, near.bounce, heads.photon, heads.bounce)
    whole = np.ones(heads.size, bool), np.ones(branches.size, bool)
    current = [(near, alive), (heads, whole[0]), (branches, whole[1])]
    collected = _near_each(model, at, current, wanted.reach), _in_boxes(model, current, wanted.boxes)
    clock("mobiles")
    return Frame(at, photons, heads, tails, branches, *collected, fates)


def _cuts(model: Model, at: Transforms, near: Segments) -> tuple[np.ndarray, np.ndarray]:
    """Return what nearest_mobile() does, a share of the segments a thread."""
    cut, cut_side = np.empty(near.size, np.float32), np.empty(near.size, np.int32)

    def work(_, first, last):
        part = slice(first, last)
        lines = near.origin[part], near.end[part], near.start_side[part]
        cut[part], cut_side[part] = nearest_mobile(model.accelerator, model.world, at, *lines)

    run_ranges(work, near.size, model.threads, CUT_GRAIN)
    return cut, cut_side


def _first_of_each(photon: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the first of the rows of each photon; rows are photon-major already."""
    p = photon[rows]
    return rows[np.concatenate([[True], p[1:] != p[:-1]])] if len(rows) else rows


def _before_cut(photon, bounce, cut_photon, cut_bounce) -> np.ndarray:
    """Return (n,) bool: the segment is not cut and not behind a cut. Both lists are photon-major."""
    if not len(cut_photon):
        return np.ones(len(photon), bool)
    k = np.minimum(np.searchsorted(cut_photon, photon), len(cut_photon) - 1)
    return (cut_photon[k] != photon) | (bounce < cut_bounce[k])


def follow_all(model: Model, at: Transforms, seed: int, rays: Rays, fates: Fates) -> Segments:
    """Do what follow() does, a share of the photons a thread."""

    def work(_, first, last):
        part = no_flux()
        return follow(model, at, seed, Rays(*(a[first:last] for a in rays)), part), part

    results = run_ranges(work, len(rays.photon), model.threads, FOLLOW_GRAIN)
    for _, part in results:
        for total, more in zip(fates, part, strict=True):
            total += more
    return concatenate([segments for segments, _ in results])


def follow(model: Model, at: Transforms, seed: int, rays: Rays, fates: Fates) -> Segments:
    """Trace rays against static part and mobiles until all have ended; return their segments."""
    parts = []
    while len(rays.photon):
        step = advance(model.accelerator, model.world, at, seed, rays, fates)
        parts.append(_segments(model, rays, step))
        rays = step.rays
    return concatenate(parts)


def _segments(model: Model, rays: Rays, step) -> Segments:
    out = empty_segments(len(rays.photon))._replace(
        origin=rays.origin, end=step.end, flux=rays.flux, start_side=rays.side, end_side=step.end_side,
        cut_side=step.cut_side, hit=step.hit, photon=rays.photon, bounce=rays.bounce,
    )  # fmt: skip
    _intervals(rays.origin, step.end, step.end_side, step.cut, step.cut_side, model.eps, out.low, out.high)
    return out


@kernel
def _intervals(origin, end, end_side, cut, cut_side, eps, low, high):
    for k in range(len(low)):
        o, e = origin[k], end[k]
        x, y, z = np.float64(e[0]) - o[0], np.float64(e[1]) - o[1], np.float64(e[2]) - o[2]
        length = np.float32(np.sqrt(x * x + y * y + z * z))
        low[k], high[k] = interval(length, end_side[k] != NONE, eps)
        if cut_side[k] != NONE:
            high[k] = cut[k] + eps


def current_segments(model: Model, at: Transforms, seed: int, first: int, count: int) -> tuple[Segments, Fates]:
    """Trace photons first .. first + count - 1 from scratch, with the mobiles where they are.

    Knows nothing of background, cuts or tails: what every frame must equal.
    """
    fates = no_flux()
    return follow(model, at, seed, emitted_rays(model.emitters, seed, first, count, fates), fates), fates


def _near_each(model: Model, at: Transforms, parts, margin: float) -> tuple[Segments, ...]:
    """Return for each mobile the segments that pass its bounding box, padded by the reach of a disc.

    `parts`: pairs of Segments and (n,) bool, which of them are current.
    """
    world, out = model.world, []
    for o in range(1, len(at.position)):
        pad = margin + (PAD + CUT_PAD) * world.size
        box = world.box_low[o], world.box_high[o]
        passing = (
            np.flatnonzero(_pass(p.origin, p.end, current, at.rotation[o], at.position[o], *box, pad))
            for p, current in parts
        )
        out.append(concatenate([take(p, rows) for (p, _), rows in zip(parts, passing, strict=True)]))
    return tuple(out)


def _in_boxes(model: Model, parts, boxes: np.ndarray) -> Segments:
    """Return the segments that pass one of the boxes; `parts` as for _near_each()."""
    if not len(boxes):
        return empty_segments(0)
    at, pad = model.static, CUT_PAD * model.world.size
    out = []
    for p, current in parts:
        passing = np.zeros(p.size, bool)
        for box in boxes:
            passing |= _pass(p.origin, p.end, current, at.rotation[0], at.position[0], *box, pad)
        out.append(take(p, np.flatnonzero(passing)))
    return concatenate(out)


@kernel
def _pass(origin, end, current, R, p, low, high, pad):
    out = np.empty(len(origin), np.bool_)
    for k in range(len(origin)):
        ox, oy, oz = to_local(R, origin[k, 0] - p[0], origin[k, 1] - p[1], origin[k, 2] - p[2])
        ex, ey, ez = to_local(R, end[k, 0] - p[0], end[k, 1] - p[1], end[k, 2] - p[2])
        out[k] = current[k] and passes_box(ox, oy, oz, ex, ey, ez, low, high, pad)
    return out


def _subtract_background_fates(tails: Tails, fates: Fates) -> None:
    """Take what the background path did with the flux of cut photons, behind the cut, out of `fates`."""
    sums, paths = np.zeros((3, 3), np.int64), tails.paths
    _fates_behind(paths.offsets, paths.side, paths.flux, tails.photon, tails.vertex, sums)
    for total, part in zip((fates.absorbed, fates.escaped, fates.truncated), sums, strict=True):
        total -= part


@kernel
def _fates_behind(offsets, side, flux, photons, vertices, sums):
    for j in range(len(photons)):
        end = offsets[photons[j] + 1] - 1
        for k in range(vertices[j] + 1, end + 1):
            fate = 1 if side[k] < 0 else 0
            if k - offsets[photons[j]] >= MAX_SEGMENTS and side[k] >= 0:
                fate = 2
            for c in range(3):
                sums[fate, c] += flux[k - 1, c] - flux[k, c]

"""What a pose changes: photons cut by mobiles, the tails they lose, the branches they gain (fig. 2.2).

Computed each frame from the background alone, never from the last frame, so nothing drifts. A photon
keeps its *head* up to the first cut of its background path; the *tail* behind it is taken out; the
*branch* reflected off the mobile is put in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.fixed_point import MAX_SEGMENTS
from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges
from gi_core.geometry.sides import NONE
from gi_core.model import Model
from gi_core.photons.paths import PathVertices, Segments, concatenate, empty_segments, segments_at, take
from gi_core.photons.trace import Fates, add_to, emitted_rays, follow, no_flux, reflected
from gi_core.rays.accelerator import Transforms
from gi_core.rays.embree import new_ray
from gi_core.rays.two_level import nearest_mobile
from gi_core.retrace.broad_phase import Coarse, Room, find_near
from gi_core.retrace.select_segments import passing, picked
from gi_core.retrace.tails import Tails, no_tails

CUT_GRAIN = 2048  # segments a thread
FOLLOW_GRAIN = 128  # photons a thread


class Wanted(NamedTuple):
    """Which current segments an estimator asks for, besides what changes."""

    reach: float  # of a disc on a mobile [m]: segments that come so near to its box; 0 if no mobiles
    boxes: np.ndarray  # (b, 2, 3) float64 [m], corners low and high: segments that pass one of these
    around: np.ndarray  # (mobiles,) float64 [m] round the middle of each: nothing in the boxes is farther off
    mobiles: bool = True  # or nobody asks for their light, nor for what passes them

    @classmethod
    def changes(cls, model: Model, mobiles: bool) -> Wanted:
        """Return what an estimator wants that reads light from where it ends: nothing but what changes."""
        return cls(0.0, np.empty((0, 2, 3)), np.zeros(model.surfaces.objects - 1), mobiles)


class Frame(NamedTuple):
    """Everything about the current poses that differs from the background."""

    at: Transforms
    photons: int
    heads: Segments  # of cut photons: the segment that a mobile cuts, up to the cut
    tails: Tails  # what they lose: the rest of that segment and all later ones
    branches: Segments  # what they gain, from the mobile onwards
    near: tuple[Segments, ...]  # a mobile, if wanted: every current segment that may cross a disc on it
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
        tails, near = no_tails(paths, model.eps), (nothing,) * (len(at.position) - 1) * wanted.mobiles
        return Frame(at, photons, nothing, tails, nothing, near, nothing, no_flux())

    # Find the first segment of each photon that any mobile cuts.
    rows = near_mobiles(model, coarse, at, wanted, room)
    clock("scan")
    near = segments_at(paths, model.eps, *rows, model.threads)
    cut, cut_side = _cuts(model, at, near)
    first_cut = _first_of_each(near.photon, np.flatnonzero(cut_side != NONE))
    clock("cuts")

    # Split those photons into head and tail, and follow them off the mobile.
    high = cut[first_cut] + model.eps
    heads = take(near, first_cut)._replace(high=high, cut_side=cut_side[first_cut])
    tails = Tails(paths, model.eps, heads.photon, rows[1][first_cut], high)
    hit, branches, fates = _branches(model, at, seed, heads, cut[first_cut], tails)
    heads = heads._replace(hit=hit)
    clock("branches")

    beside, on_mobiles = _seen(model, at, wanted, near, heads, branches)
    clock("mobiles")
    return Frame(at, photons, heads, tails, branches, on_mobiles, beside, fates)


def near_mobiles(model: Model, coarse: Coarse, at: Transforms, wanted: Wanted, room: Room):
    """Return photon and vertex (n,) int64 of the background segments that a frame looks at."""
    margin = np.maximum(wanted.reach, wanted.around - model.world.sphere_radius[1:])
    return find_near(model.world, coarse, at, margin, room, model.threads)


def _seen(model: Model, at: Transforms, wanted: Wanted, near: Segments, heads: Segments, branches: Segments):
    """Collect what receivers with new light can see: untouched background nearby, heads, branches.

    Returns the segments that pass the boxes wanted and, a mobile if wanted, those that pass near it.
    """
    if not wanted.mobiles and not len(wanted.boxes):
        return empty_segments(0), ()
    reach = wanted.reach if wanted.mobiles else None
    current = [(part, passing(model, at, part, reach, wanted.boxes)) for part in (near, heads, branches)]
    current[0][1][:] &= _before_cut(near.photon, near.bounce, heads.photon, heads.bounce)
    beside, *on_mobiles = (
        picked([(part, np.flatnonzero(sees[o])) for part, sees in current], model.threads)
        for o in range(len(at.position) if wanted.mobiles else 1)
    )
    return beside, tuple(on_mobiles)


def _cuts(model: Model, at: Transforms, near: Segments) -> tuple[np.ndarray, np.ndarray]:
    """Return what nearest_mobile() does, a share of the segments a thread."""
    cut, cut_side = np.empty(near.size, np.float32), np.empty(near.size, np.int32)

    def work(_, first, last):
        lines = (a[first:last] for a in (near.origin, near.end, near.start_side, cut, cut_side))
        nearest_mobile(model.accelerator.scenes, new_ray(), model.world, at, *lines)

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


def _branches(model: Model, at: Transforms, seed: int, heads: Segments, cut: np.ndarray, tails: Tails):
    """Follow cut photons off the mobiles, a share of them a thread.

    Returns where they hit them (n, 3) float32, their branches, and the fates of their flux, less those of the tails.
    """

    def work(_, first, last):
        part, fates = slice(first, last), no_flux()
        ended = Segments(*(a[part] for a in heads))
        hit, rays = reflected(model.world, at, seed, ended, cut[part], fates)
        branches = follow(model.accelerator, model.world, at, seed, model.eps, rays, fates)
        _subtract_background_fates(tails.of(part), fates)
        return hit, branches, fates

    hits, branches, fates = zip(*run_ranges(work, heads.size, model.threads, FOLLOW_GRAIN), strict=True)
    return np.concatenate(hits), concatenate(list(branches)), _together(fates)


def _together(fates) -> Fates:
    return Fates(*(sum(parts) for parts in zip(*fates, strict=True)))


def current_segments(model: Model, at: Transforms, seed: int, first: int, count: int) -> tuple[Segments, Fates]:
    """Trace photons first .. first + count - 1 from scratch, with the mobiles where they are.

    Knows nothing of background, cuts or tails: what every frame must equal.
    """

    def work(_, a, b):
        fates = no_flux()
        rays = emitted_rays(model.emitters, seed, first + a, b - a, fates)
        return follow(model.accelerator, model.world, at, seed, model.eps, rays, fates), fates

    segments, fates = zip(*run_ranges(work, count, model.threads, FOLLOW_GRAIN), strict=True)
    return concatenate(list(segments)), _together(fates)


class Heads:
    """Counts what photons carry where a mobile first cuts them, of current segments traced from scratch."""

    def __init__(self):
        self.flux = self.count = 0

    def split_off(self, segments: Segments) -> Segments:
        """Return those behind a cut; segments: all current ones of some photons."""
        cut = np.flatnonzero(segments.cut_side != NONE)
        photon = segments.photon - segments.photon.min(initial=0)
        first = np.full(photon.max(initial=-1) + 1, MAX_SEGMENTS, np.int64)
        np.minimum.at(first, photon[cut], segments.bounce[cut])
        heads = cut[segments.bounce[cut] == first[photon[cut]]]
        self.flux += int(segments.flux[heads].sum(dtype=np.int64))
        self.count += len(heads)
        return take(segments, segments.bounce > first[photon])


def _subtract_background_fates(tails: Tails, fates: Fates) -> None:
    """Take what the background path did with the flux of cut photons, behind the cut, out of `fates`."""
    sums, paths = np.zeros((3, 3), np.int64), tails.paths
    _fates_behind(paths.offsets, paths.side, paths.flux, tails.photon, tails.vertex, sums)
    add_to(fates, sums, -1)


@kernel
def _fates_behind(offsets, side, flux, photons, vertices, sums):
    """Add up what became of the flux behind some vertices: of what was lost on the way, and at the end."""
    for j in range(len(photons)):
        end = offsets[photons[j] + 1] - 1
        fate = 1 if side[end] < 0 else (2 if end - offsets[photons[j]] >= MAX_SEGMENTS else 0)
        for c in range(3):
            sums[0, c] += flux[vertices[j], c] - flux[end - 1, c]
            sums[fate, c] += flux[end - 1, c]

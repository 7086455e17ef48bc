"""Parts of the method, to be drawn: photon paths, one receiver's disc, and what the last frame computed again.

Copies, made on the solver's thread and read by the window. Places are relative to `Model.origins[0]`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.session.hemisphere_view import HemisphereView, hemisphere_view
from gi_core.base.vectors import dot
from gi_core.photons.flux_sums import CHUNK_BITS, NOT_ADDITIVE
from gi_core.photons.paths import segments_at
from gi_core.retrace.broad_phase import ScanBuffers
from gi_core.retrace.cuts import Wanted, change

if TYPE_CHECKING:
    from gi_core.photons.paths import PathVertices, Segments
    from gi_core.retrace.cuts import PoseChange
    from gi_core.solver import Solver

KEPT, REMOVED, ADDED = range(3)  # of segments: as without mobiles; blocked by one; from there on
BACKGROUND, CHANGED, ANEW, BY_PATHS = range(4)  # of receivers, see `recomputed`
SAMPLE = 120  # photons drawn, and as many again of those that mobiles cut
MOST_PHOTONS = 200_000  # that are searched for a disc
MOST_CROSSINGS = 400  # drawn


class MethodParts(NamedTuple):
    """Parts that the window asks for."""

    paths: bool = False
    receiver: int = -1  # whose disc; -1: none
    recomputed: bool = False


class Strokes(NamedTuple):
    """Segments to be drawn."""

    ends: np.ndarray  # (n, 2, 3) float64 [m], from the light on
    kind: np.ndarray  # (n,) int64: KEPT, REMOVED, ADDED
    hits: np.ndarray  # (n,) bool: the second end lies on a surface


class Disc(NamedTuple):
    """The disc of a receiver and the segments that cross it."""

    position: np.ndarray  # (3,) float64 [m]
    normal: np.ndarray  # (3,)
    radius: float  # [m]
    crossings: Strokes  # MOST_CROSSINGS at most
    counts: tuple[int, int, int]  # of all, by kind
    flux: np.ndarray  # (3, 3) int64, by kind, fixed-point units
    photons: int  # that were searched


class MethodView(NamedTuple):
    """The parts asked for, of the frame with this irradiance."""

    parts: MethodParts
    irradiance: np.ndarray  # (R, 3), to be compared by identity
    paths: Strokes | None = None
    disc: Disc | None = None
    hemisphere: HemisphereView | None = None  # over that disc, where it is glossy
    recomputed: np.ndarray | None = None  # (R,) uint8; None: not asked for, or no longer known


def method_view(solver: Solver, parts: MethodParts) -> MethodView:
    """Return the parts of the last frame; call it on the solver's thread."""
    frame = solver.frame
    view = MethodView(parts, solver.irradiance)
    if not frame.photons:
        return view
    if parts.paths or parts.receiver >= 0:
        searched = min(frame.photons, MOST_PHOTONS)
        changed = _change(solver, searched)
        paths = changed.removed_suffixes.paths
        view = view._replace(paths=_sample(solver, paths, changed) if parts.paths else None)
        if parts.receiver >= 0:
            disc = _disc(solver, parts.receiver, paths, changed)
            over = hemisphere_view(solver, parts.receiver, disc.crossings.ends, disc.crossings.kind)
            view = view._replace(disc=disc, hemisphere=over)
    return view._replace(recomputed=recomputed(solver) if parts.recomputed else None)


def _change(solver: Solver, photons: int) -> PoseChange:
    """Return the difference of the paths of the first photons from the background, at the frame's poses."""
    model, store = solver.model, solver.frame.store
    at, wanted = model.transforms(solver.frame.poses), Wanted.changes(model, False)
    paths, coarse = store.subset(photons)
    return change(model, paths, coarse, at, store.seed, wanted, ScanBuffers(), lambda stage: None)


def recomputed(solver: Solver) -> np.ndarray | None:
    """Return what the last frame computed again, per receiver (R,) uint8; None if its sums are no longer there.

    BACKGROUND: nothing. CHANGED: sums, by removed and added segments. ANEW: estimated from all segments near it.
    BY_PATHS: a mobile's receiver, by path tracing.
    """
    frame = solver.frame
    b, sums = frame.background, frame.evaluated
    if b is None or sums is None or sums is not b.evaluated:
        return None
    static = solver.surfaces.receiver_range(0)
    before, area = b.estimate.background(frame.photons)
    touched = np.repeat(sums.changed, 1 << CHUNK_BITS)[: len(sums.area)]
    out = np.full(len(sums.area), ANEW if not frame.paths else BY_PATHS, np.uint8)
    rows = touched[static]
    differs = (sums.sums[static] != before).any(axis=1) | (sums.area[static] != area)
    out[static] = np.where(rows & differs, CHANGED, BACKGROUND)
    out[static][rows & (sums.new_flux[static, 0] == NOT_ADDITIVE)] = ANEW
    return out


def _sample(solver: Solver, paths: PathVertices, changed: PoseChange) -> Strokes:
    """Return the paths of photons spread over all, and of some that mobiles cut."""
    removed, n = changed.removed_suffixes, len(paths.offsets) - 1
    whole = np.setdiff1d(np.unique(np.linspace(0, n - 1, SAMPLE).astype(np.int64)), removed.photon)
    rows = np.unique(np.linspace(0, max(len(removed.photon) - 1, 0), SAMPLE).astype(np.int64))
    rows = rows[: len(removed.photon)]
    cut = removed.photon[rows]
    photons, vertices = _vertices(paths.offsets[whole], paths.offsets[whole + 1] - 1, whole)
    before = _vertices(paths.offsets[cut], removed.vertex[rows], cut)
    eps, threads = removed.eps, solver.model.threads
    parts = [
        _strokes(segments_at(paths, eps, photons, vertices, threads), KEPT),
        _strokes(segments_at(paths, eps, *before, threads), KEPT),
        _strokes(_rows(changed.kept_prefixes, rows), KEPT),
        _strokes(removed.of(rows).segments(), REMOVED),
        _strokes(_rows(changed.new_suffixes, np.isin(changed.new_suffixes.photon, cut)), ADDED),
    ]
    return _joined(parts)


def _vertices(first: np.ndarray, last: np.ndarray, photons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return photon and vertex (n,) of the segments that leave vertices first .. last - 1 of each photon."""
    counts = last - first
    row = np.repeat(np.arange(len(counts)), counts)
    return photons[row], first[row] + np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)


def _rows(segments: Segments, rows: np.ndarray) -> Segments:
    return type(segments)(*(a[rows] for a in segments))


def _strokes(s: Segments, kind: int) -> Strokes:
    """Return segments from where they begin to where they end."""
    origin, end, hit = (a.astype(np.float64) for a in (s.origin, s.end, s.hit))
    along = end - origin
    length = np.sqrt(dot(along, along))
    begin = np.minimum(s.low / np.maximum(length, 1e-30), 1.0)
    ends = np.stack([origin + begin[:, None] * along, hit], axis=1)
    return Strokes(ends, np.full(len(origin), kind), s.hit_side >= 0)


def _joined(parts: list[Strokes]) -> Strokes:
    return Strokes(*(np.concatenate(a) for a in zip(*parts, strict=True)))


def _disc(solver: Solver, receiver: int, paths: PathVertices, changed: PoseChange) -> Disc:
    """Return the disc of a receiver, and the segments that cross it from its front."""
    model = solver.model
    o = int(np.searchsorted(model.surfaces.first_receiver[1:], receiver, side="right"))
    R, shift = changed.at.rotation[o], changed.at.position[o]
    position = R @ model.object_receivers.positions[receiver] + shift
    normal, radius = R @ model.object_receivers.normals[receiver], solver.setting.radius
    removed = changed.removed_suffixes
    last = np.zeros(len(paths.side), bool)
    last[paths.offsets[1:] - 1] = True
    origin = paths.position[:-1]
    rows, distance = _crossing(origin, paths.position[1:], position, normal, radius, model.eps, ~last[:-1])
    cut_at = np.full(len(paths.offsets), len(paths.side), np.int64)  # by photon: vertex of the cut segment
    cut_low = np.zeros(len(paths.offsets))
    cut_at[removed.photon], cut_low[removed.photon] = removed.vertex, removed.low
    photon = np.searchsorted(paths.offsets, rows, side="right") - 1
    gone = (rows > cut_at[photon]) | ((rows == cut_at[photon]) & (distance >= cut_low[photon]))
    new = changed.new_suffixes
    added, _ = _crossing(new.origin, new.hit, position, normal, radius, model.eps, np.ones(new.size, bool))
    segments = segments_at(paths, removed.eps, photon, rows, model.threads)
    counts, flux, parts = [], [], []
    for s, kind in ((_rows(segments, ~gone), KEPT), (_rows(segments, gone), REMOVED), (_rows(new, added), ADDED)):
        counts.append(s.size)
        flux.append(s.flux.sum(axis=0, dtype=np.int64))
        some = np.unique(np.linspace(0, max(s.size - 1, 0), MOST_CROSSINGS).astype(np.int64))[: s.size]
        parts.append(_strokes(_rows(s, some), kind))
    kept, lost, new_ones = counts
    joined = _joined(parts)
    return Disc(position, normal, radius, joined, (kept, lost, new_ones), np.array(flux), len(paths.offsets) - 1)


def _crossing(origin, end, position, normal, radius: float, eps, wanted) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (m,) of segments (n) that cross a disc from its front, and the distance (m,) [m] along them.

    Segments end eps behind their hits, as those of the disc search do.
    """
    a, b = (dot(p - position.astype(np.float32), normal.astype(np.float32)) for p in (origin, end))
    rows = np.flatnonzero(wanted & (a > 0) & (b <= eps) & (b < a))
    o, e = origin[rows].astype(np.float64), end[rows].astype(np.float64)
    length = np.sqrt(dot(e - o, e - o))
    a, b = dot(o - position, normal), dot(e - position, normal)
    t = a / np.maximum(a - b, 1e-30) * length
    off = o + (t / np.maximum(length, 1e-30))[:, None] * (e - o) - position
    inside = (t <= length + eps) & (dot(off, off) < radius * radius)
    return rows[inside], t[inside]

"""Parts of the method, to be drawn: photon paths, what counts at one receiver, what the last frame computed again.

Copies, made on the solver's thread and read by the window. Places are relative to `Model.origins[0]`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.session.counted import Counted, counted
from app.session.hemisphere_view import HemisphereView, hemisphere_view
from app.session.strokes import Strokes, joined, strokes
from gi_core.photons.flux_sums import CHUNK_BITS, NOT_ADDITIVE
from gi_core.photons.paths import ADDED, KEPT, REMOVED, rows_of, segments_at
from gi_core.retrace.broad_phase import ScanBuffers
from gi_core.retrace.cuts import Wanted, change

if TYPE_CHECKING:
    from gi_core.photons.paths import PathVertices
    from gi_core.retrace.cuts import PoseChange
    from gi_core.solver import Solver

BACKGROUND, CHANGED, ANEW, BY_PATHS = range(4)  # of receivers, see `recomputed`
SAMPLE = 120  # photons drawn, and as many again of those that mobiles cut
MOST_PHOTONS = 200_000  # that are searched for a receiver


class MethodParts(NamedTuple):
    """Parts that the window asks for."""

    paths: bool = False
    receiver: int = -1  # what the estimator counts there; -1: nothing
    recomputed: bool = False


class MethodView(NamedTuple):
    """The parts asked for, of the frame with this irradiance."""

    parts: MethodParts
    irradiance: np.ndarray  # (R, 3), to be compared by identity
    paths: Strokes | None = None
    counted: Counted | None = None  # at a receiver
    hemisphere: HemisphereView | None = None  # over it, where it is glossy
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
            here, across = counted(solver, parts.receiver, paths, changed)
            over = hemisphere_view(solver, parts.receiver, across.ends, across.kind)
            view = view._replace(counted=here, hemisphere=over)
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
    before, area = b.estimate.background(frame.photons, sums.direct)
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
    threads = solver.model.threads
    parts = [
        strokes(segments_at(paths, photons, vertices, threads), KEPT),
        strokes(segments_at(paths, *before, threads), KEPT),
        strokes(rows_of(changed.kept_prefixes, rows), KEPT),
        strokes(removed.of(rows).segments(), REMOVED),
        strokes(rows_of(changed.new_suffixes, np.isin(changed.new_suffixes.photon, cut)), ADDED),
    ]
    return joined(parts)


def _vertices(first: np.ndarray, last: np.ndarray, photons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return photon and vertex (n,) of the segments that leave vertices first .. last - 1 of each photon."""
    counts = last - first
    row = np.repeat(np.arange(len(counts)), counts)
    return photons[row], first[row] + np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)

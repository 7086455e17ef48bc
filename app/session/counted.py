"""The segments that the solver's estimator counts at one receiver, and those across its disc, to be drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.session.strokes import Strokes, joined, strokes
from gi_core.discs.region import EXTENSION
from gi_core.estimators.counting import Parts, Place, Rule, crossing
from gi_core.geometry.sides import NONE
from gi_core.photons.paths import ADDED, KEPT, REMOVED, rows_of, segments_at

if TYPE_CHECKING:
    from gi_core.photons.paths import PathVertices
    from gi_core.retrace.cuts import PoseChange
    from gi_core.solver import Solver

MOST_DRAWN = 400  # segments of each kind


class Counted(NamedTuple):
    """The segments that count at a receiver."""

    position: np.ndarray  # (3,) float64 [m]
    normal: np.ndarray  # (3,)
    outline: np.ndarray  # (m, 2, 3) float64 [m], lines round the area that the flux is divided by
    about: str  # their rule in words
    drawn: Strokes  # MOST_DRAWN of each kind at most
    counts: tuple[int, int, int]  # of all, by kind
    flux: np.ndarray  # (3, 3) int64, by kind, fixed-point units
    photons: int  # that were searched


def counted(solver: Solver, receiver: int, paths: PathVertices, changed: PoseChange) -> tuple[Counted, Strokes]:
    """Return what the solver's estimator counts at a receiver, and the segments across the receiver's disc.

    Those that an estimator with discs counts are both.
    """
    model, background, at = solver.model, solver.frame.background, changed.at
    o = int(np.searchsorted(model.surfaces.first_receiver[1:], receiver, side="right"))
    R, shift = at.rotation[o], at.position[o]
    position, normal = (R @ a[receiver] for a in (model.object_receivers.positions, model.object_receivers.normals))
    radius = background.setting.radius  # the solver's may be that of a frame to come
    area, searched = float(solver.frame.evaluated.area[receiver]), len(paths.offsets) - 1
    place = Place(receiver, o, position + shift, normal, radius, at, area, solver.frame.photons, searched)

    def find(rule: Rule, of_hits: bool = False, current: bool = False) -> Parts:
        return _parts(solver, paths, changed, rule, of_hits, current)

    parts, outline, about = background.estimate.counted(place, find)
    across = parts if background.estimate.searches else find(crossing(place, EXTENSION * radius))
    kept, lost, new = (s.size for s in parts)
    flux = np.array([s.flux.sum(axis=0, dtype=np.int64) for s in parts])
    here = place.position, normal, outline, about, _drawn(parts), (kept, lost, new), flux, searched
    return Counted(*here), _drawn(across)


def _drawn(parts: Parts) -> Strokes:
    """Return MOST_DRAWN strokes of each kind at most."""
    rows = (np.unique(np.linspace(0, max(s.size - 1, 0), MOST_DRAWN).astype(np.int64))[: s.size] for s in parts)
    kinds = zip(parts, rows, (KEPT, REMOVED, ADDED), strict=True)
    return joined([strokes(rows_of(s, selected), kind) for s, selected, kind in kinds])


def _parts(solver: Solver, paths: PathVertices, changed: PoseChange, rule: Rule, of_hits: bool, current: bool) -> Parts:
    """Return the segments that a rule selects, as `Find` has it."""
    removed, new = changed.removed_suffixes, changed.new_suffixes
    last = np.zeros(len(paths.side), bool)
    last[paths.offsets[1:] - 1] = True
    side = np.where(last[:-1], NONE, paths.side[1:])  # a line from the last vertex of a photon ends nowhere
    rows, distance = rule(paths.position[:-1], paths.position[1:], side)
    rows, distance = rows[~last[rows]], distance[~last[rows]]
    cut_at = np.full(len(paths.offsets), len(paths.side), np.int64)  # by photon: vertex of the cut segment
    cut_low = np.zeros(len(paths.offsets))
    cut_at[removed.photon], cut_low[removed.photon] = removed.vertex, removed.low
    photon = np.searchsorted(paths.offsets, rows, side="right") - 1
    gone = (rows > cut_at[photon]) | ((rows == cut_at[photon]) & (distance >= cut_low[photon]))
    # The part of a cut segment that is kept ends at a new hit, on the mobile.
    prefixes, added = (rows_of(s, rule(s.origin, s.hit, s.hit_side)[0]) for s in (changed.kept_prefixes, new))
    old = segments_at(paths, photon, rows, solver.model.threads)
    if of_hits:
        return rows_of(old, ~gone), rows_of(old, gone), joined([added, prefixes])
    if current:
        return joined([rows_of(old, ~gone & (rows != cut_at[photon])), prefixes]), rows_of(old, gone), added
    return rows_of(old, ~gone), rows_of(old, gone), added

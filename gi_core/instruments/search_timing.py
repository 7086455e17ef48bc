"""Timing of disc searches outside of frames: chosen discs and segments, one call per measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from gi_core.discs.region import whole_discs
from gi_core.discs.search import PRETESTS, SEARCHES, Search
from gi_core.discs.search.disc_index import DiscIndex
from gi_core.discs.search.predicate import Discs, Lines, lines
from gi_core.model import Model
from gi_core.photons.flux_sums import Sums
from gi_core.photons.paths import Segments, concatenate, segments_of
from gi_core.solver import Solver

__all__ = ["PRETESTS", "SEARCHES", "cells_of", "frame_lines", "photon_lines", "search_run", "static_discs"]


def cells_of(search: Search) -> tuple[float, float] | None:
    """Return the edge of a grid's cells [radii] and the discs per occupied cell; None for a search without a grid."""
    grid = search.grids[0] if isinstance(search, DiscIndex) else None
    return (grid.cell_radii, grid.discs_a_cell) if grid is not None else None


def static_discs(model: Model, radius: float, materials: Iterable[str] | None = None) -> Discs:
    """Return the discs of the static part's receivers, as whole discs; only those on the named materials take part.

    Receivers between two materials belong to both.
    """
    rows, s = model.surfaces.receiver_range(0), model.surfaces
    region = whole_discs(model, 0, radius)
    if materials is not None:
        named = [k for k, m in enumerate(model.scene.materials) if m.name in set(materials)]
        faces = np.flatnonzero(np.isin(model.scene.static.face_material, named))
        meant = np.zeros(rows.stop - rows.start, bool)
        for corners in (s.corner_front[faces].reshape(-1), s.corner_back[faces].reshape(-1)):
            meant[corners[corners >= 0]] = True
        region.area[~meant] = 0.0
    r = model.object_receivers
    positions, normals = (np.ascontiguousarray(a[rows], np.float32) for a in (r.positions, r.normals))
    return Discs(positions, normals, model.receiver_sides[rows], model.backs(0), np.float32(radius), region)


def photon_lines(solver: Solver, photons: int, radius: float) -> Lines:
    """Return all background segments of the first `photons` traced photons, prepared for static discs."""
    paths = solver.frame.store.subset(photons)[0]
    return _ready(solver, segments_of(paths, 0, photons), radius)


def frame_lines(solver: Solver, radius: float) -> Lines:
    """Return the removed and new suffixes of the solver's current frame, prepared for static discs."""
    change = solver.frame.change
    return _ready(solver, concatenate([change.removed_suffixes.segments(), change.new_suffixes]), radius)


def _ready(solver: Solver, segments: Segments, radius: float) -> Lines:
    at = solver.model.static
    return lines(segments, at.rotation[0], at.position[0], solver.model, radius)


def search_run(search: Search, over: Lines) -> Callable[[], int]:
    """Return a call that adds the lines to scratch sums on one thread; it returns the number of intersections."""
    sums = Sums.zeros(len(search.discs.positions), 3 + 3 * int(over.lamp.max(initial=0)))
    return lambda: search.accumulate(over, 1, sums)

"""Parts of the method to draw: photon paths, light counted at a receiver, receivers that the last frame computed again.

Copies, made on the solver's thread and read by the window. Places are relative to `Model.origins[0]`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from gi_core.base.random_numbers import basis
from gi_core.base.vectors import dot
from gi_core.bsdf.table import Tables
from gi_core.discs.region import EXTENSION
from gi_core.estimators.counting import Parts, Place, Rule, crossing
from gi_core.geometry.receivers import NONE
from gi_core.gloss.light import Directions, gloss_radiance, room_for
from gi_core.gloss.sharp import is_sharp
from gi_core.photons.flux_sums import CHUNK_BITS, NOT_ADDITIVE
from gi_core.photons.paths import ADDED, KEPT, REMOVED, PathVertices, Segments, rows_of, segments_at
from gi_core.retrace.cuts import PoseChange, Wanted, change
from gi_core.solver import Solver


class Strokes(NamedTuple):
    """Segments to be drawn. Places are relative to `Model.origins[0]`."""

    ends: np.ndarray  # (n, 2, 3) float64 [m], from the light on
    kind: np.ndarray  # (n,) int64: KEPT, REMOVED, ADDED of gi_core.photons.paths
    hits: np.ndarray  # (n,) bool: the second end lies on a surface


Arrays = TypeVar("Arrays", Segments, Strokes)


def strokes(s: Segments, kind: int) -> Strokes:
    """Return segments from where they begin to where they end."""
    origin, end, hit = (a.astype(np.float64) for a in (s.origin, s.end, s.hit))
    along = end - origin
    length = np.sqrt(dot(along, along))
    begin = np.clip(s.low / np.maximum(length, 1e-30), 0.0, 1.0)
    ends = np.stack([origin + begin[:, None] * along, hit], axis=1)
    return Strokes(ends, np.full(len(origin), kind), s.hit_side >= 0)


def joined(parts: Sequence[Arrays]) -> Arrays:
    """Return segments or strokes as one."""
    return type(parts[0])(*(np.concatenate(a) for a in zip(*parts, strict=True)))


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
    """Return the segments that the estimator counts at a receiver, and those that cross the receiver's disc.

    An estimator with discs counts the latter.
    """
    model, background, at = solver.model, solver.frame.background, changed.at
    o = int(model.surfaces.object_of(receiver))
    R, shift = at.rotation[o], at.position[o]
    position, normal = (R @ a[receiver] for a in (model.object_receivers.positions, model.object_receivers.normals))
    radius = background.setting.radius  # the solver's may be that of a frame to come
    area, searched = float(solver.frame.evaluated.area[receiver]), len(paths.offsets) - 1
    place = Place(receiver, o, position + shift, normal, radius, at, area, solver.frame.photons, searched)
    find = partial(_parts, solver, paths, changed)
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


def _parts(
    solver: Solver, paths: PathVertices, changed: PoseChange, rule: Rule, of_hits: bool = False, current: bool = False
) -> Parts:
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


class HemisphereView(NamedTuple):
    """Light and lobe of one receiver."""

    position: np.ndarray  # (3,) float64 [m], relative to `Model.origins[0]`
    frame: np.ndarray  # (3, 3) float64, rows: the frame's axes there
    cells: np.ndarray  # (CELLS, 6) float32, see Directions
    reflected: bool  # pictures show a reflection in their place, cells are black
    rays: np.ndarray  # (m, 3) float64, towards the light
    kind: np.ndarray  # (m,) int64: KEPT, REMOVED, ADDED
    lobe: np.ndarray  # (5,) float64
    along: np.ndarray  # (3,) float64, the tangent
    tables: Tables

    def lobe_towards(self, eye: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return the luminance (n,) that an eye (3,) sees by light of irradiance 1 from directions (n, 3)."""
        n, local = len(light), self.frame @ (eye - self.position)
        cells = np.ones((n, 1, 6), np.float32)
        cells[:, 0, 3:] = light
        alone, up = np.zeros((n, 3)), np.tile([0.0, 0.0, 1.0], (n, 1))
        directions = Directions(cells, np.zeros(1, np.int64), np.empty((0, 6), np.float32))
        lobes, tangents, out = np.tile(self.lobe, (n, 1)), np.tile(self.along, (n, 1)), room_for(n)
        one = np.ones((n, 3))
        gloss_radiance(
            directions, np.arange(n, dtype=np.int32), one, alone, up, lobes, tangents, self.tables, local, out
        )
        return out.mean(axis=1)


def hemisphere_view(solver: Solver, receiver: int, ends: np.ndarray, kind: np.ndarray) -> HemisphereView | None:
    """Return the hemisphere over a receiver of the last frame; None without gloss there.

    ends (m, 2, 3): of segments across its disc, from the light on; kind (m,): KEPT, REMOVED, ADDED.
    """
    light, s, model = solver.frame.gloss, solver.surfaces, solver.model
    row = -1 if light is None else int(np.searchsorted(light.rows, receiver))
    if light is None or row == len(light.rows) or light.rows[row] != receiver:
        return None
    owner = int(light.place[row])
    place = int(np.searchsorted(light.changed, owner))
    is_changed = place < len(light.changed) and light.changed[place] == owner
    cells = (light.cells[place] if is_changed else light.resting[owner]).copy()
    faces = (s.corner_front == receiver).any(axis=1) | (s.corner_back == receiver).any(axis=1)
    face = int(np.flatnonzero(faces & ~np.isnan(s.lobe[:, 4]))[0])
    if reflected := bool(is_sharp(s)[face]):
        cells[:, :3] = 0.0
    o, normal = int(s.object_of(receiver)), model.object_receivers.normals[receiver]
    at = model.transforms(solver.frame.poses)
    ax, ay, az, bx, by, bz = basis(*normal)
    axes = np.array([[ax, ay, az], [bx, by, bz], normal])  # in the object's space
    frame = axes @ at.rotation[o].T
    cells[:, 3:] = cells[:, 3:] @ axes.T
    towards = ends[:, 0] - ends[:, 1]
    towards = towards / np.maximum(np.linalg.norm(towards, axis=1), 1e-30)[:, None]
    position = at.rotation[o] @ model.object_receivers.positions[receiver] + at.position[o]
    along = axes @ s.tangent[face] if len(s.tangent) else np.array([1.0, 0.0, 0.0])
    return HemisphereView(position, frame, cells, reflected, towards @ frame.T, kind, s.lobe[face], along, s.tables)


BACKGROUND, CHANGED, ANEW, BY_PATHS = range(4)  # of receivers, see `recomputed`
MOST_SEARCHED_PHOTONS = 200_000  # that are searched for a receiver


class MethodParts(NamedTuple):
    """Parts that the window asks for."""

    paths: bool = False
    receiver: int = -1  # whose counted light is drawn; -1: none
    recomputed: bool = False


class MethodView(NamedTuple):
    """The parts asked for, of the frame with this irradiance."""

    parts: MethodParts
    irradiance: np.ndarray  # (R, 3), to be compared by identity
    paths: Strokes | None = None
    counted: Counted | None = None  # at a receiver
    hemisphere: HemisphereView | None = None  # over it, where it is glossy
    recomputed: np.ndarray | None = None  # (R,) uint8; None: not asked for


def method_view(solver: Solver, parts: MethodParts) -> MethodView:
    """Return the parts of the last frame; call it on the solver's thread."""
    frame = solver.frame
    view = MethodView(parts, solver.irradiance)
    if not frame.photons:
        return view
    if parts.paths or parts.receiver >= 0:
        model, store = solver.model, frame.store
        paths, coarse = store.subset(min(frame.photons, MOST_SEARCHED_PHOTONS))
        at, wanted = model.transforms(frame.poses), Wanted.changes(model, False)
        changed = change(model, paths, coarse, at, store.seed, wanted, lambda stage: None)
        paths = changed.removed_suffixes.paths
        view = view._replace(paths=_sample(solver, paths, changed) if parts.paths else None)
        if parts.receiver >= 0:
            here, across = counted(solver, parts.receiver, paths, changed)
            over = hemisphere_view(solver, parts.receiver, across.ends, across.kind)
            view = view._replace(counted=here, hemisphere=over)
    return view._replace(recomputed=recomputed(solver) if parts.recomputed else None)


def recomputed(solver: Solver) -> np.ndarray | None:
    """Return the work of the last frame per receiver, (R,) uint8; None before the first.

    BACKGROUND: nothing. CHANGED: sums, by removed and added segments. ANEW: estimated from all segments near it.
    BY_PATHS: a mobile's receiver, by path tracing.
    """
    frame = solver.frame
    if frame.background is not None and frame.evaluated is not frame.background.evaluated:
        twin = solver.twin()  # a measurement at rest has overwritten the sums
        twin.move_all({}, frame.photons, frame.paths or None)
        frame = twin.frame
    b, sums = frame.background, frame.evaluated
    if b is None or sums is None:
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
    photons_drawn = 120  # photons drawn, and as many again of those that mobiles cut
    removed, n = changed.removed_suffixes, len(paths.offsets) - 1
    whole = np.setdiff1d(np.unique(np.linspace(0, n - 1, photons_drawn).astype(np.int64)), removed.photon)
    rows = np.unique(np.linspace(0, max(len(removed.photon) - 1, 0), photons_drawn).astype(np.int64))
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

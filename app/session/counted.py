"""The segments that an estimator counts at one receiver: across its disc, or with hits near it or on its faces.

Of a disc under artifact control, the region that light can reach counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.session.strokes import ADDED, KEPT, REMOVED, Strokes, joined, rows_of, strokes
from gi_core.base.random_numbers import basis
from gi_core.base.vectors import dot
from gi_core.discs.region import COS, EXTENSION, SIN
from gi_core.estimators.photon_map import PhotonMap
from gi_core.estimators.tangent_plane import TangentPlane
from gi_core.geometry.sides import NONE
from gi_core.photons.hit_grid import OTHER_SIDE
from gi_core.photons.paths import Segments, segments_at

if TYPE_CHECKING:
    from gi_core.photons.paths import PathVertices
    from gi_core.rays.accelerator import Transforms
    from gi_core.retrace.cuts import PoseChange
    from gi_core.solver import Solver

MOST_DRAWN = 400  # segments of each kind
CORNERS = 48  # of a drawn disc


class Receiver(NamedTuple):
    """A receiver in the world."""

    row: int
    position: np.ndarray  # (3,) float64 [m]
    normal: np.ndarray  # (3,) unit
    radius: float  # [m], of the frame's setting


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


Parts = tuple[Segments, Segments, Segments]  # kept, removed, added
# Rows (m,) of lines (origin, end (n, 3), side (n,) at the end) that count, and the distance (m,) [m] along them.
Rule = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def counted(solver: Solver, receiver: int, paths: PathVertices, changed: PoseChange) -> tuple[Counted, Strokes]:
    """Return what the solver's estimator counts at a receiver, and the segments across the receiver's disc.

    Those that tangent_plane counts are both.
    """
    model, estimator = solver.model, solver.frame.background.estimate
    o = int(np.searchsorted(model.surfaces.first_receiver[1:], receiver, side="right"))
    R, shift = changed.at.rotation[o], changed.at.position[o]
    position = R @ model.object_receivers.positions[receiver] + shift
    setting = solver.frame.background.setting  # the solver's may be that of a frame to come
    here = Receiver(receiver, position, R @ model.object_receivers.normals[receiver], setting.radius)
    extension = np.float32(EXTENSION * setting.radius)

    def hits(rule: Rule) -> Parts:
        return _parts(solver, paths, changed, rule, of_hits=True)

    if isinstance(estimator, TangentPlane):
        found, outline, about = _accepted(solver, paths, changed, here, estimator)
    elif isinstance(estimator, PhotonMap):
        is_border = setting.border_correction and model.covered_share[receiver] < 1
        share = model.covered_share[receiver] if is_border else 1.0
        near = hits(_near(solver, here, changed.at, is_border))
        found, radius, about = _nearest(near, here, estimator, solver, len(paths.offsets) - 1, share)
        outline = circle(here, radius)
    else:
        faces, sides = _faces_around(solver, receiver)
        found = hits(lambda origin, end, side: _ends(np.isin(side, sides), origin, end))
        outline, about = _triangles(solver, faces, o, R, shift), f"hits on the {len(faces)} faces around"
    across = found if isinstance(estimator, TangentPlane) else _parts(
        solver, paths, changed, lambda origin, end, side: _crossing(origin, end, here, extension)
    )  # fmt: skip
    kept, lost, new = (s.size for s in found)
    flux = np.array([s.flux.sum(axis=0, dtype=np.int64) for s in found])
    known = position, here.normal, outline, about, _drawn(found), (kept, lost, new), flux, len(paths.offsets) - 1
    return Counted(*known), _drawn(across)


def _drawn(parts: Parts) -> Strokes:
    """Return MOST_DRAWN strokes of each kind at most."""
    rows = (np.unique(np.linspace(0, max(s.size - 1, 0), MOST_DRAWN).astype(np.int64))[: s.size] for s in parts)
    kinds = zip(parts, rows, (KEPT, REMOVED, ADDED), strict=True)
    return joined([strokes(rows_of(s, some), kind) for s, some, kind in kinds])


def _parts(
    solver: Solver, paths: PathVertices, changed: PoseChange, rule: Rule, of_hits: bool = False, current: bool = False
) -> Parts:
    """Return the segments that count: kept, removed and added ones.

    of_hits: by where they end. current: cut segments as they are now, ending on a mobile, in place of their old part.
    """
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


def _accepted(
    solver: Solver, paths: PathVertices, changed: PoseChange, here: Receiver, estimator: TangentPlane
) -> tuple[Parts, np.ndarray, str]:
    """Return the segments that count at the disc of a receiver, its outline and the rule in words.

    Some segments count that end before they cross it: see `predicate.accepts`.
    """
    model, at, behind = solver.model, changed.at, np.float32((2 + EXTENSION) * here.radius)
    o, disc, current = estimator.disc(here.row, at)

    def may_cross(origin, end, side):
        return _crossing(origin, end, here, behind)

    def counts(s: Segments) -> Segments:
        return rows_of(s, estimator.crossing(here.row, s, at))

    kept, removed, added = _parts(solver, paths, changed, may_cross, current=current)
    about = f"segments across the disc of {here.radius:.3g} m"
    if disc.regions.row[0] < 0:
        return (counts(kept), counts(removed), counts(added)), circle(here, here.radius), about
    outline = polygon(disc.regions.reach[0], model.object_receivers.normals[here.row], here.radius)
    about = f"{about}, as far as light can reach it (artifact control)"
    return (counts(kept), counts(removed), counts(added)), outline @ at.rotation[o].T + here.position, about


def _crossing(origin, end, here: Receiver, eps: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """The rule of a disc: lines that cross it from its front, and end at most eps [m] before it.

    Those of the disc search end a little behind their hits.
    """
    position, normal = here.position, here.normal
    a, b = (dot(p - position.astype(np.float32), normal.astype(np.float32)) for p in (origin, end))
    rows = np.flatnonzero((a > 0) & (b <= eps) & (b < a))
    o, e = origin[rows].astype(np.float64), end[rows].astype(np.float64)
    length = np.sqrt(dot(e - o, e - o))
    a, b = dot(o - position, normal), dot(e - position, normal)
    t = a / np.maximum(a - b, 1e-30) * length
    off = o + (t / np.maximum(length, 1e-30))[:, None] * (e - o) - position
    inside = (t <= length + eps) & (dot(off, off) < here.radius * here.radius)
    return rows[inside], t[inside]


def _ends(wanted: np.ndarray, origin, end) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of wanted lines (n,) bool, and their whole lengths."""
    rows = np.flatnonzero(wanted)
    along = end[rows].astype(np.float64) - origin[rows]
    return rows, np.sqrt(dot(along, along))


def _near(solver: Solver, here: Receiver, at: Transforms, is_border: bool) -> Rule:
    """The rule of a photon map before the k nearest: hits within the radius that do not face away."""
    s, world, model = solver.surfaces, solver.model.world, solver.model
    mine, point = model.receiver_sides[here.row], here.position.astype(np.float32)

    def rule(origin, end, side):
        off = end - point
        rows = np.flatnonzero((side != NONE) & (dot(off, off) <= np.float32(here.radius) ** 2))
        face, back = side[rows] >> 1, side[rows] & 1
        turned = np.einsum("nij,nj->ni", at.rotation[world.face_object[face]], world.normals[face])
        facing = np.where(back == 1, -1.0, 1.0) * (turned @ here.normal) > OTHER_SIDE
        if is_border:
            facing &= 2 * s.patch[face] + back == mine
        return _ends(np.isin(np.arange(len(side)), rows[facing]), origin, end)

    return rule


def _nearest(
    parts: Parts, here: Receiver, of: PhotonMap, solver: Solver, searched: int, share: float
) -> tuple[Parts, float, str]:
    """Return the hits that a photon map counts, their radius [m] and the rule in words.

    The k-th hit gives the radius alone. Where fewer photons are searched than the picture has, its own radius holds:
    share: of a disc that the surface covers.
    """
    far = [np.sqrt(((s.hit - here.position.astype(np.float32)) ** 2).sum(axis=1)) for s in parts]
    now, area = np.sort(np.concatenate([far[KEPT], far[ADDED]])), solver.frame.evaluated.area[here.row]
    if searched < solver.frame.photons and area > 0:  # 0: of a mobile that paths light
        radius = math.sqrt(area / (math.pi * share))
        about = f"hits within {radius:.3g} m, the radius of the picture's {solver.frame.photons:,} photons"
        kept, lost, new = (d <= radius for d in far)
    else:
        radius = float(now[of.k - 1]) if len(now) >= of.k else of.radius
        kept, lost, new = (d <= radius if of.textbook or len(now) < of.k else d < radius for d in far)
        about = f"hits, the {int(kept.sum() + new.sum()):,} nearest, within {radius:.3g} m"
    return (rows_of(parts[KEPT], kept), rows_of(parts[REMOVED], lost), rows_of(parts[ADDED], new)), radius, about


def _faces_around(solver: Solver, receiver: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the faces at a receiver, and their sides that it stands for."""
    s = solver.surfaces
    front, back = (np.flatnonzero((c == receiver).any(axis=1)) for c in (s.corner_front, s.corner_back))
    return np.concatenate([front, back]), np.concatenate([2 * front, 2 * back + 1])


def _triangles(solver: Solver, faces: np.ndarray, o: int, R: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return the edges (m, 2, 3) of faces of object o."""
    s = solver.surfaces
    corners = s.vertices[o][s.faces[o][faces - s.first_face[o]]] @ R.T + shift
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)


def polygon(reach: np.ndarray, normal: np.ndarray, radius: float) -> np.ndarray:
    """Return the rim (RAYS, 2, 3) [m], round a receiver, of the region (RAYS, 2) uint8 of its disc."""
    frame = np.array(basis(*normal)).reshape(2, 3)
    rim = radius / 255 * reach[:, 1, None] * (np.outer(COS, frame[0]) + np.outer(SIN, frame[1]))
    return np.stack([rim, np.roll(rim, -1, axis=0)], axis=1)


def circle(here: Receiver, radius: float) -> np.ndarray:
    """Return the rim of a disc round a receiver (CORNERS, 2, 3)."""
    n = here.normal / np.linalg.norm(here.normal)
    side = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    side /= np.linalg.norm(side)
    turn = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    rim = here.position + radius * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(n, side)))
    return np.stack([rim, np.roll(rim, -1, axis=0)], axis=1)

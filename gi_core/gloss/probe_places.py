"""Places for the probes of sharp gloss.

A ray that leaves a face is served by a probe whose place sees the point that the ray meets. Places for the static part
are chosen by the share of rays that they serve, of rays that leave sharp faces where photons meet them: surfaces
without light, such as the inside of a hollow wall, have none. A mobile has one in its middle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import components, group_of
from gi_core.base.nearest_points import nearest
from gi_core.base.vectors import dot
from gi_core.geometry.sides import NONE
from gi_core.geometry.surfaces import Surfaces
from gi_core.gloss.highlights import OFFSET
from gi_core.model import Model
from gi_core.photons.trace import trace_background
from gi_core.rays.accelerator import Transforms
from gi_core.rays.all_objects import nearest_in_world

WELD = 1e-4  # of the scene size: corners so near are one
PROBES = 6  # of the static part, at most
LEAST_GAIN = 0.01  # of all rays: what a further probe must serve better
ALIKE = 0.98  # of the most rays: with so many, the place of the largest clearance wins
SLACK = 0.1  # of its rays: a compact part keeps its own probe though another serves so many more
COMPACT = 0.25  # of the scene size: larger connected parts may have a probe per smooth piece
PLACES = 48  # free places that are tried, and middles of connected parts
PHOTONS, POINTS, RAYS = 2048, 2048, 4  # of a pilot trace, of their hits at most, and rays from each
AROUND, AMPLE = 64, 0.05  # rays that measure a clearance, and the scene size's share that is enough
SEED = 0x9EF1EC7  # of the pilot
NEAR = 0.01  # of the scene size: two hits so close are one
INSIDE = 0.6  # of the box of a lone probe's faces: what is nearer to its place is left out. A ball hides up to 0.58


class Units(NamedTuple):
    """Pieces of the sharp surface of an object that share a probe each."""

    faces: np.ndarray  # (n,) int64 global
    unit: np.ndarray  # (n,) of each face
    part: np.ndarray  # (units,) connected part of each piece
    area: np.ndarray  # (units,) [m2]


class Rays(NamedTuple):
    """Rays that leave sharp faces, in the order of their points."""

    origins: np.ndarray  # (n, 3) float64 [m]
    directions: np.ndarray  # (n, 3) float64 unit
    distance: np.ndarray  # (n,) float64 [m] to the face that they meet, inf: none
    face: np.ndarray  # (n,) int32 global, -1: none
    unit: np.ndarray  # (n,)


class Place(NamedTuple):
    """A place for a probe, in the space of its object."""

    centre: np.ndarray  # (3,) float64 [m]
    half: np.ndarray  # (3,) float64 [m], half of the box that it leaves out, 0: none
    omitted: np.ndarray  # (k,) int64 global faces that it leaves out, sorted
    clearance: float = 0.0  # [m] to the nearest surface that it sees
    faces: np.ndarray = np.zeros(0, np.int64)  # (n,) global, which look into it
    seen: float = 0.0  # share of their rays that it serves


def places(model: Model, o: int, faces: np.ndarray, size: float) -> list[Place]:
    """Return the places of the probes of an object, for its sharp faces (n,) global; size [m]: of the scene."""
    s, units = model.surfaces, _units(model.surfaces, o, faces, size)
    at = model.static if o == 0 else model.transforms(model.start_poses())
    R, position = at.rotation[o], at.position[o]
    rays = _rays(model, at, units, o, size)
    if o:
        (place,) = _lone_places(s, units, o)
        seen = _serves(model, at, _placed(place, R, position), rays, size).mean()
        return [place._replace(faces=faces, seen=float(seen))]
    free, lone = _free_places(model, rays, size), _lone_places(s, units, o)
    weight = np.bincount(rays.unit, minlength=len(units.area))
    shares = [_shares(model, at, place, rays, units, size) for place in (*free, *lone)]
    every, share = [*free, *lone], np.stack(shares) / np.maximum(weight, 1)
    taken, place_of = _own_places(share, weight, units, lone, size)
    clearance = np.array([place.clearance for place in every])
    taken, place_of = _shared_places(share, weight, clearance, taken, place_of)
    bare = np.flatnonzero((place_of < 0) & (weight == 0))
    place_of[bare] = 0
    if len(bare) and len(rays.unit):  # no light: as the nearest piece with light
        low, high = _boxes(units.unit, s.vertices[o][s.faces[o][units.faces - s.first_face[o]]])
        place_of[bare] = place_of[rays.unit[nearest(rays.origins, (low + high)[bare] / 2)[1]]]
    out = []
    for j, k in enumerate(taken):
        mine = place_of == j
        if mine.any():
            seen = (share[k] * weight)[mine].sum() / max(weight[mine].sum(), 1e-300)
            out.append(every[k]._replace(faces=units.faces[mine[units.unit]], seen=float(seen)))
    return out


def _units(s: Surfaces, o: int, faces: np.ndarray, size: float) -> Units:
    """Return the pieces of sharp faces (n,) of an object: connected parts, of large ones each smooth piece.

    A mobile is one.
    """
    n = len(faces)
    if not n or o:
        whole = np.zeros(n, np.int64), np.zeros(min(n, 1), np.int64), np.full(min(n, 1), s.areas[faces].sum())
        return Units(faces, *whole)
    corners = s.faces[o][faces - s.first_face[o]]
    cell = np.round(s.vertices[o][corners.reshape(-1)] / (WELD * size)).astype(np.int64)
    place = group_of(list(cell.T)).reshape(-1, 3)
    links = np.stack([np.repeat(np.arange(n), 3), n + place.reshape(-1)], axis=1)
    part = components(links, n + int(place.max()) + 1)[:n]
    low, high = _boxes(part, s.vertices[o][corners])
    is_large = (high - low).max(axis=1) > COMPACT * size
    unit = group_of((part, np.where(is_large[part], s.patch[faces], -1)))
    of_unit = np.zeros(int(unit.max()) + 1, np.int64)
    of_unit[unit] = part
    return Units(faces, unit, of_unit, np.bincount(unit, s.areas[faces]))


def _boxes(group: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners low and high (groups, 3) of the boxes of grouped triangles (n, 3, 3)."""
    n = int(group.max()) + 1
    low, high = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
    np.minimum.at(low, group, corners.min(axis=1))
    np.maximum.at(high, group, corners.max(axis=1))
    return low, high


def _shares(model: Model, at: Transforms, place: Place, rays: Rays, units: Units, size: float) -> np.ndarray:
    """Return the number (units,) of rays that a place serves; one that leaves faces out serves only these."""
    own = np.isin(rays.unit, _omitted(place, units)) if len(place.omitted) else slice(None)
    serves = _serves(model, at, place, Rays(*(a[own] for a in rays)), size)
    return np.bincount(rays.unit[own], serves, minlength=len(units.area))


def _omitted(place: Place, units: Units) -> np.ndarray:
    return np.unique(units.unit[np.isin(units.faces, place.omitted)])


def _own_places(share: np.ndarray, weight: np.ndarray, units: Units, lone: list[Place], size: float):
    """Return the places (rows of share) that compact parts have for themselves, and their number (units,), -1: none.

    Near by, a probe has more pixels for what a part reflects: it may serve fewer rays by SLACK.
    """
    first = len(share) - len(lone)
    by_others = share[:first].max(axis=0, initial=0.0)
    taken: list[int] = []
    place_of = np.full(len(weight), -1)
    for k, place in enumerate(lone, first):
        mine = np.zeros(len(weight), bool)
        mine[_omitted(place, units)] = True
        mine &= place_of < 0
        lit = weight * mine
        is_compact = 2 * place.half.max() <= COMPACT * size
        if is_compact and lit.any() and lit @ (share[k] - by_others + SLACK) >= 0 and len(taken) < PROBES - 1:
            place_of[mine] = len(taken)
            taken.append(k)
    return taken, place_of


def _shared_places(share, weight, clearance: np.ndarray, taken: list[int], place_of: np.ndarray):
    """Add places that serve most rays of the pieces without a probe; arguments and result as of _own_places().

    Of places that serve nearly as many, it is that of the largest clearance [m]: near surfaces hide others.
    """
    rest, own = np.where(place_of < 0, weight, 0), len(taken)
    best = np.zeros(len(weight))
    while len(taken) < PROBES and (place_of < 0).any():
        gain = np.maximum(share - best, 0.0) @ rest
        if len(taken) > own and gain.max() <= LEAST_GAIN * weight.sum():
            break
        k = int(np.argmax(np.where(gain >= ALIKE * gain.max(), clearance, -1.0)))
        taken.append(k)
        best = np.maximum(best, share[k])
    shared = own + np.argmax(share[taken[own:]], axis=0) if len(taken) > own else place_of
    return taken, np.where((place_of < 0) & (weight > 0), shared, place_of)


def _placed(place: Place, R: np.ndarray, position: np.ndarray) -> Place:
    return place._replace(centre=R @ place.centre + position, half=np.abs(R) @ place.half)


def _lone_places(s: Surfaces, units: Units, o: int) -> list[Place]:
    """Return the middles of the largest connected parts; each leaves out its part, and others within that box."""
    corners = s.vertices[o][s.faces[o][units.faces - s.first_face[o]]]
    part = units.part[units.unit]
    low, high = _boxes(part, corners)
    middle, area = (low + high) / 2, np.bincount(part, s.areas[units.faces])
    out = []
    for p in np.argsort(-area)[:PLACES]:
        within = ((low[p] < middle) & (middle < high[p])).all(axis=1)
        within[p] = True
        out.append(Place(middle[p], (high[p] - low[p]) / 2, units.faces[within[part]]))
    return out


def _free_places(model: Model, rays: Rays, size: float) -> list[Place]:
    """Return places half-way along some of the rays."""
    rows = np.linspace(0, len(rays.unit) - 1, min(PLACES, len(rays.unit))).astype(int)
    half = 0.5 * np.minimum(rays.distance[rows], size)
    centres = rays.origins[rows] + half[:, None] * rays.directions[rows]
    around = np.random.default_rng(0).normal(size=(AROUND, 3))
    around /= np.sqrt(dot(around, around))[:, None]
    distance = _cast(model, model.static, np.repeat(centres, AROUND, axis=0), np.tile(around, (len(centres), 1)))[0]
    clearance = np.minimum(distance.reshape(-1, AROUND).min(axis=1), AMPLE * size)
    none = np.zeros(0, np.int64)
    return [Place(c, np.zeros(3), none, float(d)) for c, d in zip(centres, clearance, strict=True)]


def _rays(model: Model, at: Transforms, units: Units, o: int, size: float) -> Rays:
    """Return rays of a cosine distribution from the sharp faces of an object; a mobile has them from all over it."""
    s, rng = model.surfaces, np.random.default_rng(0)
    if o:
        end = np.cumsum(s.areas[units.faces])
        row = np.minimum(np.searchsorted(end, rng.random(POINTS) * end[-1]), len(end) - 1)
        points = s.vertices[o][s.faces[o][units.faces[row] - s.first_face[o]]].mean(axis=1)
        points, side = points @ at.rotation[o].T + at.position[o], np.zeros(POINTS, np.int64)
    else:
        points, face, side = _lit(model)
        place = np.searchsorted(units.faces, face)
        found = np.flatnonzero(units.faces[np.minimum(place, len(units.faces) - 1)] == face)
        found = found[np.linspace(0, len(found) - 1, min(POINTS, len(found))).astype(int)]
        row, points, side = place[found], points[found], side[found]
    row, points, side = (np.repeat(a, RAYS, axis=0) for a in (row, points, side))
    normal = (s.normals[units.faces[row]] @ at.rotation[o].T) * np.where(side > 0, -1.0, 1.0)[:, None]
    d = rng.normal(size=(len(row), 3))
    d = normal + d / np.maximum(np.sqrt(dot(d, d)), 1e-9)[:, None]
    d /= np.maximum(np.sqrt(dot(d, d)), 1e-9)[:, None]
    origins = points + OFFSET * size * normal
    return Rays(origins, d, *_cast(model, at, origins, d), units.unit[row])


def _lit(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where photons meet the static part: points (n, 3), global faces (n,) and sides (n,), 1 on the back."""
    given = model.accelerator, model.world, model.static, model.emitters
    paths = trace_background(*given, SEED, 0, PHOTONS)[0]
    hit = paths.side != NONE
    if len(hit):
        hit[paths.offsets[:-1]] = False  # where they start
    face, side = paths.side[hit] >> 1, paths.side[hit] & 1
    seen = (side == 0) | model.surfaces.two_sided[face]
    return paths.position[hit][seen].astype(np.float64), face[seen], side[seen]


def _cast(model: Model, at: Transforms, origins: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distance (n,) float64, inf: none, and face (n,) of the nearest hits."""
    far = np.full(len(d), np.inf, np.float32)
    t, face = nearest_in_world(model.accelerator, at, origins.astype(np.float32), d.astype(np.float32), far)
    return np.where(face < 0, np.inf, t), face


def _serves(model: Model, at: Transforms, place: Place, rays: Rays, size: float) -> np.ndarray:
    """Return (n,) bool: the place sees what a ray meets; the sky in the ray's direction where it meets nothing."""
    met = np.isfinite(rays.distance)
    way = rays.origins + np.where(met, rays.distance, 0.0)[:, None] * rays.directions - place.centre
    far = np.where(met, np.sqrt(dot(way, way)), np.inf)
    d = np.where(met[:, None], way / np.maximum(np.where(met, far, 1.0), 1e-9)[:, None], rays.directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        start = np.nanmin(np.where(d != 0, INSIDE * place.half / np.abs(d), np.inf), axis=1)
    reached = start.copy()
    going = np.arange(len(d))
    for _ in range(4):  # behind faces that are left out
        t, face = _cast(model, at, place.centre + reached[going, None] * d[going], d[going])
        reached[going] += t
        going = going[np.isin(face, place.omitted)]
        if not len(going):
            break
        reached[going] += OFFSET * size
    seen = (reached >= far - NEAR * size) & (start <= far) & ~np.isin(rays.face, place.omitted)
    return np.where(met, seen, np.isinf(reached))

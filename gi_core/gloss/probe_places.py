"""Places for the probes of sharp gloss: the middles of compact parts, and of the rooms around all others.

A ray that leaves a face is served by a probe whose place sees the point that the ray meets. Compact parts, and mobiles,
have a probe in their own middle that leaves them out. Places in rooms are chosen by the share of rays that they serve,
of rays that leave the other faces where photons meet them: surfaces without light, such as the inside of a hollow wall,
have none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import components, group_of
from gi_core.base.nearest_points import nearest
from gi_core.base.vectors import dot
from gi_core.geometry.sides import NONE
from gi_core.gloss.highlights import OFFSET
from gi_core.model import Model
from gi_core.photons.trace import trace_background
from gi_core.rays.accelerator import Transforms
from gi_core.rays.all_objects import nearest_in_world

WELD = 1e-4  # of the scene size: corners so near are one
PROBES = 6  # of the static part, at most
LEAST_GAIN = 0.01  # of all rays: what a further place in a room must serve better
COMPACT = 0.25  # of the scene size: larger connected parts look into the probes of rooms
PLACES = 48  # in rooms that are tried
PHOTONS, POINTS, RAYS = 2048, 2048, 4  # of a pilot trace, of their hits at most, and rays from each
SEED = 0x9EF1EC7  # of the pilot
NEAR = 0.01  # of the scene size: two hits so close are one
INSIDE = 0.6  # of the box of a part's faces: what is nearer to its place is left out. A ball hides up to 0.58


class Rays(NamedTuple):
    """Rays that leave sharp faces."""

    origins: np.ndarray  # (n, 3) float64 [m]
    directions: np.ndarray  # (n, 3) float64 unit
    distance: np.ndarray  # (n,) float64 [m] to the face that they meet, inf: none
    face: np.ndarray  # (n,) int32 global, -1: none
    row: np.ndarray  # (n,) int64, the face that they leave, among the sharp ones

    def at(self, rows: np.ndarray) -> Rays:
        """Return some of the rays."""
        return Rays(*(a[rows] for a in self))


class Place(NamedTuple):
    """A place for a probe, in the space of its object."""

    centre: np.ndarray  # (3,) float64 [m]
    half: np.ndarray  # (3,) float64 [m], half of the box that it leaves out, 0: none
    omitted: np.ndarray  # (k,) int64 global faces that it leaves out, sorted
    faces: np.ndarray  # (n,) int64 global, which look into it
    seen: float = 0.0  # share of their rays that it serves


def places(model: Model, o: int, faces: np.ndarray, size: float) -> list[Place]:
    """Return the places of the probes of an object, for its sharp faces (n,) global; size [m]: of the scene."""
    s = model.surfaces
    corners = s.vertices[o][s.faces[o][faces - s.first_face[o]]]
    if o:
        return [_of_mobile(model, o, faces, corners, size)]
    rays, part = _rays_where_light_is(model, faces, size), _parts(corners, size)
    low, high = _boxes(part, corners)
    middle, is_compact = (low + high) / 2, (high - low).max(axis=1) <= COMPACT * size
    out, left = [], np.ones(len(faces), bool)
    for p in np.argsort(-np.bincount(part, s.areas[faces])):
        inside = is_compact & ((low[p] < middle) & (middle < high[p])).all(axis=1)
        own = inside[part]
        mine = own & left
        if is_compact[p] and len(out) < PROBES - 1 and mine[rays.row].any():
            place = Place(middle[p], (high[p] - low[p]) / 2, faces[own], faces[mine])
            seen = _serves(model, model.static, place, rays.at(mine[rays.row]), size).mean()
            out.append(place._replace(seen=float(seen)))
            left &= ~mine
    if left.any():
        out += _in_rooms(model, faces, np.flatnonzero(left), rays.at(left[rays.row]), PROBES - len(out), size)
    return out


def _of_mobile(model: Model, o: int, faces: np.ndarray, corners: np.ndarray, size: float) -> Place:
    """Return the middle of a mobile's sharp faces of corners (n, 3, 3), with its share of rays from all over them."""
    s, at, rng = model.surfaces, model.transforms(model.start_poses()), np.random.default_rng(0)
    R, position, end = at.rotation[o], at.position[o], np.cumsum(s.areas[faces])
    row = np.minimum(np.searchsorted(end, rng.random(POINTS) * end[-1]), len(end) - 1)
    points = corners[row].mean(axis=1) @ R.T + position
    rays = _rays(model, at, row, points, s.normals[faces[row]] @ R.T, size)
    low, high = (corner[0] for corner in _boxes(np.zeros(len(faces), np.int64), corners))
    place = Place((low + high) / 2, (high - low) / 2, faces, faces)
    there = place._replace(centre=R @ place.centre + position, half=np.abs(R) @ place.half)
    return place._replace(seen=float(_serves(model, at, there, rays, size).mean()))


def _in_rooms(model: Model, faces: np.ndarray, rows: np.ndarray, rays: Rays, most: int, size: float) -> list[Place]:
    """Return places in rooms, at most so many, for faces[rows], which the rays leave: half-way along some of them.

    Of places that serve most rays, each smooth piece looks into the one that serves most of its own.
    """
    s, none = model.surfaces, np.zeros(0, np.int64)
    middles = s.vertices[0][s.faces[0][faces[rows]]].mean(axis=1)
    if not len(rays.row):  # no light: any place
        return [Place(middles.mean(axis=0), np.zeros(3), none, faces[rows])]
    piece = np.unique(s.patch[faces[rows]], return_inverse=True)[1].reshape(-1)
    of_ray = piece[np.searchsorted(rows, rays.row)]
    tried = np.linspace(0, len(rays.row) - 1, min(PLACES, len(rays.row))).astype(int)
    half = 0.5 * np.minimum(rays.distance[tried], size)[:, None]
    centres = rays.origins[tried] + half * rays.directions[tried]
    every = [Place(c, np.zeros(3), none, none) for c in centres]
    serves = np.stack([_serves(model, model.static, place, rays, size) for place in every])
    weight = np.bincount(of_ray, minlength=piece.max() + 1)
    counts = np.stack([np.bincount(of_ray, row, minlength=len(weight)) for row in serves])
    taken, best = [], np.zeros(len(weight))
    while len(taken) < most:
        gain = np.maximum(counts - best, 0.0).sum(axis=1)
        if taken and gain.max() <= LEAST_GAIN * len(rays.row):
            break
        taken.append(int(np.argmax(gain)))
        best = np.maximum(best, counts[taken[-1]])
    choice = np.argmax(counts[taken], axis=0)
    dark = np.flatnonzero(weight[piece] == 0)  # as the nearest face with light
    of_face = choice[piece]
    of_face[dark] = choice[of_ray[nearest(rays.origins, middles[dark])[1]]]
    out = []
    for j, k in enumerate(taken):
        mine, own = of_face == j, choice[of_ray] == j
        if mine.any():
            seen = float(serves[k, own].mean()) if own.any() else 0.0
            out.append(every[k]._replace(faces=faces[rows[mine]], seen=seen))
    return out


def _parts(corners: np.ndarray, size: float) -> np.ndarray:
    """Return the connected part (n,) int64 of each face of corners (n, 3, 3)."""
    n = len(corners)
    cell = np.round(corners.reshape(-1, 3) / (WELD * size)).astype(np.int64)
    place = group_of(list(cell.T)).reshape(-1, 3)
    links = np.stack([np.repeat(np.arange(n), 3), n + place.reshape(-1)], axis=1)
    return components(links, n + int(place.max()) + 1)[:n]


def _boxes(group: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners low and high (groups, 3) of the boxes of grouped triangles (n, 3, 3)."""
    n = int(group.max()) + 1
    low, high = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
    np.minimum.at(low, group, corners.min(axis=1))
    np.maximum.at(high, group, corners.max(axis=1))
    return low, high


def _rays_where_light_is(model: Model, faces: np.ndarray, size: float) -> Rays:
    """Return rays from where photons meet sharp faces (n,) of the static part, on the side that they meet."""
    s, given = model.surfaces, (model.accelerator, model.world, model.static, model.emitters)
    paths = trace_background(*given, SEED, 0, PHOTONS)[0]
    hit = paths.side != NONE
    if len(hit):
        hit[paths.offsets[:-1]] = False  # where they start
    face, back = paths.side[hit] >> 1, paths.side[hit] & 1 > 0
    row = np.minimum(np.searchsorted(faces, face), len(faces) - 1)
    met = np.flatnonzero((faces[row] == face) & (~back | s.two_sided[face]))
    met = met[np.linspace(0, len(met) - 1, min(POINTS, len(met))).astype(int)]
    normals = s.normals[face[met]] * np.where(back[met], -1.0, 1.0)[:, None]
    return _rays(model, model.static, row[met], paths.position[hit][met].astype(np.float64), normals, size)


def _rays(model: Model, at: Transforms, row: np.ndarray, points: np.ndarray, normals: np.ndarray, size: float) -> Rays:
    """Return RAYS rays of a cosine distribution from each of points (n, 3) [m], on faces row (n,) of normals (n, 3)."""
    row, points, normals = (np.repeat(a, RAYS, axis=0) for a in (row, points, normals))
    d = np.random.default_rng(0).normal(size=(len(row), 3))
    d = normals + d / np.maximum(np.sqrt(dot(d, d)), 1e-9)[:, None]
    d /= np.maximum(np.sqrt(dot(d, d)), 1e-9)[:, None]
    origins = points + OFFSET * size * normals
    return Rays(origins, d, *_cast(model, at, origins, d), row)


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

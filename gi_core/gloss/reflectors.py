"""Reflections for sharp gloss: planes of flat parts, and probes of the surroundings for all faces.

A plane shows the scene reflected in it, without error. A picture has room for few planes, those that cover most of it;
all other faces look into a probe: the surroundings of one place. A ray that leaves a face is served by a probe whose
place sees the point that the ray meets. Compact parts, and mobiles, have a probe in their own middle that leaves them
out. Places in rooms are chosen by the share of rays that they serve. These rays leave the other faces where photons
meet them, so surfaces without light, such as the inside of a hollow wall, have none.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import components, group_of
from gi_core.base.nearest_points import nearest
from gi_core.base.vectors import dot
from gi_core.geometry.surfaces import Surfaces
from gi_core.gloss.sharp import SharpLobe, lobe_classes, noise_factor, sharp_faces
from gi_core.model import Model
from gi_core.rays.accelerator import GAP, Transforms
from gi_core.rays.all_objects import nearest_in_world

MOST_PLANES = 64  # candidates per scene, the largest first
MOST_PROBES = 6  # of the static part, at most
PROBE_POINTS, PROBE_RAYS = 2048, 4  # of the pilot's hits at most, and rays from each
OMITTED_INSIDE = 0.6  # of the box of a part's faces: nearer faces are left out. A ball hides up to 0.58
BY_CELLS, PLANAR, PROBE = "cells", "planar", "probe"


class Plane(NamedTuple):
    """The plane of flat faces of one object, such as the tiles of a floor."""

    number: int  # of the scene's planes
    equation: np.ndarray  # (4,) float64 in the object's space: unit normal, and its product with a point of the plane


class Probe(NamedTuple):
    """A place from which faces of one object see their surroundings."""

    number: int  # of the scene's probes
    centre: np.ndarray  # (3,) float64 [m] in the object's space
    half: np.ndarray  # (3,) float64 [m], half of the box that it leaves out, 0: none
    seen: float  # share of the rays of its faces that it serves
    scene_size: float  # [m]


class Reflector(NamedTuple):
    """Faces of an object that show their reflections alike."""

    lobe: SharpLobe
    faces: np.ndarray  # (n,) int64 of the object
    plane: Plane | None
    probe: Probe
    omitted: frozenset[int]  # numbers of the probes that leave these faces out


def reflectors(model: Model) -> tuple[tuple[Reflector, ...], ...]:
    """Return the reflectors of each object of a model, none for objects without sharp gloss."""
    s = model.surfaces
    lobes, of_face = sharp_faces(s)
    if not lobes:
        return ((),) * s.objects
    size = model.scene_size
    planes, plane_of = _all_planes(s, of_face, size)
    probes: list[Probe] = []
    probe_of, omitted = np.full(len(of_face), -1), []
    for o in range(s.objects):
        faces = np.flatnonzero(of_face[s.face_range(o)] >= 0) + int(s.first_face[o])
        for place in places(model, o, faces, size) if len(faces) else ():
            probe_of[place.faces] = len(probes)
            probes.append(Probe(len(probes), place.centre, place.half, place.seen, size))
            omitted.append(place.omitted)
    kind = group_of((of_face, plane_of, probe_of, _sets(omitted, len(of_face))))
    out: list[list[Reflector]] = [[] for _ in range(s.objects)]
    sharp = np.flatnonzero(of_face >= 0)
    objects = np.searchsorted(s.first_face, sharp, side="right") - 1
    for o, k in np.unique(np.stack([objects, kind[sharp]], axis=1), axis=0):
        faces = sharp[(kind[sharp] == k) & (objects == o)]
        f = int(faces[0])
        plane = None if plane_of[f] < 0 else planes[plane_of[f]]
        without = frozenset(p for p, left_out in enumerate(omitted) if f in left_out)
        local = faces - int(s.first_face[o])
        out[o].append(Reflector(lobes[of_face[f]], local, plane, probes[probe_of[f]], without))
    return tuple(map(tuple, out))


class Ways(NamedTuple):
    """How pictures show the gloss of each face."""

    noise: np.ndarray  # (F,) float64, noise factor of the lobe, nan for diffuse faces
    way: np.ndarray  # (F,) object: BY_CELLS; PLANAR: by a plane where a picture has room for it; PROBE
    seen: np.ndarray  # (F,) float64, share of its rays that its probe serves, nan where it has none


def ways(model: Model) -> Ways:
    """Return the ways in which pictures show the gloss of a model."""
    s = model.surfaces
    noise, way = np.full(len(s.lobe), math.nan), np.full(len(s.lobe), BY_CELLS, object)
    seen = np.full(len(s.lobe), math.nan)
    for f, faces in lobe_classes(s):
        noise[faces] = noise_factor(s.lobe[f], s.tables)
    for o, own in enumerate(reflectors(model)):
        for r in own:
            faces = r.faces + int(s.first_face[o])
            way[faces], seen[faces] = PROBE if r.plane is None else PLANAR, r.probe.seen
    return Ways(noise, way, seen)


def _sets(omitted: list[np.ndarray], n: int) -> np.ndarray:
    """Return a number (n,) per face of the probes that leave it out."""
    out = np.zeros(n, np.int64)
    for p, faces in enumerate(omitted):
        out[faces] += 1 << min(p, 60)
    return out


def _all_planes(s: Surfaces, of_face: np.ndarray, size: float) -> tuple[list[Plane], np.ndarray]:
    """Return the planes of a scene, and the plane (F,) of each face, -1: none."""
    flat = [part for o in range(s.objects) for part in _planes(s, o, of_face, size)]
    flat.sort(key=lambda part: -part[0])
    plane_of, planes = np.full(len(of_face), -1), []
    for number, (_, faces, equation) in enumerate(flat[:MOST_PLANES]):
        plane_of[faces] = number
        planes.append(Plane(number, equation))
    return planes, plane_of


def _planes(s: Surfaces, o: int, of_face: np.ndarray, size: float) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return area, global faces and equation of the large flat sharp parts of an object, as a floor of tiles."""
    flat = 1e-4  # of the scene size: departure from a plane
    faces = np.flatnonzero(of_face[s.face_range(o)] >= 0) + int(s.first_face[o])
    if not len(faces):
        return []
    patch = np.unique(s.patch[faces], return_inverse=True)[1].reshape(-1)
    n = int(patch.max()) + 1
    area = np.bincount(patch, s.areas[faces])
    turned = (s.normals[faces] * s.areas[faces, None]).T
    normal = np.stack([np.bincount(patch, part) for part in turned], axis=1) / np.maximum(area, 1e-300)[:, None]
    length = np.sqrt((normal * normal).sum(axis=1))
    normal /= np.maximum(length, 1e-300)[:, None]
    heights = np.einsum("fkc,fc->fk", s.vertices[o][s.faces[o][faces - s.first_face[o]]], normal[patch])
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    np.minimum.at(low, patch, heights.min(axis=1))
    np.maximum.at(high, patch, heights.max(axis=1))
    planes, count, plane_of = np.zeros((n, 4)), 0, np.full(n, -1)
    for p in np.argsort(-area):
        if length[p] < 0.99 or high[p] - low[p] > flat * size:
            continue
        height, earlier = (low[p] + high[p]) / 2, planes[:count]
        same = (earlier[:, :3] @ normal[p] > 1 - 1e-6) & (np.abs(earlier[:, 3] - height) < flat * size)
        plane_of[p] = np.argmax(same) if same.any() else count
        planes[plane_of[p]] = planes[plane_of[p]] if same.any() else (*normal[p], height)
        count += not same.any()
    of = plane_of[patch]
    total = np.bincount(of[of >= 0], s.areas[faces[of >= 0]], minlength=count)
    # flat parts smaller than 0.001 of the squared scene size look into a probe
    large = np.flatnonzero(total >= 0.001 * size * size)
    return [(float(total[k]), faces[of == k], planes[k]) for k in large]


# Places of probes ---------------------------------------------------------------------------------------------


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
    rays, part = _rays_where_light_is(model, faces), _parts(corners, size)
    low, high = _boxes(part, corners)
    # connected parts larger than 0.25 of the scene size look into the probes of rooms
    middle, is_compact = (low + high) / 2, (high - low).max(axis=1) <= 0.25 * size
    out, left = [], np.ones(len(faces), bool)
    for p in np.argsort(-np.bincount(part, s.areas[faces])):
        inside = ((low[p] < middle) & (middle < high[p])).all(axis=1)  # with the hull around p
        own = inside[part]
        mine = own & left
        if is_compact[p] and len(out) < MOST_PROBES - 1 and mine[rays.row].any():
            place = Place(middle[p], (high[p] - low[p]) / 2, faces[own], faces[mine])
            seen = _serves(model, model.static, place, rays.at(mine[rays.row]), size).mean()
            out.append(place._replace(seen=float(seen)))
            left &= ~mine
    if left.any():
        out += _in_rooms(model, faces, np.flatnonzero(left), rays.at(left[rays.row]), MOST_PROBES - len(out), size)
    return out


def _of_mobile(model: Model, o: int, faces: np.ndarray, corners: np.ndarray, size: float) -> Place:
    """Return the middle of a mobile's sharp faces of corners (n, 3, 3), with its share of rays from all over them."""
    s, at, rng = model.surfaces, model.transforms(model.start_poses()), np.random.default_rng(0)
    R, position, end = at.rotation[o], at.position[o], np.cumsum(s.areas[faces])
    row = np.minimum(np.searchsorted(end, rng.random(PROBE_POINTS) * end[-1]), len(end) - 1)
    points = corners[row].mean(axis=1) @ R.T + position
    rays = _rays(model, at, row, points, s.normals[faces[row]] @ R.T)
    low, high = (corner[0] for corner in _boxes(np.zeros(len(faces), np.int64), corners))
    place = Place((low + high) / 2, (high - low) / 2, faces, faces)
    in_world = place._replace(centre=R @ place.centre + position, half=np.abs(R) @ place.half)
    return place._replace(seen=float(_serves(model, at, in_world, rays, size).mean()))


def _in_rooms(model: Model, faces: np.ndarray, rows: np.ndarray, rays: Rays, most: int, size: float) -> list[Place]:
    """Return places in rooms, at most so many, for faces[rows], which the rays leave: half-way along some of them.

    Of places that serve nearly the most rays, the one farthest from the points that these meet is taken: near
    surfaces hide others. Each smooth piece looks into the place that serves most of its own rays.
    """
    s, none = model.surfaces, np.zeros(0, np.int64)
    middles = s.vertices[0][s.faces[0][faces[rows]]].mean(axis=1)
    if not len(rays.row):  # no light: any place
        return [Place(middles.mean(axis=0), np.zeros(3), none, faces[rows])]
    piece = np.unique(s.patch[faces[rows]], return_inverse=True)[1].reshape(-1)
    of_ray = piece[np.searchsorted(rows, rays.row)]
    tried = np.linspace(0, len(rays.row) - 1, min(48, len(rays.row))).astype(int)  # 48 places in rooms are tried
    half = 0.5 * np.minimum(rays.distance[tried], size)[:, None]
    centres = rays.origins[tried] + half * rays.directions[tried]
    hit = np.isfinite(rays.distance)
    surroundings = np.concatenate([rays.origins, rays.origins[hit] + rays.distance[hit, None] * rays.directions[hit]])
    # a clearance of 0.05 of the scene size is enough
    clearance = np.minimum(nearest(surroundings, centres)[0], 0.05 * size)
    every = [Place(c, np.zeros(3), none, none) for c in centres]
    serves = np.stack([_serves(model, model.static, place, rays, size) for place in every])
    weight = np.bincount(of_ray, minlength=piece.max() + 1)
    counts = np.stack([np.bincount(of_ray, row, minlength=len(weight)) for row in serves])
    taken, best = [], np.zeros(len(weight))
    while len(taken) < most:
        gain = np.maximum(counts - best, 0.0).sum(axis=1)
        if taken and gain.max() <= 0.01 * len(rays.row):  # a further place in a room must serve 0.01 of all rays better
            break
        # of places with 0.98 of the most rays, the one of the largest clearance wins
        taken.append(int(np.argmax(np.where(gain >= 0.98 * gain.max(), clearance, -1.0))))
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
    # corners nearer than 1e-4 of the scene size are one
    cell = np.round(corners.reshape(-1, 3) / (1e-4 * size)).astype(np.int64)
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


def _rays_where_light_is(model: Model, faces: np.ndarray) -> Rays:
    """Return rays from where photons meet sharp faces (n,) of the static part, on the side that they meet."""
    s, pilot = model.surfaces, model.pilot
    face, back = pilot.side >> 1, pilot.side & 1 > 0
    row = np.minimum(np.searchsorted(faces, face), len(faces) - 1)
    met = np.flatnonzero((faces[row] == face) & (~back | s.two_sided[face]))
    met = met[np.linspace(0, len(met) - 1, min(PROBE_POINTS, len(met))).astype(int)]
    return _rays(model, model.static, row[met], pilot.hits[met], pilot.normals[met])


def _rays(model: Model, at: Transforms, row: np.ndarray, points: np.ndarray, normals: np.ndarray) -> Rays:
    """Return PROBE_RAYS rays of a cosine distribution from points (n, 3) [m], on faces row (n,), normals (n, 3)."""
    starts = points + model.lifts_at(at, points, normals)[:, None] * normals
    row, origins, normals = (np.repeat(a, PROBE_RAYS, axis=0) for a in (row, starts, normals))
    d = np.random.default_rng(0).normal(size=(len(row), 3))
    d = normals + d / np.maximum(np.sqrt(dot(d, d)), 1e-9)[:, None]
    d /= np.maximum(np.sqrt(dot(d, d)), 1e-9)[:, None]
    return Rays(origins, d, *_cast(model, at, origins, d), row)


def _cast(model: Model, at: Transforms, origins: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distance (n,) float64, inf: none, and face (n,) of the nearest hits."""
    far = np.full(len(d), np.inf, np.float32)
    t, face = nearest_in_world(model.accelerator, at, origins.astype(np.float32), d.astype(np.float32), far)
    return np.where(face < 0, np.inf, t), face


def _serves(model: Model, at: Transforms, place: Place, rays: Rays, size: float) -> np.ndarray:
    """Return (n,) bool: the place sees the point that a ray meets, or the sky where it meets none."""
    met = np.isfinite(rays.distance)
    way = rays.origins + np.where(met, rays.distance, 0.0)[:, None] * rays.directions - place.centre
    far = np.where(met, np.sqrt(dot(way, way)), np.inf)
    d = np.where(met[:, None], way / np.maximum(np.where(met, far, 1.0), 1e-9)[:, None], rays.directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        start = np.nanmin(np.where(d != 0, OMITTED_INSIDE * place.half / np.abs(d), np.inf), axis=1)
    reached = start.copy()
    going = np.arange(len(d))
    for _ in range(4):  # behind faces that are left out
        t, face = _cast(model, at, place.centre + reached[going, None] * d[going], d[going])
        reached[going] += t
        going = going[np.isin(face, place.omitted)]
        if not len(going):
            break
        reached[going] += GAP * (reached[going] + np.abs(place.centre).max())
    # hits closer than 0.01 of the scene size are one
    seen = (reached >= far - 0.01 * size) & (start <= far) & ~np.isin(rays.face, place.omitted)
    return np.where(met, seen, np.isinf(reached))

"""Reflections for sharp gloss: planes of flat parts, and probes of the surroundings for all faces.

A plane shows the scene reflected in it, without error. A picture has room for few planes, those that cover most of it;
all other faces look into a probe: the surroundings of one place. A ray that leaves a face is served by a probe whose
place sees the point that the ray meets. Places for the static part are chosen by the share of rays that they serve, of
rays that leave sharp faces where photons meet them: surfaces without light, such as the inside of a hollow wall, have
none.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import components, group_of
from gi_core.base.nearest_points import nearest
from gi_core.base.vectors import dot
from gi_core.geometry.sides import NONE
from gi_core.geometry.surfaces import Surfaces
from gi_core.gloss.highlights import OFFSET
from gi_core.gloss.sharp import SharpLobe, lobe_classes, noise_factor, sharp_faces
from gi_core.model import Model
from gi_core.photons.trace import trace_background
from gi_core.rays.accelerator import Transforms
from gi_core.rays.all_objects import nearest_in_world

PLANES = 64  # candidates per scene, the largest first
PLANE_AREA = 0.001  # of the squared scene size: smaller flat parts look into a probe
FLAT = 1e-4  # of the scene size: departure from a plane
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


class Reflector(NamedTuple):
    """Faces of an object that show their reflections alike."""

    lobe: SharpLobe
    faces: np.ndarray  # (n,) int64 of the object
    plane: Plane | None
    probe: Probe
    omitted: frozenset[int]  # numbers of the probes that leave these faces out


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
    """A place for a probe."""

    centre: np.ndarray  # (3,) float64 [m]
    half: np.ndarray  # (3,) float64 [m], as in Probe
    omitted: np.ndarray  # (k,) int64 global faces, sorted
    clearance: float = 0.0  # [m] to the nearest surface that it sees


def reflectors(model: Model) -> tuple[tuple[Reflector, ...], ...]:
    """Return the reflectors of each object of a model, none for objects without sharp gloss."""
    s = model.surfaces
    lobes, of_face = sharp_faces(s)
    if not lobes:
        return ((),) * s.objects
    size = max(float(np.ptp(v, axis=0).max()) for v in s.vertices if len(v))
    planes, plane_of = _all_planes(s, of_face, size)
    probes: list[Probe] = []
    probe_of, omitted = np.full(len(of_face), -1), []
    for o in range(s.objects):
        units = _units(s, o, of_face, size)
        if not len(units.faces):
            continue
        at = model.static if o == 0 else model.transforms(model.start_poses())
        for place, faces, seen in _places(model, at, units, o, size):
            probe_of[faces] = len(probes)
            probes.append(Probe(len(probes), place.centre, place.half, seen))
            omitted.append(place.omitted)
    kind = group_of((of_face, plane_of, probe_of, _sets(omitted, len(of_face))))
    out: list[list[Reflector]] = [[] for _ in range(s.objects)]
    sharp = np.flatnonzero(of_face >= 0)
    objects = np.searchsorted(s.first_face, sharp, side="right") - 1
    for o, k in np.unique(np.stack([objects, kind[sharp]], axis=1), axis=0):
        faces = sharp[(kind[sharp] == k) & (objects == o)]
        f = int(faces[0])
        plane = None if plane_of[f] < 0 else planes[plane_of[f]]
        without = frozenset(p for p, some in enumerate(omitted) if f in some)
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
    for o, some in enumerate(reflectors(model)):
        for r in some:
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
    found = [part for o in range(s.objects) for part in _planes(s, o, of_face, size)]
    found.sort(key=lambda part: -part[0])
    plane_of, planes = np.full(len(of_face), -1), []
    for number, (_, faces, equation) in enumerate(found[:PLANES]):
        plane_of[faces] = number
        planes.append(Plane(number, equation))
    return planes, plane_of


def _planes(s: Surfaces, o: int, of_face: np.ndarray, size: float) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return area, global faces and equation of the large flat sharp parts of an object, as a floor of tiles."""
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
        if length[p] < 0.99 or high[p] - low[p] > FLAT * size:
            continue
        height, known = (low[p] + high[p]) / 2, planes[:count]
        same = (known[:, :3] @ normal[p] > 1 - 1e-6) & (np.abs(known[:, 3] - height) < FLAT * size)
        plane_of[p] = np.argmax(same) if same.any() else count
        planes[plane_of[p]] = planes[plane_of[p]] if same.any() else (*normal[p], height)
        count += not same.any()
    of = plane_of[patch]
    total = np.bincount(of[of >= 0], s.areas[faces[of >= 0]], minlength=count)
    large = np.flatnonzero(total >= PLANE_AREA * size * size)
    return [(float(total[k]), faces[of == k], planes[k]) for k in large]


def _units(s: Surfaces, o: int, of_face: np.ndarray, size: float) -> Units:
    """Return the pieces of an object: connected parts, of large ones each smooth piece; a mobile is one."""
    faces = np.flatnonzero(of_face[s.face_range(o)] >= 0) + int(s.first_face[o])
    n = len(faces)
    if not n or o:
        whole = np.zeros(n, np.int64), np.zeros(min(n, 1), np.int64), np.full(min(n, 1), s.areas[faces].sum())
        return Units(faces, *whole)
    corners = s.faces[o][faces - s.first_face[o]]
    cell = np.round(s.vertices[o][corners.reshape(-1)] / (FLAT * size)).astype(np.int64)
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


def _places(model: Model, at: Transforms, units: Units, o: int, size: float) -> list[tuple[Place, np.ndarray, float]]:
    """Return the places of an object's probes, in its space, the global faces that look into each, and their share."""
    s = model.surfaces
    R, position = at.rotation[o], at.position[o]
    rays = _rays(model, at, units, o, size)
    if o:
        (place,) = _lone_places(s, units, o)
        return [(place, units.faces, float(_serves(model, at, _placed(place, R, position), rays, size).mean()))]
    free, lone = _free_places(model, rays, size), _lone_places(s, units, o)
    weight = np.bincount(rays.unit, minlength=len(units.area))
    shares = [_shares(model, at, place, rays, units, size) for place in (*free, *lone)]
    every, share = [*free, *lone], np.stack(shares) / np.maximum(weight, 1)
    taken, probe_of = _own_probes(share, weight, units, lone, size)
    clearance = np.array([place.clearance for place in every])
    taken, probe_of = _shared_probes(share, weight, clearance, taken, probe_of)
    bare = np.flatnonzero((probe_of < 0) & (weight == 0))
    probe_of[bare] = 0
    if len(bare) and len(rays.unit):  # no light: as the nearest piece with light
        low, high = _boxes(units.unit, s.vertices[o][s.faces[o][units.faces - s.first_face[o]]])
        probe_of[bare] = probe_of[rays.unit[nearest(rays.origins, (low + high)[bare] / 2)[1]]]
    out = []
    for j, k in enumerate(taken):
        mine = probe_of == j
        if mine.any():
            seen = (share[k] * weight)[mine].sum() / max(weight[mine].sum(), 1e-300)
            out.append((every[k], units.faces[mine[units.unit]], float(seen)))
    return out


def _shares(model: Model, at: Transforms, place: Place, rays: Rays, units: Units, size: float) -> np.ndarray:
    """Return the number (units,) of rays that a place serves; one that leaves faces out serves only these."""
    own = np.isin(rays.unit, _omitted(place, units)) if len(place.omitted) else slice(None)
    serves = _serves(model, at, place, Rays(*(a[own] for a in rays)), size)
    return np.bincount(rays.unit[own], serves, minlength=len(units.area))


def _omitted(place: Place, units: Units) -> np.ndarray:
    return np.unique(units.unit[np.isin(units.faces, place.omitted)])


def _own_probes(share: np.ndarray, weight: np.ndarray, units: Units, lone: list[Place], size: float):
    """Return the places (rows of share) that compact parts have for themselves, and their number (units,), -1: none.

    Near by, a probe has more pixels for what a part reflects: it may serve fewer rays by SLACK.
    """
    first = len(share) - len(lone)
    by_others = share[:first].max(axis=0, initial=0.0)
    taken: list[int] = []
    probe_of = np.full(len(weight), -1)
    for k, place in enumerate(lone, first):
        mine = np.zeros(len(weight), bool)
        mine[_omitted(place, units)] = True
        mine &= probe_of < 0
        lit = weight * mine
        is_compact = 2 * place.half.max() <= COMPACT * size
        if is_compact and lit.any() and lit @ (share[k] - by_others + SLACK) >= 0 and len(taken) < PROBES - 1:
            probe_of[mine] = len(taken)
            taken.append(k)
    return taken, probe_of


def _shared_probes(share, weight, clearance: np.ndarray, taken: list[int], probe_of: np.ndarray):
    """Add places that serve most rays of the pieces without a probe; arguments and result as of _own_probes().

    Of places that serve nearly as many, it is that of the largest clearance [m]: near surfaces hide others.
    """
    rest, own = np.where(probe_of < 0, weight, 0), len(taken)
    best = np.zeros(len(weight))
    while len(taken) < PROBES and (probe_of < 0).any():
        gain = np.maximum(share - best, 0.0) @ rest
        if len(taken) > own and gain.max() <= LEAST_GAIN * weight.sum():
            break
        k = int(np.argmax(np.where(gain >= ALIKE * gain.max(), clearance, -1.0)))
        taken.append(k)
        best = np.maximum(best, share[k])
    shared = own + np.argmax(share[taken[own:]], axis=0) if len(taken) > own else probe_of
    return taken, np.where((probe_of < 0) & (weight > 0), shared, probe_of)


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
        share = s.areas[units.faces] / max(s.areas[units.faces].sum(), 1e-300)
        row = rng.choice(len(units.faces), POINTS, p=share)
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

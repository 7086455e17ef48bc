"""Reflections for sharp gloss: planes of flat parts, and probes of the surroundings for all faces.

A plane shows the scene reflected in it, without error. A picture has room for few planes, those that cover most of it;
all other faces look into a probe: the surroundings of one place (`probe_places.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.geometry.surfaces import Surfaces
from gi_core.gloss.probe_places import places
from gi_core.gloss.sharp import SharpLobe, lobe_classes, noise_factor, sharp_faces
from gi_core.model import Model

PLANES = 64  # candidates per scene, the largest first
PLANE_AREA = 0.001  # of the squared scene size: smaller flat parts look into a probe
FLAT = 1e-4  # of the scene size: departure from a plane
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
        faces = np.flatnonzero(of_face[s.face_range(o)] >= 0) + int(s.first_face[o])
        for place in places(model, o, faces, size) if len(faces) else ():
            probe_of[place.faces] = len(probes)
            probes.append(Probe(len(probes), place.centre, place.half, place.seen))
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

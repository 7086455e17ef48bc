"""Gloss too sharp for light at vertices, and the way that pictures show it.

A lobe's noise factor is the noise of its radiance over that of irradiance, from the same rays of uniform light:
sqrt(pi * integral of f^2 cos) / (integral of f cos), for a view along the normal. GGX has 1.2 at alpha 0.3, 2.0 at
0.15, and 0.29 / alpha below. Lobes above MOST_NOISE are drawn by reflections: flat faces by the scene reflected in
their plane, others from a probe.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import components, group_of
from gi_core.bsdf.table import Tables
from gi_core.geometry.surfaces import Surfaces
from gi_core.gloss.lobe_rays import draw_lobe

MOST_NOISE = 2.0  # of cells: GGX of alpha 0.153; narrower lobes are also narrower than a cell
DRAWS = 4096  # rays that measure a lobe: its noise factor within 2 %
TAPS = 16  # rays per pixel in place of a lobe, each with a blurred look into the reflection
NODES = 17  # of the albedo, in the cosine of the view
PLANES, PROBES = 4, 6  # at most per scene, the largest first; the rest shows cells
PLANE_AREA = 0.01  # of the squared scene size: smaller flat parts are drawn from a probe
FLAT = 1e-4  # of the scene size: departure from a plane
BY_CELLS, PLANAR, PROBE = "cells", "planar", "probe"


class SharpLobe(NamedTuple):
    """A lobe as reflections need it."""

    lobe: np.ndarray  # (5,) float64, of Surfaces.lobe
    noise: float  # factor
    # (n, 3) float64, of rays that stand for the lobe, for a view along the normal: slopes of the half vector along
    # tangent and bitangent, and the square root of the solid angle [sr] that the ray stands for. One ray for a mirror
    taps: np.ndarray
    albedo: np.ndarray  # (NODES, 3) float64, reflected share of uniform light by the cosine of the view, from 0 to 1


class Reflector(NamedTuple):
    """Faces of an object that show one reflection, in its space."""

    way: str  # PLANAR or PROBE
    number: int  # among the planes or the probes of the scene; lobes may share one
    lobe: SharpLobe
    faces: np.ndarray  # (n,) int64 of the object
    plane: np.ndarray  # (4,) float64, unit normal and its product with a point of the plane; PROBE: nan
    box: np.ndarray  # (2, 3) float64 [m], of all faces that share the plane or probe

    @property
    def centre(self) -> np.ndarray:
        """Return the place (3,) of the probe."""
        return self.box.mean(axis=0)


def noise_factor(lobe: np.ndarray, tables: Tables) -> float:
    """Return the noise factor of a lobe (5,), inf for a mirror."""
    _, factors, values = _drawn(lobe, tables, 1.0)
    share, gloss = factors.max(axis=1), float(factors.max(axis=1).mean())
    return math.sqrt(math.pi * float((share * values).mean())) / gloss if gloss > 0 else 0.0


def hemispherical_albedo(lobe: np.ndarray, tables: Tables) -> np.ndarray:
    """Return the share (3,) of uniform light that a lobe (5,) reflects."""
    cosines = (np.arange(NODES) + 0.5) / NODES
    shares = [_drawn(lobe, tables, cos)[1].mean(axis=0) for cos in cosines]
    return (np.array(shares) * cosines[:, None]).sum(axis=0) / cosines.sum()


def sharp_lobe(lobe: np.ndarray, tables: Tables) -> SharpLobe | None:
    """Return a lobe (5,) for reflections; None: cells carry it."""
    return _sharp_lobe(lobe.tobytes(), _Once(tables))


class _Once:
    """Tables as a key, kept alive by the cache."""

    def __init__(self, tables: Tables) -> None:
        self.tables = tables

    def __hash__(self) -> int:
        return hash(self.tables.head.tobytes())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Once):
            return False
        data, others = self.tables.data, other.tables.data
        return data is others or np.array_equal(data, others)


@lru_cache(maxsize=1024)
def _sharp_lobe(row: bytes, key: _Once) -> SharpLobe | None:
    lobe, tables = np.frombuffer(row), key.tables
    returns = lobe[4] < 0 and tables.head[int(-1 - lobe[4]), 5] < 0  # towards the light: no reflection shows it
    noise = noise_factor(lobe, tables)
    if returns or noise <= MOST_NOISE:
        return None
    albedo = np.array([_drawn(lobe, tables, cos)[1].mean(axis=0) for cos in np.linspace(0, 1, NODES)])
    return SharpLobe(lobe, noise, _taps(lobe, tables), albedo)


def _taps(lobe: np.ndarray, tables: Tables) -> np.ndarray:
    k = np.arange(TAPS)
    inverse = sum(((k >> bit) & 1) / 2 ** (bit + 1) for bit in range(TAPS.bit_length() - 1))  # Hammersley's points
    numbers = np.stack([(k + 0.5) / TAPS, inverse + 0.5 / TAPS, (0.5 + k * 0.6180339887498949) % 1], axis=1)
    d, factors, values = _rays(lobe, tables, 1.0, numbers)
    kept = factors.max(axis=1) > 0
    d, factors, values = d[kept], factors[kept].max(axis=1), values[kept]
    if np.isinf(values).all():
        return np.zeros((1, 3))
    slopes = d[:, :2] / (1 + d[:, 2:])
    # A ray has the density f cos / factor and stands for one over TAPS times that.
    return np.c_[slopes, np.sqrt(factors / (TAPS * values * d[:, 2]))]


def _drawn(lobe: np.ndarray, tables: Tables, cosine: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return draw_lobe() of DRAWS random rays for one view."""
    return _rays(lobe, tables, cosine, np.random.default_rng(0).random((DRAWS, 3)))


def _rays(lobe: np.ndarray, tables: Tables, cosine: float, numbers: np.ndarray):
    n = len(numbers)
    view = np.array([math.sqrt(1 - cosine * cosine), 0.0, cosine])
    axes = (np.broadcast_to(np.array(axis, np.float64), (n, 3)) for axis in (view, (0, 0, 1), (1, 0, 0)))
    return draw_lobe(np.broadcast_to(lobe, (n, 5)), tables, *axes, numbers)


def reflectors(surfaces: Surfaces) -> tuple[tuple[Reflector, ...], ...]:
    """Return the reflectors of each object, none for diffuse ones and for lobes that cells carry."""
    s, found = surfaces, _sharp_faces(surfaces)
    kept: list[list[Reflector]] = [[] for _ in range(s.objects)]
    if found is None:
        return tuple(map(tuple, kept))
    lobes, of_face = found
    size = max(float(np.ptp(v, axis=0).max()) for v in s.vertices if len(v))
    planes = [part for o in range(s.objects) for part in _planes(s, o, of_face, size)]
    planes.sort(key=lambda part: -part[0])
    taken = np.zeros(len(of_face), bool)
    for number, (_, o, faces, plane) in enumerate(planes[:PLANES]):
        taken[faces] = True
        kept[o] += _by_lobe(s, o, PLANAR, number, faces, of_face, lobes, plane)
    rest = [part for o in range(s.objects) for part in _parts(s, o, np.where(taken, -1, of_face), size)]
    rest.sort(key=lambda part: -part[0])
    for number, (_, o, faces) in enumerate(rest[:PROBES]):
        kept[o] += _by_lobe(s, o, PROBE, number, faces, of_face, lobes, np.full(4, math.nan))
    return tuple(map(tuple, kept))


def in_probes(surfaces: Surfaces) -> np.ndarray:
    """Return the faces (F,) bool whose gloss pictures show from a probe."""
    out = np.zeros(len(surfaces.lobe), bool)
    for o, some in enumerate(reflectors(surfaces)):
        for r in some:
            out[r.faces + int(surfaces.first_face[o])] = r.way == PROBE
    return out


def ways(surfaces: Surfaces) -> tuple[np.ndarray, np.ndarray]:
    """Return the noise factor (F,) of the gloss of each face, nan for diffuse ones, and its way (F,) in pictures."""
    noise, way = np.full(len(surfaces.lobe), math.nan), np.full(len(surfaces.lobe), BY_CELLS, object)
    for f, faces in _lobe_classes(surfaces):
        noise[faces] = noise_factor(surfaces.lobe[f], surfaces.tables)
    for o, some in enumerate(reflectors(surfaces)):
        for r in some:
            way[r.faces + int(surfaces.first_face[o])] = r.way
    return noise, way


def _lobe_classes(s: Surfaces):
    """Yield a face of each lobe, and all its faces."""
    glossy = np.flatnonzero(~np.isnan(s.lobe[:, 4]))
    if len(glossy):
        _, first, kind = np.unique(s.lobe[glossy], axis=0, return_index=True, return_inverse=True)
        for k, f in enumerate(first):
            yield int(glossy[f]), glossy[kind.reshape(-1) == k]


def _sharp_faces(s: Surfaces) -> tuple[list[SharpLobe], np.ndarray] | None:
    """Return the sharp lobes, and the lobe (F,) of each face, -1 for none."""
    lobes, of_face = [], np.full(len(s.lobe), -1)
    for f, faces in _lobe_classes(s):
        sharp = sharp_lobe(s.lobe[f], s.tables)
        if sharp is not None:
            of_face[faces] = len(lobes)
            lobes.append(sharp)
    return (lobes, of_face) if lobes else None


def _by_lobe(s: Surfaces, o: int, way, number, faces, of_face, lobes, plane) -> list[Reflector]:
    corners = s.vertices[o][s.faces[o][faces - s.first_face[o]].reshape(-1)]
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    kinds = np.unique(of_face[faces])
    return [
        Reflector(way, number, lobes[k], faces[of_face[faces] == k] - int(s.first_face[o]), plane, box) for k in kinds
    ]


def _planes(s: Surfaces, o: int, of_face: np.ndarray, size: float) -> list[tuple[float, int, np.ndarray, np.ndarray]]:
    """Return area, object, global faces and plane of the large flat sharp parts of an object, as a floor of tiles."""
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
    return [(float(total[k]), o, faces[of == k], planes[k]) for k in large]


def _parts(s: Surfaces, o: int, of_face: np.ndarray, size: float) -> list[tuple[float, int, np.ndarray]]:
    """Return area, object and global faces of the sharp parts of an object: all of a mobile, else connected ones.

    A part whose middle lies in the box of a larger one belongs to it: seen from inside, it would hide the surroundings.
    """
    faces = np.flatnonzero(of_face[s.face_range(o)] >= 0) + int(s.first_face[o])
    if not len(faces):
        return []
    if o > 0:
        return [(float(s.areas[faces].sum()), o, faces)]
    corners = s.faces[o][faces - s.first_face[o]]
    cell = np.round(s.vertices[o][corners.reshape(-1)] / (FLAT * size)).astype(np.int64)
    place = group_of(list(cell.T)).reshape(-1, 3)
    n = len(faces)
    links = np.stack([np.repeat(np.arange(n), 3), n + place.reshape(-1)], axis=1)
    part = components(links, n + int(place.max()) + 1)[:n]
    found: list[tuple[float, np.ndarray, np.ndarray]] = []  # area, faces, box
    area = np.bincount(part, s.areas[faces])
    for p in np.argsort(-area):
        some = faces[part == p]
        points = s.vertices[o][corners[part == p].reshape(-1)]
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        middle = box.mean(axis=0)
        for k, (there, others, around) in enumerate(found):
            if ((around[0] < middle) & (middle < around[1])).all():
                found[k] = there + float(area[p]), np.concatenate([others, some]), around
                break
        else:
            found.append((float(area[p]), some, box))
    return [(a, o, some) for a, some, _ in found]

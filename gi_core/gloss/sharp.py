"""Gloss too sharp for light at vertices, and the way that pictures show it.

A lobe's noise factor is the noise of its radiance over that of irradiance, from the same rays of uniform light:
sqrt(pi * integral of f^2 cos) / (integral of f cos), for a view along the normal. GGX has 1.2 at alpha 0.3, 2.0 at
0.15, and 0.29 / alpha below. Lobes above MOST_NOISE are drawn by reflections (`reflectors.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gi_core.bsdf.table import Tables
from gi_core.geometry.surfaces import Surfaces
from gi_core.gloss.lobe_rays import LobeViews, draw_lobe, gloss_alone

MOST_NOISE = 2.0  # of cells: GGX of alpha 0.153; narrower lobes are also narrower than a cell
TAPS = 16  # rays per pixel in place of a lobe, each with a blurred look into the reflection
COSINES = 17  # of the albedo, in the cosine of the view


class SharpLobe(NamedTuple):
    """A lobe as reflections need it."""

    lobe: np.ndarray  # (5,) float64, of Surfaces.lobe
    noise: float  # factor
    # (n, 3) float64, of rays that stand for the lobe, for a view along the normal: slopes of the half vector along
    # tangent and bitangent, and the square root of the solid angle [sr] that the ray stands for. One ray for a mirror
    taps: np.ndarray
    albedo: np.ndarray  # (COSINES, 3) float64, reflected share of uniform light by the cosine of the view, from 0 to 1


def noise_factor(lobe: np.ndarray, tables: Tables) -> float:
    """Return the noise factor of a lobe (5,), inf for a mirror."""
    d, factors, densities = _drawn(lobe, tables, 1.0)
    share, cosine = factors.max(axis=1), d[:, 2]
    gloss, lit = float(share.mean()), share > 0
    squared = (share[lit] ** 2 * densities[lit] / cosine[lit]).sum() / len(share)
    return math.sqrt(math.pi * squared) / gloss if gloss > 0 else 0.0


def hemispherical_albedo(lobe: np.ndarray, tables: Tables) -> np.ndarray:
    """Return the share (3,) of uniform light that a lobe (5,) reflects."""
    cosines = (np.arange(COSINES) + 0.5) / COSINES
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
        return self.tables.data is other.tables.data or np.array_equal(self.tables.data, other.tables.data)


@lru_cache(maxsize=1024)
def _sharp_lobe(row: bytes, key: _Once) -> SharpLobe | None:
    lobe, tables = np.frombuffer(row), key.tables
    returns = lobe[4] < 0 and tables.head[int(-1 - lobe[4]), 5] < 0  # towards the light: no reflection shows it
    noise = noise_factor(lobe, tables)
    if returns or noise <= MOST_NOISE:
        return None
    albedo = np.array([_drawn(lobe, tables, cos)[1].mean(axis=0) for cos in np.linspace(0, 1, COSINES)])
    return SharpLobe(lobe, noise, _taps(lobe, tables), albedo)


def _taps(lobe: np.ndarray, tables: Tables) -> np.ndarray:
    k = np.arange(TAPS)
    inverse = sum(((k >> bit) & 1) / 2 ** (bit + 1) for bit in range(TAPS.bit_length() - 1))  # Hammersley's points
    numbers = np.stack([(k + 0.5) / TAPS, inverse + 0.5 / TAPS, (0.5 + k * 0.6180339887498949) % 1], axis=1)
    d, factors, densities = _rays(lobe, tables, 1.0, numbers)
    lit = factors.max(axis=1) > 0
    d, densities = d[lit], densities[lit]
    if np.isinf(densities).all():
        return np.zeros((1, 3))
    slopes = d[:, :2] / (1 + d[:, 2:])
    return np.c_[slopes, np.sqrt(1 / (TAPS * densities))]


def _drawn(lobe: np.ndarray, tables: Tables, cosine: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return draw_lobe() of 4,096 random rays, a noise factor within 2 %, for one view."""
    return _rays(lobe, tables, cosine, np.random.default_rng(0).random((4096, 3)))


def _rays(lobe: np.ndarray, tables: Tables, cosine: float, numbers: np.ndarray):
    n = len(numbers)
    view = np.array([math.sqrt(1 - cosine * cosine), 0.0, cosine])
    axes = (np.broadcast_to(np.array(axis, np.float64), (n, 3)) for axis in (view, (0, 0, 1), (1, 0, 0)))
    return draw_lobe(LobeViews.of_lobes(gloss_alone(lobe[None], tables), 0, *axes), numbers)


def sharp_faces(surfaces: Surfaces) -> tuple[list[SharpLobe], np.ndarray]:
    """Return the sharp lobes, and the lobe (F,) int64 of each face, -1: cells carry its gloss, or it has none."""
    lobes, of_face = [], np.full(len(surfaces.lobe), -1)
    for f, faces in lobe_classes(surfaces):
        sharp = sharp_lobe(surfaces.lobe[f], surfaces.tables)
        if sharp is not None:
            of_face[faces] = len(lobes)
            lobes.append(sharp)
    return lobes, of_face


def is_sharp(surfaces: Surfaces) -> np.ndarray:
    """Return the faces (F,) bool whose gloss pictures show by reflections."""
    return sharp_faces(surfaces)[1] >= 0


def lobe_classes(surfaces: Surfaces) -> Iterator[tuple[int, np.ndarray]]:
    """Yield a face of each lobe, and all its faces (n,)."""
    lobe = surfaces.lobe
    glossy = np.flatnonzero(~np.isnan(lobe[:, 4]))
    if len(glossy):
        _, first, kind = np.unique(lobe[glossy], axis=0, return_index=True, return_inverse=True)
        for k, f in enumerate(first):
            yield int(glossy[f]), glossy[kind.reshape(-1) == k]

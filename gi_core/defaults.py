"""Photons, radius and k that make a good picture, by one stated rule.

- Scene size: longest side of the box that holds the central 98 % of a pilot trace's hits (a ground
  slab may be five times the room), unless the scene file states it (a dome may catch most hits).
- Radius: 2.5 % of the scene size: shadows blur over that length.
- Photons: so many that on the median lit surface a disc holds HITS expected hits (5 % noise), but no
  more than MOST_PHOTONS, nor than make MOST_CROSSINGS: three and ten seconds on two cores.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from gi_core.model import Model
from gi_core.paths import NONE
from gi_core.photon_trace import trace_background

PILOT_PHOTONS = 4096
PILOT_SEED = 0x5EED  # never a seed of the solution: the pilot must not bias what it sets
PILOT_NEIGHBOURS = 8  # hits that a local density is taken from
SAMPLES = 2000  # receivers, and hits, looked at
CENTRAL_SHARE = 0.98
RADIUS_SHARE = 0.025
HITS = 500
MOST_PHOTONS = 1_000_000
MOST_CROSSINGS = 40_000_000
FEWEST_PHOTONS = 10_000
NEIGHBOURS = 50


class Chosen(NamedTuple):
    """Settings of a solver and the numbers behind them."""

    photons: int
    radius: float  # [m]
    neighbours: int
    scene_size: float  # [m]
    hits_a_photon: float
    escaped_first: float  # share of pilot photons that hit nothing at all
    low: np.ndarray  # (3,) corner of the box that holds the central hits [m]
    high: np.ndarray


def choose(model: Model, photons: int | None, radius: float | None, neighbours: int | None) -> Chosen:
    """Fill in what the caller and the scene file leave open."""
    recommended = model.scene.defaults
    hits, first_flight = _pilot(model)
    low, high = _box(model, hits)
    size = recommended.scene_size or max(float((high - low).max()), 1e-9)
    radius = radius or recommended.radius or _round(RADIUS_SHARE * size)
    a_photon = len(hits) / PILOT_PHOTONS
    if photons is None:
        photons = recommended.photons or _photons(model, hits, radius, low, high)
    return Chosen(
        int(photons),
        float(radius),
        int(neighbours or recommended.neighbours or NEIGHBOURS),
        size,
        a_photon,
        first_flight,
        low,
        high,
    )


def _pilot(model: Model) -> tuple[np.ndarray, float]:
    """Return hits (n, 3) of a small trace and the share of photons that hit nothing."""
    if not len(model.emitters.kind):
        return np.zeros((0, 3)), 0.0
    m = model
    paths, _ = trace_background(m.accelerator, m.world, m.static, m.emitters, PILOT_SEED, 0, PILOT_PHOTONS)
    arrived = paths.side != NONE
    arrived[paths.offsets[:-1]] = False  # a path's first vertex is on the light
    missed = (np.diff(paths.offsets) == 2) & (paths.side[paths.offsets[1:] - 1] == NONE)
    return paths.position[arrived].astype(np.float64), float(missed.mean())


def _box(model: Model, hits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if len(hits) < 100:
        vertices = model.surfaces.vertices[0]
        return (vertices.min(axis=0), vertices.max(axis=0)) if len(vertices) else (np.zeros(3), np.ones(3))
    tail = (1 - CENTRAL_SHARE) / 2
    return np.quantile(hits, tail, axis=0), np.quantile(hits, 1 - tail, axis=0)


def _photons(model: Model, hits: np.ndarray, radius: float, low: np.ndarray, high: np.ndarray) -> int:
    """Return the number of photons by the rule above, to two digits."""
    if len(hits) < 100:
        return FEWEST_PHOTONS
    rows = model.surfaces.receiver_range(0)
    positions, areas = model.object_receivers.positions[rows], model.object_receivers.areas[rows]
    margin = 0.01 * (high - low)
    inside = np.flatnonzero(((positions >= low - margin) & (positions <= high + margin)).all(axis=1) & (areas > 0))
    if not len(inside):
        return FEWEST_PHOTONS
    # Even steps through the running area: every receiver stands for as much surface as the next.
    share = np.cumsum(areas[inside])
    sample = inside[np.searchsorted(share, (np.arange(SAMPLES) + 0.5) / SAMPLES * share[-1])]
    reach = cKDTree(hits).query(positions[sample], PILOT_NEIGHBOURS)[0][:, -1]
    in_disc = PILOT_NEIGHBOURS * (radius / np.median(reach)) ** 2 / PILOT_PHOTONS  # expected hits a photon
    some = hits[:: max(1, len(hits) // SAMPLES)]
    near = cKDTree(positions).query_ball_point(some, radius, return_length=True)
    crossings = max(float(near.mean()) * len(hits) / PILOT_PHOTONS, 1e-3)  # a photon
    wanted = min(HITS / in_disc, MOST_CROSSINGS / crossings, MOST_PHOTONS)
    return int(max(_round(wanted), FEWEST_PHOTONS))


def _round(x: float) -> float:
    """Return x to two significant digits: settings that can be read out and typed in."""
    if x <= 0:
        return x
    unit = 10.0 ** (math.floor(math.log10(x)) - 1)
    return round(x / unit) * unit

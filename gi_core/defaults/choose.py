"""Photons, radius and k that make a good picture, by one stated rule.

- Scene size: longest side of the box that holds the central 98 % of a pilot trace's hits (a ground
  slab may be five times the room), unless the scene file states it (a dome may catch most hits).
- Radius and photons together: radii from 2.5 % of the scene size downwards are tried, each with the photons that
  bring noise down to 2 %, or that six seconds on two cores allow, or MOST_PHOTONS, whichever is least. The pair
  with the least error is taken, as `predict_error.py` and `predict_cost.py` foretell error and time. On even ground
  that is the largest radius; shadows would blur over more. Among furniture smaller discs pay: one that
  hangs over an edge reads the light of another surface, and smaller ones leave time for more photons. No
  radius is less than half the distance between receivers: light is interpolated over that anyway.
- A given radius gets its photons by the same rule; the radius does not depend on photons that are given, so that
  runs with different photons can be compared.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import box, central_box
from gi_core.defaults import predict_error
from gi_core.defaults.predict_cost import costs
from gi_core.geometry.sides import NONE
from gi_core.model import Model
from gi_core.photons.trace import trace_background

PILOT_PHOTONS = 4096
PILOT_SEED = 0x5EED  # never a seed of the solution: the pilot must not bias what it sets
RADIUS_SHARE = 0.025  # of the scene's size: the largest radius tried
RADII = 6  # tried, each 1 / sqrt(2) of the one before
LEAST_SPACINGS = 0.5  # radius over the distance between receivers
LEAST_NOISE = 0.02  # L1: fewer photons are taken rather than less noise
MOST_SECONDS = 6.0  # of tracing and estimating: what is left of ten seconds after launch
MOST_PHOTONS = 2_000_000  # 180 MB of paths in a closed room
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
    foretold: Foretold | None  # of tangent_plane with the rule's photons for that radius; None: too dark to tell


class Foretold(NamedTuple):
    """What a radius and photons are expected to bring."""

    photons: int
    radius: float  # [m]
    noise: float  # L1 error, relative
    bias: float
    seconds: float  # of tracing and estimating

    @property
    def error(self) -> float:
        return math.hypot(self.noise, self.bias)


def choose(model: Model, photons: int | None, radius: float | None, neighbours: int | None) -> Chosen:
    """Fill in what the caller and the scene file leave open."""
    recommended = model.scene.defaults
    pilot, first_flight = _pilot(model)
    low, high = _box(model, pilot.hits)
    size = recommended.scene_size or max(float((high - low).max()), 1e-9)
    radius = recommended.radius if radius is None else radius
    photons = recommended.photons if photons is None else photons  # 0 is a wish like any other
    foretold = None
    if len(pilot.hits) >= predict_error.FEWEST and (radius is None or photons is None):
        foretold = _best(model, pilot, predict_error.places(model, pilot, low, high, size), size, radius)
        radius = foretold.radius
    return Chosen(
        (foretold.photons if foretold else FEWEST_PHOTONS) if photons is None else int(photons),
        float(radius or _round(RADIUS_SHARE * size)),
        int(neighbours or recommended.neighbours or NEIGHBOURS),
        size,
        len(pilot.hits) / PILOT_PHOTONS,
        first_flight,
        low,
        high,
        foretold,
    )


def _best(model: Model, pilot, lit, size: float, radius: float | None) -> Foretold:
    """Return the best of the radii to be tried, each with its photons."""
    if radius:
        return _foretell(model, pilot, lit, radius)
    largest = RADIUS_SHARE * size
    least = min(largest, LEAST_SPACINGS * lit.spacing)
    radii = [largest * 0.5 ** (k / 2) for k in range(RADII)]
    tried = [_foretell(model, pilot, lit, _round(r)) for r in radii if r >= least]
    return min(tried, key=lambda f: f.error)


def _foretell(model: Model, pilot, lit, radius: float) -> Foretold:
    before, each = costs(model, pilot.paths, radius)
    affordable = max(MOST_SECONDS - before, 0.5 * MOST_SECONDS) / each
    wanted = min(predict_error.photons_for(lit, radius, LEAST_NOISE), affordable, MOST_PHOTONS)
    photons = int(max(_round(wanted), FEWEST_PHOTONS))
    return Foretold(
        photons,
        float(radius),
        predict_error.noise(lit, radius, photons),
        predict_error.bias(model, lit, radius),
        before + each * photons,
    )


def _pilot(model: Model) -> tuple[predict_error.Pilot, float]:
    """Return a small trace and the share of its photons that hit nothing."""
    m = model
    paths, _ = trace_background(m.accelerator, m.world, m.static, m.emitters, PILOT_SEED, 0, PILOT_PHOTONS)
    if not len(m.emitters.kind):
        return predict_error.Pilot(PILOT_PHOTONS, paths, np.zeros((0, 3)), np.zeros((0, 3))), 0.0
    missed = (np.diff(paths.offsets) == 2) & (paths.side[paths.offsets[1:] - 1] == NONE)
    return predict_error.pilot_of(m, paths), float(missed.mean())


def _box(model: Model, hits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if len(hits) >= predict_error.FEWEST:
        return central_box(hits)
    vertices = model.surfaces.vertices[0]
    return box(vertices) if len(vertices) else (np.zeros(3), np.ones(3))


def _round(x: float) -> float:
    """Return x to two significant digits: settings that can be read out and typed in."""
    if x <= 0:
        return x
    unit = 10.0 ** (math.floor(math.log10(x)) - 1)
    return round(x / unit) * unit

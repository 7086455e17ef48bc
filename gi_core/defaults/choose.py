"""Default settings: photons, radius and k of a scene, by one rule.

- Scene size: longest side of the box of the central 98 % of a pilot trace's hits, because a ground slab may be five
  times as wide as the room. The scene file may state it instead, where a dome catches most hits.
- Radius and photons: radii from 2.5 % of the scene size downwards are candidates. Each gets the photons for 2 % noise,
  or for six seconds on two cores, or MOST_PHOTONS, whichever is least. The pair with the lowest predicted error is
  taken (`predict_error.py`, `predict_cost.py`).
- On flat ground that is the largest radius; larger ones would blur shadows. Among furniture smaller discs are better: a
  disc that hangs over an edge collects light of another surface. No radius is below half the distance between
  receivers, over which light is interpolated anyway.
- A given radius gets its photons by the same rule. The radius does not depend on given photons, so runs with different
  photons can be compared.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import box, central_box
from gi_core.defaults import predict_error
from gi_core.defaults.predict_cost import costs
from gi_core.estimators.setting import checked
from gi_core.geometry.sides import NONE
from gi_core.model import Model
from gi_core.photons.paths import PathStore
from gi_core.photons.trace import trace_background

PILOT_PHOTONS, PILOT_PART = 4096, 64  # and photons per part
PILOT_VERTICES = 1 << 20  # enough of them end the pilot: paths in white rooms are long
PILOT_SEED = 0x5EED  # never a seed of the solution: the pilot must be independent of it
RADIUS_SHARE = 0.025  # of the scene's size: largest candidate radius
RADII = 6  # candidates, each 1 / sqrt(2) of the previous one
LEAST_SPACINGS = 0.5  # radius over the distance between receivers
LEAST_NOISE = 0.02  # relative l1: photons are not increased for less noise
MOST_SECONDS = 6.0  # of tracing and estimating: the rest of ten seconds after launch
MOST_PHOTONS = 2_000_000  # 180 MB of paths in a closed room
FEWEST_PHOTONS = 10_000
NEIGHBOURS = 50


class Chosen(NamedTuple):
    """Settings of a solver and the numbers behind them."""

    photons: int
    radius: float  # [m]
    neighbours: int
    scene_size: float  # [m]
    escaped_first: float  # share of pilot photons that hit nothing
    behind_first: float  # share of pilot photons that first hit the back of a one-sided face, which absorbs them
    low: np.ndarray  # (3,) [m], corner of the box of the central hits
    high: np.ndarray
    predicted: Predicted | None  # of tangent_plane with the rule's photons for that radius; None: too few hits
    noise_per_photon: float  # relative l1 noise of tangent_plane times the root of the photons; 0: too few hits


class Predicted(NamedTuple):
    """Predicted error and time of a radius and a number of photons."""

    photons: int
    radius: float  # [m]
    noise: float  # relative l1 error
    bias: float
    seconds: float  # of tracing and estimating

    @property
    def error(self) -> float:
        return math.hypot(self.noise, self.bias)


def choose(model: Model, photons: int | None, radius: float | None, neighbours: int | None) -> Chosen:
    """Return the settings of a scene; None arguments come from the scene file, else from the rule. radius [m].

    Raises SceneError for a value beyond its range, given or in the file.
    """
    recommended, where = model.scene.defaults, f"{model.scene.name}: defaults: "
    photons, radius, neighbours = (
        checked(name, value, checked(name, getattr(recommended, name), where=where))
        for name, value in (("photons", photons), ("radius", radius), ("neighbours", neighbours))
    )
    pilot, first_flight = _pilot(model)
    low, high = _box(model, pilot.hits)
    size = recommended.scene_size or max(float((high - low).max()), 1e-9)
    predicted, noise_per_photon = None, 0.0
    if len(pilot.hits) >= predict_error.FEWEST:
        lit = predict_error.places(model, pilot, low, high, size)
        if radius is None or photons is None:
            predicted = _best(model, pilot, lit, size, radius)
            radius = predicted.radius
        noise_per_photon = math.sqrt(FEWEST_PHOTONS) * predict_error.noise(lit, radius, FEWEST_PHOTONS)
    return Chosen(
        (predicted.photons if predicted else FEWEST_PHOTONS) if photons is None else int(photons),  # may be 0
        float(radius or _round(RADIUS_SHARE * size)),
        int(neighbours or NEIGHBOURS),
        size,
        *first_flight,
        low + model.origins[0],
        high + model.origins[0],
        predicted,
        noise_per_photon,
    )


def _best(model: Model, pilot, lit, size: float, radius: float | None) -> Predicted:
    """Return the candidate with the lowest predicted error, or that of the given radius [m]."""
    if radius:
        return _predict(model, pilot, lit, radius)
    largest = RADIUS_SHARE * size
    least = min(largest, LEAST_SPACINGS * lit.spacing)
    radii = [largest * 0.5 ** (k / 2) for k in range(RADII)]
    tried = [_predict(model, pilot, lit, _round(r)) for r in radii if r >= least]
    return min(tried, key=lambda f: f.error)


def _predict(model: Model, pilot, lit, radius: float) -> Predicted:
    before, each = costs(model, pilot.paths, radius)
    affordable = max(MOST_SECONDS - before, 0.5 * MOST_SECONDS) / each
    wanted = min(predict_error.photons_for(lit, radius, LEAST_NOISE), affordable, MOST_PHOTONS)
    photons = int(max(_round(wanted), FEWEST_PHOTONS))
    return Predicted(
        photons,
        float(radius),
        predict_error.noise(lit, radius, photons),
        predict_error.bias(model, lit, radius),
        before + each * photons,
    )


def _pilot(model: Model) -> tuple[predict_error.Pilot, tuple[float, float]]:
    """Return a pilot trace, and the shares of its photons that hit nothing, and that first hit a one-sided back."""
    m, store = model, PathStore()
    while store.photons < PILOT_PHOTONS and len(store.subset(store.photons).side) < PILOT_VERTICES:
        part = PILOT_SEED, store.photons, PILOT_PART
        store.append([trace_background(m.accelerator, m.world, m.static, m.emitters, *part)[0]], 1)
    paths = store.subset(store.photons)
    if not len(m.emitters.kind):
        return predict_error.Pilot(PILOT_PHOTONS, paths, np.zeros((0, 3)), np.zeros((0, 3))), (0.0, 0.0)
    first = paths.side[paths.offsets[:-1] + 1]
    behind = (first != NONE) & (first & 1 == 1) & ~m.world.two_sided[first >> 1]
    return predict_error.pilot_of(m, paths), (float((first == NONE).mean()), float(behind.mean()))


def _box(model: Model, hits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if len(hits) >= predict_error.FEWEST:
        return central_box(hits)
    vertices = model.surfaces.vertices[0]
    return box(vertices) if len(vertices) else (np.zeros(3), np.ones(3))


def _round(x: float) -> float:
    """Return x rounded to two significant digits: the number that those digits mean when they are typed."""
    return float(f"{x:.2g}")

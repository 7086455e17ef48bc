"""Default settings: photons, radius and k of a scene, by one rule.

- Scene size: longest side of the box of the central 98 % of a pilot trace's hits, lamps aside. A ground slab may be
  five times as wide as the room, and a sky may be a mesh. The scene file may state it instead.
- Radius and photons: radii from 2.5 % of the scene size downwards are candidates. Each gets the photons for 2 % noise,
  or for six seconds on two cores, or MOST_PHOTONS, whichever is least. The pair with the lowest predicted error is
  taken.
- On flat ground that is the largest radius; larger ones would blur shadows. Among furniture smaller discs are better: a
  disc that hangs over an edge collects light of another surface. No radius is below half the distance between
  receivers, over which light is interpolated anyway.
- k is the median of the hits on a disc: photon_map then smooths as much as the discs beside it. A frame of cornell's
  1.8 million photons takes 3.2 s of processor time for 1000 in place of 0.65 s for 50; frames within a budget have
  fewer hits than that.
- A given radius gets its photons by the same rule. The radius does not depend on given photons, so runs with different
  photons can be compared.

The error of an estimate on tangent discs follows from two formulas with measured constants
(docs/decisions/default-settings.md):

- Noise is that of counting: a disc that expects n photons has a relative error of sqrt(2 / (pi n)). Where light is
  dense n is large; the mean over places where photons land is the L1 error. The Sobol sequence removes a sixth of it.
- Bias comes from discs that do not lie on free, even ground: an object cuts their plane, or nothing is below their
  rim. Such a disc reads the light of another surface, with an error of some 40 %. On even ground discs blur only the
  edges of shadows, which costs far less.

Time goes into path tracing, grid traversal of the disc index, and disc tests. Cells and tests per photon are counted on
samples of discs and segments in a grid of cells of CELL_RADII, and multiplied by their costs. The costs are constants,
not timings, so a scene gets the same settings on every machine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.nearest_points import nearest
from gi_core.discs.search.disc_index import CELL_RADII, MOST_ALONG
from gi_core.estimators.base import checked
from gi_core.geometry.receivers import NONE
from gi_core.model import BEHIND, Model
from gi_core.photons.paths import PathVertices, segments_of
from gi_core.photons.pilot import FEWEST_HITS, Pilot

RADIUS_SHARE = 0.025  # of the scene's size: largest candidate radius
LEAST_NOISE = 0.02  # relative l1: photons are not increased for less noise
MOST_SECONDS = 6.0  # of tracing and estimating: the rest of ten seconds after launch
MOST_PHOTONS = 2_000_000  # 180 MB of paths in a closed room
FEWEST_PHOTONS = 10_000
NEIGHBOURS, MOST_NEIGHBOURS = 50, 1000  # k without a prediction, and at most
SOBOL = 0.82  # noise of the Sobol sequence over that of independent photons: 0.74 to 0.90 in six scenes
RIM = 0.7  # of the radius: half of a disc's area lies inside


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
    pilot = model.pilot
    (low, high, *_), size = model.lit_part, model.scene_size
    predicted = None
    if len(pilot.hits) >= FEWEST_HITS:
        lit = places(model, pilot, low, high, size)
        if radius is None or photons is None:
            predicted = _best(model, pilot, lit, size, radius)
            radius = predicted.radius
    if photons is None:
        photons = predicted.photons if predicted else FEWEST_PHOTONS
    if neighbours is None and len(pilot.hits) >= FEWEST_HITS:
        on_disc = photons * math.pi * radius * radius * float(np.median(lit.density))
        neighbours = min(max(int(_round(on_disc)), NEIGHBOURS), MOST_NEIGHBOURS)
    return Chosen(
        int(photons),  # may be 0
        float(radius or _round(RADIUS_SHARE * size)),
        int(neighbours or NEIGHBOURS),
        size,
        *_first_flight(model, pilot),
        low + model.origins[0],
        high + model.origins[0],
        predicted,
    )


def _best(model: Model, pilot: Pilot, lit: Places, size: float, radius: float | None) -> Predicted:
    """Return the candidate with the lowest predicted error, or that of the given radius [m]."""
    if radius:
        return _predict(model, pilot, lit, radius)
    largest = RADIUS_SHARE * size
    least = min(largest, 0.5 * lit.spacing)  # least radius: 0.5 of the distance between receivers
    radii = [largest * 0.5 ** (k / 2) for k in range(6)]  # 6 candidates, each 1 / sqrt(2) of the previous one
    tried = [_predict(model, pilot, lit, _round(r)) for r in radii if r >= least]
    return min(tried, key=lambda f: f.error)


def _predict(model: Model, pilot: Pilot, lit: Places, radius: float) -> Predicted:
    before, each = costs(model, pilot.paths, radius)
    affordable = max(MOST_SECONDS - before, 0.5 * MOST_SECONDS) / each
    wanted = min(photons_for(lit, radius, LEAST_NOISE), affordable, MOST_PHOTONS)
    photons = int(max(_round(wanted), FEWEST_PHOTONS))
    return Predicted(
        photons, float(radius), noise(lit, radius, photons), bias(model, lit, radius), before + each * photons
    )


def _first_flight(model: Model, pilot: Pilot) -> tuple[float, float]:
    """Return the shares of photons that hit nothing, and that first hit a one-sided back."""
    if not len(model.emitters.kind):
        return 0.0, 0.0
    behind = (pilot.first != NONE) & (pilot.first & 1 == 1) & ~model.world.two_sided[pilot.first >> 1]
    return float((pilot.first == NONE).mean()), float(behind.mean())


def _round(x: float) -> float:
    """Return x rounded to two significant digits: the number that those digits mean when they are typed."""
    return float(f"{x:.2g}")


# Error ----------------------------------------------------------------------------------------------


class Places(NamedTuple):
    """Lit places: a sample of hits of equal flux."""

    positions: np.ndarray  # (n, 3) float64 [m]
    normals: np.ndarray  # (n, 3) float64 unit, of the side that was hit
    density: np.ndarray  # (n,) float64, hits per photon and area there [1/m2]
    spacing: float  # [m] median distance between receivers there


def places(model: Model, pilot: Pilot, low: np.ndarray, high: np.ndarray, size: float) -> Places:
    """Return lit places in the box; only those in view of the scene's camera, if these are enough."""
    inside = ((pilot.hits >= low) & (pilot.hits <= high)).all(axis=1)
    rows = np.flatnonzero(inside if inside.sum() >= FEWEST_HITS else np.ones(len(inside), bool))
    seen = rows[_seen(model, pilot.hits[rows], pilot.normals[rows])]
    rows = seen if len(seen) >= FEWEST_HITS else rows
    rows = rows[np.linspace(0, len(rows) - 1, min(2000, len(rows))).astype(np.int64)]  # 2000 lit places sampled
    # Distances include normals, so hits on the other side of a board count as far away.
    # a difference of 1 between normals counts as 0.3 of the scene's size
    apart = np.concatenate([pilot.hits, 0.3 * size * pilot.normals], axis=1)
    k = min(8, len(apart) - 1)  # 8 nearest hits of a density estimate
    reach, _ = nearest(apart, apart[rows], k + 1)  # the nearest is the hit itself
    density = k / (math.pi * np.maximum(reach, 1e-6 * size) ** 2 * pilot.photons)
    static = model.surfaces.receiver_range(0)
    _, receivers = nearest(model.object_receivers.positions[static], pilot.hits[rows])
    spacing = float(np.sqrt(np.median(model.object_receivers.areas[static][receivers])))
    return Places(pilot.hits[rows], pilot.normals[rows], density, spacing)


def _seen(model: Model, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return which points (n,) bool the scene's camera sees; none without a camera. A picture is half as wide again."""
    camera = model.scene.camera
    if camera is None or not len(points):
        return np.zeros(len(points), bool)
    eye, forward = (np.array(v, np.float64) for v in (camera.position, camera.target))
    forward = (forward - eye) / max(float(np.linalg.norm(forward - eye)), 1e-30)
    way = eye - points
    distance = np.maximum(np.sqrt((way * way).sum(axis=1)), 1e-30)
    way /= distance[:, None]
    ahead = -(way @ forward) > math.cos(math.radians(0.75 * camera.vertical_fov_degrees))
    facing = (way * normals).sum(axis=1) > 0
    _, face = _nearest(model, points + 1e-3 * distance[:, None] * way, way, distance * (1 - 2e-3))
    return ahead & facing & (face < 0)


def noise(lit: Places, radius: float, photons: float) -> float:
    """Return the relative L1 error from counting that many photons on discs of that radius."""
    expected = lit.density * math.pi * radius * radius * photons
    # A disc that expects hardly any photons has an error of at most twice its light: other discs get nearly all.
    return float(np.minimum(SOBOL * np.sqrt(2 / math.pi / np.maximum(expected, 1e-30)), 2.0).mean())


def photons_for(lit: Places, radius: float, wanted: float) -> float:
    """Return the photons for which noise() is `wanted`."""
    return (noise(lit, radius, 1e12) / wanted) ** 2 * 1e12


def bias(model: Model, lit: Places, radius: float) -> float:
    """Return the relative l1 bias, which no number of photons removes; radius [m]."""
    return 0.4 * uneven(model, lit, radius)  # 0.4 of the light on uneven ground: 0.2 to 0.8 in six scenes


def uneven(model: Model, lit: Places, radius: float) -> float:
    """Return the share of light at places whose disc is not entirely on free, flat ground; radius [m]."""
    rim_directions = 8  # around a lit place
    n = lit.normals
    axis = np.eye(3)[np.abs(n).argmin(axis=1)]
    u = np.cross(n, axis)
    u /= np.sqrt((u * u).sum(axis=1))[:, None]
    v = np.cross(n, u)
    angle = 2 * math.pi * np.arange(rim_directions) / rim_directions
    out = np.cos(angle)[:, None, None] * u + np.sin(angle)[:, None, None] * v
    # 0.05 of the radius above the ground: lower obstacles hide little of a disc
    start = np.broadcast_to(lit.positions + 0.05 * radius * n, out.shape)
    free, _ = _nearest(model, start.reshape(-1, 3), out.reshape(-1, 3), np.full(out[..., 0].size, RIM * radius))
    rim = start + RIM * radius * out
    down = np.broadcast_to(-n, out.shape)
    # 0.3 of the radius below the disc: lower ground is another surface
    _, ground = _nearest(model, rim.reshape(-1, 3), down.reshape(-1, 3), np.full(len(free), 0.3 * radius))
    return float(((free < np.float32(RIM * radius)) | (ground < 0)).mean())


def _nearest(model: Model, origins, directions, limits):
    return model.accelerator.opaque.nearest(
        0, np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32),
        np.asarray(limits, np.float32),
    )  # fmt: skip


# Cost -----------------------------------------------------------------------------------------------


def costs(model: Model, paths: PathVertices, radius: float) -> tuple[float, float]:
    """Return the seconds before the first photon, and the seconds per photon. `paths`: pilot trace; radius [m]."""
    photons = len(paths.offsets) - 1
    segments = (len(paths.side) - photons) / photons
    cells, tests = work(model, paths, radius)
    # Nanoseconds of one thread, two cores of an AMD EPYC with both hyperthreads busy: see default-settings.md. Measure
    # again when kernels change much. Precision is not needed: noise follows the root of the time.
    a_segment, a_cell, a_test = 1150.0, 15.0, 4.5  # a segment with its line; a disc's test takes 3 to 10 in five scenes
    a_photon = a_segment * segments + a_cell * cells + a_test * tests
    regions = 15_000.0 * len(model.object_receivers.areas)
    return 1e-9 / 2 * regions, 1e-9 / 2 * a_photon  # of 2 threads


def work(model: Model, paths: PathVertices, radius: float) -> tuple[float, float]:
    """Return the cells traversed and the static discs tested per photon, means over the pilot trace; radius [m]."""
    rows = np.flatnonzero(model.backs(0) != BEHIND) + model.surfaces.receiver_range(0).start
    stands_for = max(1, len(rows) // (1 << 14))  # 1 << 14 receivers sampled
    rows = rows[::stands_for]
    photons = len(paths.offsets) - 1
    segments = segments_of(paths, 0, photons)
    if not len(rows) or not segments.size:
        return 0.0, 0.0
    p, n = model.object_receivers.positions[rows], model.object_receivers.normals[rows]
    half = radius * np.sqrt(np.clip(1 - n * n, 0, 1))
    low, high = (p - half).min(axis=0), (p + half).max(axis=0)
    cell = max(CELL_RADII * radius, float((high - low).max()) / MOST_ALONG)
    keys, discs = _listed((p - half - low) / cell, (p + half - low) / cell)
    step = max(1, segments.size // (1 << 14))  # 1 << 14 segments sampled
    start, way = _clipped(segments.origin[::step], segments.end[::step], low, high)
    passed = np.where(way.any(axis=1), 1 + np.abs(way).sum(axis=1) / cell, 0)
    # One point per segment: on average the other cells of the segment hold as many discs.
    # golden ratio - 1: its multiples modulo 1 are evenly spread
    at = start + (np.arange(len(start)) * 0.6180339887498949 % 1)[:, None] * way
    at = _key(np.floor((at - low) / cell).astype(np.int64))
    place = np.searchsorted(keys, at).clip(0, len(keys) - 1)
    discs_listed = np.where(keys[place] == at, discs[place], 0) * stands_for
    a_photon = segments.size / len(start) / photons
    return float(passed.sum()) * a_photon, float((passed * discs_listed).sum()) * a_photon


def _listed(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return keys of cells, ascending, and the number of boxes low .. high (n, 3) [cells] that touch each.

    A box is smaller than a cell, so it touches at most two cells per axis.
    """
    first, last = np.floor(low).astype(np.int64), np.floor(high).astype(np.int64)
    touched = []
    for corner in range(8):
        far = np.array([corner & 1, corner & 2, corner & 4]) > 0
        distinct = ((last > first) | ~far).all(axis=1)
        touched.append(_key(np.where(far, last, first)[distinct]))
    return np.unique(np.concatenate(touched), return_counts=True)


def _clipped(origin, end, low, high) -> tuple[np.ndarray, np.ndarray]:
    """Return start and extent (n, 3) float64 of the part of each segment inside the box; extent 0 if none."""
    start, end = origin.astype(np.float64), end.astype(np.float64)
    way = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - start) / way, (high - start) / way
    # On an axis with zero extent a segment is inside (-inf, inf) or outside (inf, inf); nan: on the border.
    t0 = np.nan_to_num(np.minimum(a, b), nan=0.0).max(axis=1).clip(0, 1)
    t1 = np.nan_to_num(np.maximum(a, b), nan=1.0).min(axis=1).clip(0, 1)
    return start + t0[:, None] * way, np.maximum(t1 - t0, 0)[:, None] * way


def _key(cell: np.ndarray) -> np.ndarray:
    """Return a key (n,) int64 per cell (n, 3) int64."""
    return (cell[:, 0] * (1 << 21) + cell[:, 1]) * (1 << 21) + cell[:, 2]

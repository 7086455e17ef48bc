"""Predicted time of tracing photons and of estimating on tangent discs, from a pilot trace.

Time goes into path tracing, grid traversal of the disc index, and disc tests. Cells and tests per photon are counted on
samples of discs and segments in a grid of cells of CELL_RADII, and multiplied by their costs. The costs are constants,
not timings, so a scene gets the same settings on every machine.
"""

from __future__ import annotations

import numpy as np

from gi_core.discs.search.disc_grid import CELL_RADII, MOST_ALONG
from gi_core.model import BEHIND, Model
from gi_core.photons.paths import PathVertices, segments_of

DISCS = 1 << 14  # receivers sampled
LINES = 1 << 14  # segments sampled
SPREAD = 0.6180339887498949  # golden ratio - 1: its multiples modulo 1 are evenly spread

# Nanoseconds of one thread, two cores of an AMD EPYC with both hyperthreads busy: see default-settings.md.
# Measure again when kernels change much. Precision is not needed: noise follows the root of the time.
SEGMENT_NS = 1150.0  # tracing one segment, and preparing its line
CELL_NS = 15.0  # traversing a cell
TEST_NS = 4.5  # testing a disc, with accumulation: 3 to 10 in five scenes
RECEIVER_NS = 15_000.0  # measuring a receiver's region
THREADS = 2


def costs(model: Model, paths: PathVertices, radius: float) -> tuple[float, float]:
    """Return the seconds before the first photon, and the seconds per photon. `paths`: pilot trace; radius [m]."""
    photons = len(paths.offsets) - 1
    segments = (len(paths.side) - photons) / photons
    cells, tests = work(model, paths, radius)
    a_photon = SEGMENT_NS * segments + CELL_NS * cells + TEST_NS * tests
    return 1e-9 / THREADS * RECEIVER_NS * len(model.object_receivers.areas), 1e-9 / THREADS * a_photon


def work(model: Model, paths: PathVertices, radius: float) -> tuple[float, float]:
    """Return the cells traversed and the static discs tested per photon, means over the pilot trace; radius [m]."""
    rows = np.flatnonzero(model.backs(0) != BEHIND) + model.surfaces.receiver_range(0).start
    stands_for = max(1, len(rows) // DISCS)
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
    step = max(1, segments.size // LINES)
    start, way = _clipped(segments.origin[::step], segments.end[::step], low, high)
    passed = np.where(way.any(axis=1), 1 + np.abs(way).sum(axis=1) / cell, 0)
    # One point per segment: on average the other cells of the segment hold as many discs.
    at = start + (np.arange(len(start)) * SPREAD % 1)[:, None] * way
    at = _key(np.floor((at - low) / cell).astype(np.int64))
    place = np.searchsorted(keys, at).clip(0, len(keys) - 1)
    found = np.where(keys[place] == at, discs[place], 0) * stands_for
    a_photon = segments.size / len(start) / photons
    return float(passed.sum()) * a_photon, float((passed * found).sum()) * a_photon


def _listed(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return keys of cells, ascending, and the number of boxes low .. high (n, 3) [cells] that touch each.

    A box is smaller than a cell, so it touches at most two cells per axis.
    """
    first, last = np.floor(low).astype(np.int64), np.floor(high).astype(np.int64)
    touched = []
    for corner in range(8):
        far = np.array([corner & 1, corner & 2, corner & 4]) > 0
        there = ((last > first) | ~far).all(axis=1)
        touched.append(_key(np.where(far, last, first)[there]))
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

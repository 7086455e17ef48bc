"""Structures of rays, timed by the same rays in one thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.rays.accelerator import _nearest, _occluded
from gi_core.rays.leaf_boxes import LeafBoxes, visited
from gi_core.rays.structures import STRUCTURES, new_ray
from gi_core.rays.triangles import CELLS, TESTS, Meshes

SLOW = 100  # times fewer rays for `none`


class Rays(NamedTuple):
    """Rays of one kind."""

    origin: np.ndarray  # (n, 3) float32
    direction: np.ndarray  # (n, 3) float32, unit
    limit: np.ndarray  # (n,) float32
    any_hit: bool  # whether a hit of any triangle will do


class Structure(NamedTuple):
    """A structure built over the static part of a scene, with its cost."""

    name: str
    scenes: object
    build_seconds: float
    bytes: int  # 0 for Embree, which does not say


class Cost(NamedTuple):
    """Cost per ray. Cells and triangles are 0 for Embree, which does not count them."""

    seconds: float
    cells: float
    tests: float


def built(name: str, meshes: Meshes) -> Structure:
    """Return a structure of static meshes. A triangle is built before, which compiles."""
    module = STRUCTURES[name]
    module.build([(np.eye(3), np.array([[0, 1, 2]], np.int32))])
    before = time.thread_time()
    scenes = module.build(meshes)
    seconds = time.thread_time() - before
    return Structure(name, scenes, seconds, 0 if isinstance(scenes, np.ndarray) else _bytes(scenes))


def _bytes(record) -> int:
    return record.nbytes if isinstance(record, np.ndarray) else sum(map(_bytes, record))


def run_of(structure: Structure, rays: Rays, all_rays: bool = False) -> Callable[[], Cost]:
    """Return a function that casts rays of a kind, for `none` one in SLOW or `all_rays`, and returns their cost."""
    n = max(1, len(rays.origin) // (SLOW if structure.name == "none" and not all_rays else 1))
    o, d, limit = (a[:n] for a in rays[:3])
    ray, distance, face, blocked = new_ray(), np.empty(n, np.float32), np.empty(n, np.int32), np.empty(n, bool)

    def run() -> Cost:
        ray.view(np.int32)[[CELLS, TESTS]] = 0
        before = time.thread_time()
        if rays.any_hit:
            _occluded(structure.scenes, 0, ray, o, d, limit, blocked)
        else:
            _nearest(structure.scenes, 0, 0, ray, o, d, limit, distance, face)
        seconds = (time.thread_time() - before) / n
        cells, tests = ray.view(np.int32)[[CELLS, TESTS]] / n if structure.bytes else (0.0, 0.0)
        return Cost(seconds, float(cells), float(tests))

    return run


def boxes_crossed(low: np.ndarray, high: np.ndarray, rays: Rays) -> np.ndarray:
    """Return the number (n,) of boxes, with corners (m, 3) [m], that each ray crosses."""
    boxes = LeafBoxes(low, high, np.ones(len(low), np.int64))
    ends = zip(rays.origin, rays.direction, rays.limit, strict=True)
    return np.array([visited(boxes, o, d, float(limit)).sum() for o, d, limit in ends])

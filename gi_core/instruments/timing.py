"""Timing outside of frames, in one thread: ray structures by the same rays, disc searches by the same segments."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from gi_core.discs.region import whole_discs
from gi_core.discs.search import SEARCHES, Search
from gi_core.discs.search.disc_index import DiscIndex
from gi_core.discs.search.predicate import Discs, Lines, lines
from gi_core.files.completion.camera_view import picture_rays, unit
from gi_core.lights.emission import emit
from gi_core.model import Model
from gi_core.photons.flux_sums import Sums
from gi_core.photons.paths import Segments, concatenate, segments_of
from gi_core.rays.accelerator import _nearest, _occluded
from gi_core.rays.leaf_boxes import LeafBoxes, visited
from gi_core.rays.structures import STRUCTURES, new_ray
from gi_core.rays.triangles import CELLS, TESTS, Meshes
from gi_core.scene.types import Camera
from gi_core.solver import Solver

__all__ = [
    "KINDS", "LEAVES", "REPEATS", "SEARCHES", "STRUCTURES", "Cost", "Rays", "Structure", "boxes_crossed",
    "built", "cells_of", "costs", "frame_lines", "photon_lines", "rays_of", "run_of", "search_run", "static_discs",
]  # fmt: skip
KINDS = ("primary", "random", "shadow")
# Leaf sizes to try, the best one of each structure among them; () where it has no meaning.
LEAVES = {
    "bvh": (1, 2, 4, 8, 15), "octree": (2, 4, 8, 16, 32), "binary_tree": (1, 2, 4, 8, 16), "bsp": (1, 2, 4, 8, 16),
    "grid3d": (0.0625, 0.125, 0.25, 0.5, 1, 2),
}  # fmt: skip
SLOW = 100  # times fewer rays for `none`
REPEATS = 5  # of a measurement; the least time counts


class Rays(NamedTuple):
    """Rays of one kind."""

    origin: np.ndarray  # (n, 3) float32
    direction: np.ndarray  # (n, 3) float32, unit
    limit: np.ndarray  # (n,) float32
    any_hit: bool  # whether a hit of any triangle will do


class Structure(NamedTuple):
    """A structure built over the static part of a scene, with its cost."""

    name: str
    leaf: float | None  # None: its own
    scenes: object
    build_seconds: float
    bytes: int  # 0 for Embree, which does not say


class Cost(NamedTuple):
    """Cost per ray. Cells and triangles are 0 for Embree, which does not count them."""

    seconds: float
    cells: float
    tests: float


def rays_of(model: Model, camera: Camera, n: int) -> dict[str, Rays]:
    """Return rays by kind: through the pixels of a picture, on from the hits of photons, from there to points on lamps.

    Photons find the lit side of walls, where the camera may stand outside.
    """
    timing_seed = 0  # of the rays
    rng, far = np.random.default_rng(timing_seed), np.float32(4 * model.world.size)
    columns = math.isqrt(n)
    d = picture_rays([camera], model.scene.up, columns, columns)[0].astype(np.float32)
    o = np.broadcast_to(np.asarray(camera.position, np.float64) - model.origins[0], d.shape).astype(np.float32)
    limits = np.full(n, far)
    primary = Rays(o, d, limits[: len(d)], False)
    o, d = emit(model.emitters, timing_seed, 0, n)[:2]
    distance, face = model.accelerator.nearest(0, o + 1e-5 * far * d, d, limits)
    hit = face >= 0
    normal = model.surfaces.normals[face[hit]]
    toward = np.sign((normal * d[hit]).sum(axis=1))[:, None]
    start = (o[hit] + distance[hit, None] * d[hit] - 1e-5 * model.world.size * toward * normal).astype(np.float32)
    on = unit(rng.normal(size=start.shape))
    on *= -np.sign((on * toward * normal).sum(axis=1))[:, None]
    lamp = emit(model.emitters, timing_seed, n, len(start))[0].astype(np.float64) - start
    length = np.sqrt((lamp * lamp).sum(axis=1))
    return {
        "primary": primary,
        "random": Rays(start, on.astype(np.float32), limits[: len(start)], False),
        "shadow": Rays(start, unit(lamp).astype(np.float32), (length * (1 - 1e-4)).astype(np.float32), True),
    }


def built(name: str, meshes: Meshes, leaf: float | None = None) -> Structure:
    """Return a structure of static meshes. A triangle is built before, which compiles."""
    module = STRUCTURES[name]
    size = () if leaf is None else (leaf,)
    module.build([(np.eye(3), np.array([[0, 1, 2]], np.int32))], *size)
    before = time.thread_time()
    scenes = module.build(meshes, *size)
    seconds = time.thread_time() - before
    return Structure(name, leaf, scenes, seconds, 0 if isinstance(scenes, np.ndarray) else _bytes(scenes))


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


def costs(structures: list[Structure], rays: dict[str, Rays], repeats: int = REPEATS) -> list[dict[str, Cost]]:
    """Return the cost by kind of ray of each structure: the least of `repeats`, taken in turn."""
    runs = [{kind: run_of(s, r) for kind, r in rays.items()} for s in structures]
    out = [{kind: run() for kind, run in own.items()} for own in runs]  # compiles
    for turn in range(repeats):
        for k, own in enumerate(runs):
            for kind, run in own.items():
                cost = run()
                out[k][kind] = cost if turn == 0 else min(out[k][kind], cost)
    return out


def boxes_crossed(low: np.ndarray, high: np.ndarray, rays: Rays) -> np.ndarray:
    """Return the number (n,) of boxes, with corners (m, 3) [m], that each ray crosses."""
    boxes = LeafBoxes(low, high, np.ones(len(low), np.int64))
    ends = zip(rays.origin, rays.direction, rays.limit, strict=True)
    return np.array([visited(boxes, o, d, float(limit)).sum() for o, d, limit in ends])


def cells_of(search: Search) -> tuple[float, float] | None:
    """Return the edge of a grid's cells [radii] and the discs per occupied cell; None for a search without a grid."""
    return (search.cell_radii, search.discs_a_cell) if isinstance(search, DiscIndex) else None


def static_discs(model: Model, radius: float, materials: Iterable[str] | None = None) -> Discs:
    """Return the discs of the static part's receivers, as whole discs; only those on the named materials take part.

    Receivers between two materials belong to both.
    """
    rows, s = model.surfaces.receiver_range(0), model.surfaces
    region = whole_discs(model, 0, radius)
    if materials is not None:
        named = [k for k, m in enumerate(model.scene.materials) if m.name in set(materials)]
        faces = np.flatnonzero(np.isin(model.scene.static.face_material, named))
        meant = np.zeros(rows.stop - rows.start, bool)
        for corners in (s.corner_front[faces].reshape(-1), s.corner_back[faces].reshape(-1)):
            meant[corners[corners >= 0]] = True
        region.area[~meant] = 0.0
    r = model.object_receivers
    positions, normals = (np.ascontiguousarray(a[rows], np.float32) for a in (r.positions, r.normals))
    return Discs(positions, normals, model.receiver_sides[rows], model.backs(0), np.float32(radius), region)


def photon_lines(solver: Solver, photons: int, radius: float) -> Lines:
    """Return all background segments of the first `photons` traced photons, prepared for static discs."""
    paths = solver.frame.store.subset(photons)[0]
    return _ready(solver, segments_of(paths, 0, photons), radius)


def frame_lines(solver: Solver, radius: float) -> Lines:
    """Return the removed and new suffixes of the solver's current frame, prepared for static discs."""
    change = solver.frame.change
    return _ready(solver, concatenate([change.removed_suffixes.segments(), change.new_suffixes]), radius)


def _ready(solver: Solver, segments: Segments, radius: float) -> Lines:
    at = solver.model.static
    return lines(segments, at.rotation[0], at.position[0], solver.model, radius)


def search_run(search: Search, over: Lines) -> Callable[[], int]:
    """Return a call that adds the lines to scratch sums on one thread; it returns the number of intersections."""
    sums = Sums.zeros(len(search.discs.positions), 3 + 3 * int(over.lamp.max(initial=0)))
    return lambda: search.accumulate(over, 1, sums)

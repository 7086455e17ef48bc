"""Rays at glossy receivers, kept one by one: the list of report 2.10 and the QuadTree with all rays."""

import math

import numpy as np
import pytest

from gi_core.bsdf.table import join
from gi_core.frames.light_setting import ALL_RAYS, LIST, OPENED, QUADTREE
from gi_core.geometry.surfaces import glossy_receivers
from gi_core.gloss.hemisphere import CELLS, cell_of
from gi_core.gloss.light import Directions, gloss_radiance, room_for
from gi_core.gloss.rays import RayTree
from gi_core.gloss.sharp import is_sharp
from gi_core.retrace.cuts import current_segments
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Pose
from gi_core.solver import Solver
from tests.physics.test_gloss import GIVEN, ROOM
from tests.support.scene_builders import solve
from tests.unit.gloss.test_cells import directions, of_cells


def solved(**more) -> Solver:
    return solve(ROOM, **GIVEN | {"gloss": LIST} | more)


def wander(solver: Solver, moves: int, seed: int = 8) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(moves):
        solver.move("ball", Pose(tuple(rng.random(3)), axis_angle((0, 1, 1), 360 * rng.random())))


def scratch_of(solver: Solver, photons: int | None = None) -> RayTree:
    change = solver.frame.change
    segments, _ = current_segments(solver.model, change.at, solver.seed, 0, photons or solver.photons)
    return solver.frame_light.gloss.source.lists(solver.setting.radius).from_scratch([segments], change.at)


def same(found: RayTree, scratch: RayTree) -> bool:
    """Whether the static receivers have the same rays, bit for bit."""
    n = len(scratch.offsets)
    return np.array_equal(found.offsets[:n], scratch.offsets) and np.array_equal(
        found.rays[: len(scratch.rays)], scratch.rays
    )


@pytest.mark.slow
def test_lists_equal_those_from_scratch_after_many_moves(estimator):
    solver = solved(estimator=estimator)
    start = solver.frame.gloss.tree
    wander(solver, 12)
    found = solver.frame.gloss.tree
    assert same(found, scratch_of(solver)) and not np.array_equal(found.rays, start.rays)
    solver.move_all(Solver(ROOM, **GIVEN).poses)
    back = solver.frame.gloss.tree
    assert np.array_equal(back.rays, start.rays) and np.array_equal(back.offsets, start.offsets)


@pytest.mark.slow
def test_a_frame_of_few_photons_has_their_rays_where_anything_changed():
    solver = solved(photons=20_000)
    lists, rest = solver.frame_light.gloss.source.lists(solver.setting.radius), solver.frame.gloss.tree
    few = solver.frame.subsets[0]
    solver.move_all({"ball": Pose((0.4, 0.5, 0.3))}, photons=few)
    found = solver.frame.gloss.tree
    fresh = solved(photons=20_000)
    fresh.configure(photons=few)
    fresh.solve()
    fresh.move("ball", Pose((0.4, 0.5, 0.3)))
    alone, changed = fresh.frame.gloss.tree, 0
    for i in range(lists.discs.count(0)):
        a, b, c = (t.rays[t.offsets[i * CELLS] : t.offsets[(i + 1) * CELLS]] for t in (found, alone, rest))
        assert np.array_equal(a, b) or np.array_equal(a, c)
        changed += np.array_equal(a, b)
    assert changed > 0


def test_cells_are_the_sums_of_their_rays():
    solver = solved()
    wander(solver, 2)
    light = solver.frame.gloss
    cells, offsets, rays, *_ = light.directions()
    lit = np.flatnonzero(np.diff(offsets) > 0)
    sums = np.add.reduceat(rays, offsets[lit], axis=0)
    np.testing.assert_allclose(sums[:, :3], cells.reshape(-1, 6)[lit, :3], atol=2e-5)
    for place in lit[:: len(lit) // 50]:
        normal = solver.model.object_receivers.normals[light.rows[place // CELLS]]
        mean = rays[offsets[place] : offsets[place + 1], 3:].mean(axis=0)
        assert mean @ normal > 0 and mean @ cells.reshape(-1, 6)[place, 3:] > 0.8


def random_light(n: int, seed: int) -> tuple[np.ndarray, RayTree]:
    """Return cells (1, CELLS, 6) and rays of n random rays at one receiver, most of them near one direction."""
    rng = np.random.default_rng(seed)
    some = directions(n)
    some[: n // 2] = some[0] + 0.15 * rng.standard_normal((n // 2, 3))
    some[:, 2] = np.abs(some[:, 2])
    some /= np.linalg.norm(some, axis=1)[:, None]
    flux = rng.random((n, 3)) + 0.1
    cell = np.array([cell_of(*d) for d in some])
    order = np.argsort(cell, kind="stable")
    rays = np.c_[flux / flux.sum(axis=0), some][order].astype(np.float32)
    offsets = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=CELLS))])
    cells = np.zeros((1, CELLS, 6))
    np.add.at(cells[0, :, :3], cell, flux / flux.sum(axis=0))
    np.add.at(cells[0, :, 3:], cell, some * flux.sum(axis=1)[:, None])
    cells[0, :, 3:] /= np.maximum(np.linalg.norm(cells[0, :, 3:], axis=1), 1e-9)[:, None]
    return cells, RayTree(offsets, rays)


def seen(given: Directions, alpha: float, cosine: float) -> np.ndarray:
    lobe, up = np.array([[0.5, 0.2, 0.04, 1.0, alpha]]), np.array([[0.0, 0.0, 1.0]])
    eye, out = np.array([math.sqrt(1 - cosine**2), 0.0, cosine]), room_for(1)
    gloss_radiance(given, np.zeros(1, np.int32), np.ones((1, 3)), 0 * up, up, lobe, up, join([]), eye, out)
    return out[0].copy()


@pytest.mark.parametrize("alpha", [0.2, 0.5])
def test_list_sums_the_lobe_over_all_rays_and_the_tree_comes_close(alpha):
    worst = {ALL_RAYS: 0.0, "cells": 0.0}
    for seed in range(10):
        cells, tree = random_light(400, seed)
        for cosine in (0.95, 0.6, 0.3):
            every = seen(Directions(cells.astype(np.float32), *tree, OPENED[LIST]), alpha, cosine)
            alone = of_cells(cells).cells, np.minimum(np.arange(CELLS + 1), 1)  # cell 0 has the one ray
            one_by_one = sum(seen(Directions(*alone, ray[None], OPENED[LIST]), alpha, cosine) for ray in tree.rays)
            np.testing.assert_allclose(every, one_by_one, rtol=1e-4)
            opened = seen(Directions(cells.astype(np.float32), *tree, OPENED[ALL_RAYS]), alpha, cosine)
            summed = seen(of_cells(cells), alpha, cosine)
            worst[ALL_RAYS] = max(worst[ALL_RAYS], np.abs(opened / every - 1).max())
            worst["cells"] = max(worst["cells"], np.abs(summed / every - 1).max())
    assert worst[ALL_RAYS] < 0.06 and worst["cells"] > 1.5 * worst[ALL_RAYS], worst


def test_an_unknown_way_is_refused():
    with pytest.raises(SceneError, match="gloss must be one of quadtree, list, all_rays"):
        Solver(ROOM, **GIVEN, gloss="octree")


def test_another_way_is_shown_at_once_where_all_photons_are_traced():
    """The light at rest is that of the way chosen last; nothing else changes."""
    solver = solved()
    for way in (ALL_RAYS, QUADTREE, LIST):
        before = solver.frame
        solver.configure(gloss=way)
        solver.solve()
        light = solver.frame.gloss
        assert light.opened == OPENED[way] and (light.tree is None) == (way == QUADTREE)
        own = glossy_receivers(solver.surfaces, besides=is_sharp(solver.surfaces))
        own = np.intersect1d(own, np.intersect1d(light.owners, before.gloss.owners))  # of cells alone, some share them
        resting = [of.resting[np.searchsorted(of.owners, own)] for of in (light, before.gloss)]
        assert len(own) > 30 and np.array_equal(*resting)
        assert np.array_equal(solver.irradiance, before.irradiance)

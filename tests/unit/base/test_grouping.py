"""Grouping and nearest points against numpy and scipy, which are slower to load or to run."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gi_core.base.grouping import components, group_of, order_of
from gi_core.base.nearest_points import count_within, nearest


@pytest.mark.parametrize("wide", [False, True], ids=["packed", "too wide to pack"])
def test_order_and_groups_are_those_of_numpy(wide):
    rng = np.random.default_rng(1)
    columns = [rng.integers(-3, 4, 5000), rng.integers(0, 9, 5000), rng.random(5000) < 0.5]
    if wide:
        columns[0] = columns[0] * 2**60
    assert np.array_equal(order_of(columns), np.lexsort(tuple(columns)[::-1]))
    rows = np.stack(columns, axis=1)
    assert np.array_equal(group_of(columns), np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1))


def test_nothing_has_no_groups():
    none = np.zeros(0, np.int64)
    assert not len(group_of((none, none))) and not len(components(np.zeros((0, 2), np.int64), 0))


@pytest.mark.parametrize("links", [0, 1, 300, 900, 5000])
def test_components_are_those_of_scipy(links):
    n, pairs = 1000, np.random.default_rng(links).integers(0, 1000, (links, 2))
    graph = coo_array((np.ones(links, np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    assert np.array_equal(components(pairs, n), connected_components(graph, directed=False)[1])


def test_a_long_chain_is_one_component():
    chain = np.stack([np.arange(1, 20000), np.arange(19999)], axis=1)
    assert not components(chain[::-1], 20000).any()


@pytest.mark.parametrize("dimensions", [3, 6])
@pytest.mark.parametrize("k", [1, 9])
def test_nearest_are_those_of_a_tree(dimensions, k):
    rng = np.random.default_rng(dimensions)
    points = rng.normal(size=(2000, dimensions)) * np.arange(1, dimensions + 1)
    queries = np.concatenate([points[:200], 3 * rng.normal(size=(200, dimensions))])
    distance, index = nearest(points, queries, k)
    expected, which = cKDTree(points).query(queries, k)
    assert np.allclose(distance, expected.reshape(len(queries), k)[:, -1], rtol=1e-12, atol=0)
    assert np.array_equal(index, which.reshape(len(queries), k)[:, -1])


def test_counts_are_those_of_a_tree():
    rng = np.random.default_rng(5)
    points, queries = rng.random((3000, 3)), 1.2 * rng.random((100, 3))
    expected = cKDTree(points).query_ball_point(queries, 0.2, return_length=True)
    assert np.array_equal(count_within(points, queries, 0.2), expected) and expected.min() == 0 < expected.max()
    assert not count_within(np.zeros((0, 3)), queries, 0.2).any()

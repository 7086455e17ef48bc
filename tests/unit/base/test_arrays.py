"""Grouping and nearest points against numpy and scipy, which are slower to load or to run.

Bits of a mask: the place of the lowest one, whatever lies above it. Arithmetic on rows of three: the same bits as
numpy's own, which paths and sums may depend on.
"""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gi_core.base import vectors
from gi_core.base.grouping import components, group_of, order_of
from gi_core.base.jit import lowest_bit
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


def test_the_lowest_bit_is_found_below_any_others():
    above = np.random.default_rng(0).integers(0, 1 << 32, 32, dtype=np.uint64)
    for k in range(32):
        for bits in (1 << k, (int(above[k]) | 1) << k & 0xFFFFFFFF):
            assert lowest_bit(np.uint32(bits)) == k


@pytest.fixture(params=[(5000, 3), (700, 3, 3), (3,)])
def pair(request):
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, *request.param)) * 10.0 ** rng.integers(-9, 9, (2, *request.param))
    return a, b


def test_products_are_numpys_to_the_bit(pair):
    a, b = pair
    assert np.array_equal(vectors.dot(a, b), (a * b).sum(axis=-1))
    assert np.array_equal(vectors.length(a), np.sqrt((a * a).sum(axis=-1)))
    assert np.array_equal(vectors.cross(a, b), np.cross(a, b))


def test_products_broadcast():
    a, b = np.arange(12.0).reshape(4, 3), np.array([[1.0, -2.0, 0.5]])
    assert np.array_equal(vectors.cross(a, b), np.cross(a, b)) and np.array_equal(vectors.cross(b, a), np.cross(b, a))
    assert np.array_equal(vectors.dot(a[:, None], a), a @ a.T)


def test_extremes_are_numpys(pair):
    a, _ = pair
    assert np.array_equal(vectors.least(a), a.min(axis=-1)) and np.array_equal(vectors.greatest(a), a.max(axis=-1))
    assert np.array_equal(vectors.every(a > -1.0), (a > -1.0).all(axis=-1))
    low, high = vectors.box(a)
    assert np.array_equal(low, a.reshape(-1, 3).min(axis=0)) and np.array_equal(high, a.reshape(-1, 3).max(axis=0))

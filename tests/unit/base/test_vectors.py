"""Arithmetic on rows of three: the same bits as numpy's own, which paths and sums may depend on."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.base import vectors


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

"""The diffuse reflection model: its density integrates to one and is that of its samples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gi_core.lights.bsdf import lambertian

CELLS = 20


def test_the_density_integrates_to_one_and_is_zero_below():
    cosines = (np.arange(1000) + 0.5) / 1000
    assert 2 * math.pi * np.mean([lambertian.pdf(c) for c in cosines]) == pytest.approx(1)
    assert lambertian.pdf(-0.5) == 0.0


def test_samples_are_unit_vectors_above_the_surface_and_follow_the_density():
    numbers = (np.arange(100) + 0.5) / 100
    found = np.array([lambertian.sample(u, v) for u in numbers for v in numbers])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-6)
    assert (found[:, 2] >= 0).all()
    edges = np.linspace(0, 1, CELLS + 1)
    expected = np.diff(edges**2)  # the integral of pdf over a ring of cosines
    counted = np.histogram(found[:, 2], edges)[0] / len(found)
    np.testing.assert_allclose(counted, expected, atol=0.011)  # a row of 100 of 10,000 samples may cross an edge


def test_a_sample_is_weighted_by_f_cos_over_its_density():
    rho, cosine = 0.7, 0.3
    assert lambertian.weight(rho) == pytest.approx(rho / math.pi * cosine / lambertian.pdf(cosine))
    assert lambertian.weight(0.0) == 0.0

"""Diffuse reflection: samples follow the density, and their weights conserve the flux."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gi_core.bsdf import lambertian

CELLS = 20
MIDDLES = (np.arange(2000) + 0.5) / 2000  # of cosines


def test_density_integrates_to_one_and_is_zero_below():
    assert 2 * math.pi * np.mean([lambertian.pdf(c) for c in MIDDLES]) == pytest.approx(1)
    assert lambertian.pdf(-0.5) == 0.0


def test_samples_are_unit_vectors_above_the_surface_and_follow_the_density():
    numbers = (np.arange(100) + 0.5) / 100
    found = np.array([lambertian.sample(u, v) for u in numbers for v in numbers])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-6)
    assert (found[:, 2] >= 0).all()
    rings = 2 * math.pi * np.array([lambertian.pdf(c) for c in MIDDLES]).reshape(CELLS, -1).mean(axis=1) / CELLS
    counted = np.histogram(found[:, 2], np.linspace(0, 1, CELLS + 1))[0] / len(found)
    np.testing.assert_allclose(counted, rings, atol=0.011)  # a row of 100 of 10,000 samples may cross an edge


def test_samples_are_isotropic_about_the_normal():
    numbers = (np.arange(64) + 0.5) / 64
    x, y, _ = np.array([lambertian.sample(u, v) for u in numbers for v in numbers]).T
    counted = np.histogram(np.arctan2(y, x), np.linspace(-math.pi, math.pi, 9))[0] / len(x)
    np.testing.assert_allclose(counted, 1 / 8, atol=0.01)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.999])
def test_mean_weight_is_the_reflected_share(rho):
    """The mean of f cos / pdf over samples is the albedo; it never exceeds rho."""
    assert 0.0 <= lambertian.weight(rho) <= rho
    assert (lambertian.weight(rho) == 0.0) == (rho == 0.0)

"""Sharp gloss: noise factors, and the rays that stand for a lobe."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gi_core.bsdf.models import lobe
from gi_core.bsdf.table import join
from gi_core.bsdf.tabulate import tabulate
from gi_core.gloss.sharp import MOST_NOISE, TAPS, noise_factor, sharp_lobe

NONE = join([])


def ggx(alpha: float, f0: float = 0.9) -> np.ndarray:
    return np.array([f0, f0, f0, 1.0, alpha])


@pytest.mark.parametrize("alpha", [0.02, 0.05, 0.1, 0.15])
def test_the_noise_factor_of_ggx_is_that_of_its_peak(alpha):
    """Integrals of a narrow lobe: of D^2 over pi D, so 1 / sqrt(12) / alpha."""
    assert noise_factor(ggx(alpha), NONE) == pytest.approx(1 / math.sqrt(12) / alpha, rel=0.06)
    assert noise_factor(ggx(alpha, 0.04), NONE) == pytest.approx(noise_factor(ggx(alpha), NONE), rel=0.03)


def test_a_mirror_is_noise_alone_and_a_matt_table_has_none():
    assert noise_factor(ggx(0.0), NONE) == math.inf
    matt = join([tabulate((lobe("oren_nayar", {}),))])
    assert noise_factor(np.array([0, 0, 0, 0, -1.0]), matt) == pytest.approx(1.0, abs=0.05)


def test_only_lobes_of_too_much_noise_are_reflections():
    assert sharp_lobe(ggx(0.2), NONE) is None
    assert noise_factor(ggx(0.2), NONE) < MOST_NOISE < noise_factor(ggx(0.14), NONE)
    mirror, rough = sharp_lobe(ggx(0.0), NONE), sharp_lobe(ggx(0.1), NONE)
    assert len(mirror.taps) == 1 and TAPS // 2 <= len(rough.taps) <= TAPS
    # Taps stand for the lobe: their solid angles have its width, pi (2 alpha)^2 for the half of a GGX lobe.
    inner = np.sort(rough.taps[:, 2])[: len(rough.taps) // 2]
    assert (inner**2).sum() == pytest.approx(math.pi * 0.2**2, rel=0.35)
    np.testing.assert_allclose(mirror.albedo[-1], 0.9, rtol=1e-6)
    np.testing.assert_allclose(mirror.albedo[0], 1.0, rtol=0.01)


def test_lobes_towards_the_light_are_no_reflections():
    back = lobe("lafortune", {"kd": 0.0, "cx": 1.0, "cy": 1.0, "cz": 1.0, "n": 200.0})
    tables = join([tabulate((back,), True)])
    row = np.array([0, 0, 0, 0, -1.0])
    assert noise_factor(row, tables) > MOST_NOISE
    assert sharp_lobe(row, tables) is None


def test_brushed_metal_has_taps_along_its_grain():
    tables = join([tabulate((lobe("ward", {"kd": 0.0, "ks": 0.7, "ax": 0.03, "ay": 0.3}),), True)])
    taps = sharp_lobe(np.array([0, 0, 0, 0, -1.0]), tables).taps
    assert np.abs(taps[:, 1]).mean() > 5 * np.abs(taps[:, 0]).mean()

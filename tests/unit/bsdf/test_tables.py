"""Tables of reflection models: draws follow their density, weights equal f cos / pdf, albedos equal quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from gi_core.bsdf import table
from gi_core.bsdf.models import lobe
from tests.support.brdf_cases import ANGLES, lobes
from tests.support.brdf_tables import densities, direction, draws, values

DRAWS = 40_000
RINGS, SECTORS, INNER = 24, 16, 10  # cells of the chi-square test, and Gauss points per side of a cell
CASES = lobes()
AZIMUTH = 145.0  # of i: in the second quadrant, off every row of a table


def _table(found):
    return table.join([table.tabulate((lobe("lewis", {"n": 3}),)), table.tabulate((found,), scale=True)])


def _places(i, o):
    """Return cells (n,) of directions: fourth root of y by psi about the azimuth of x, as `nodes` has them."""
    h = i + o
    x, y = h[:, 0] / h[:, 2], h[:, 1] / h[:, 2]
    slope2 = np.maximum(x * x + y * y, 1e-30)
    b = (x * i[0] + y * i[1]) / np.sqrt(slope2) / i[2]
    limit2 = (b + np.sqrt(b * b + 1.0)) ** 2
    root = (slope2 * limit2 / (np.maximum(0.0, limit2 - slope2) + slope2 * limit2)) ** 0.25
    ring = np.minimum((root * RINGS).astype(int), RINGS - 1)
    return ring * SECTORS + (np.arctan2(y, x) % (2 * math.pi) * SECTORS / (2 * math.pi)).astype(int) % SECTORS


def _expected(tables, i):
    """Return the integral of the density over each cell, by Gauss-Legendre points inside it."""
    x, w = np.polynomial.legendre.leggauss(INNER)
    inner, weight = 0.5 * (x + 1.0), 0.5 * w
    root = ((np.arange(RINGS)[:, None] + inner) / RINGS).ravel()
    psi = ((np.arange(SECTORS)[:, None] + inner) * (2 * math.pi / SECTORS)).ravel()
    y = root**4
    b = (np.cos(psi) * i[0] + np.sin(psi) * i[1]) / i[2]
    limit2 = (b + np.sqrt(b * b + 1.0)) ** 2
    scale = limit2 * (1.0 - y[:, None]) + y[:, None]
    slope = np.sqrt(y[:, None] * limit2 / scale)
    cos_h = 1.0 / np.sqrt(1.0 + slope * slope)
    h = np.stack((slope * np.cos(psi) * cos_h, slope * np.sin(psi) * cos_h, cos_h), axis=2)
    across = h @ i
    o = 2.0 * across[:, :, None] * h - i
    solid = 2.0 * across * cos_h**3 * (limit2 / scale) ** 2 * 4.0 * root[:, None] ** 3
    density = densities(tables, 1, i, np.ascontiguousarray(o.reshape(-1, 3))).reshape(across.shape) * solid
    cells = density.reshape(RINGS, INNER, SECTORS, INNER)
    return (cells * weight[:, None, None] * weight).sum(axis=(1, 3)).ravel() * (2 * math.pi / (RINGS * SECTORS))


@pytest.mark.parametrize(("name", "found"), CASES, ids=[name for name, _ in CASES])
def test_draws_follow_the_density_and_carry_its_weight(name, found):
    """Chi-square at 1 % for all angles of all sets together (Sidak); weights equal f cos / (pdf albedo)."""
    tables = _table(found)
    numbers = np.random.default_rng([ord(c) for c in name]).random((DRAWS, 3))
    for angle in ANGLES:
        i = direction(angle, AZIMUTH)
        survival, share = table.albedo(tables, 1, *i), table.mirror_share(tables, 1, *i)
        drawn = draws(tables, 1, i, numbers)
        if survival == 0.0:
            assert not drawn[:, 3:].any()
            continue
        assert drawn[:, 3:].min() >= 0.0 and drawn[:, 3:].max() <= 1.0
        o = np.ascontiguousarray(drawn[:, :3])
        assert np.abs((o * o).sum(axis=1) - 1.0).max() < 1e-12 and o[:, 2].min() > -1e-12
        mirrored = numbers[:, 2] >= 1.0 - share
        assert np.abs(o[mirrored] - (-i[0], -i[1], i[2])).max(initial=0.0) < 1e-12
        assert stats.binomtest(int(mirrored.sum()), DRAWS, share).pvalue > 1e-5
        spread = ~mirrored & (o[:, 2] > 1e-9)
        density = densities(tables, 1, i, o[spread])
        assert density.min(initial=1.0) > 0.0
        weight = values(tables, 1, i, o[spread]) * o[spread, 2:] / (density * survival)[:, None]
        np.testing.assert_allclose(weight, drawn[spread, 3:], atol=1e-6)
        if share > 1.0 - 1e-9:
            continue

        expected = _expected(tables, i)
        assert expected.sum() == pytest.approx(1.0 - share, abs=4e-3)
        counted = np.bincount(_places(i, o[~mirrored]), minlength=len(expected))
        expected *= (DRAWS - mirrored.sum()) / expected.sum()
        large = expected >= 5.0
        seen = np.append(counted[large], counted[~large].sum())
        hoped = np.append(expected[large], max(expected[~large].sum(), 1e-9))
        if hoped[-1] < 5.0:  # too few for a cell of their own
            seen, hoped = np.append(seen[:-2], seen[-2:].sum()), np.append(hoped[:-2], hoped[-2:].sum())
        chi2 = ((seen - hoped) ** 2 / hoped).sum()
        tests = len(CASES) * len(ANGLES)
        assert stats.chi2.sf(chi2, len(seen) - 1) > 1.0 - 0.99 ** (1.0 / tests), (angle, chi2, len(seen))

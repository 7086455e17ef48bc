"""GGX over a base that takes all that single reflections between facets leave."""

import math

import numpy as np
import pytest

from gi_core.base.jit import allocating
from gi_core.bsdf import ggx

TABLE = ggx.albedos()
GOLD = (0.95, 0.6, 0.2)


@allocating
def _draws(table, lobe, rho, i, numbers):
    out = np.empty((len(numbers), 6))
    for k in range(len(numbers)):
        u = numbers[k]
        out[k] = ggx.scattered(table, lobe, rho, i[0], i[1], i[2], u[0], u[1], u[2], u[3])
    return out


def draws(lobe, rho, cosine: float, count: int = 40_000) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (n, 3) and factors (n, 3) of photons from one direction."""
    i = np.array([math.sqrt(1 - cosine**2), 0.0, cosine])
    out = _draws(TABLE, lobe, rho, i, np.random.default_rng(3).random((count, 4)))
    return out[:, :3], out[:, 3:]


def surface(f0, alpha: float, base: float, f90: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    lobe = np.array([*f0, f90, alpha])
    return lobe, ggx.base_albedo(lobe[None], np.full((1, 3), base))[0]


@pytest.mark.parametrize("alpha", [0.0, 0.1, 0.3, 0.64, 0.81, 1.0])
@pytest.mark.parametrize("cosine", [0.05, 0.4, 1.0])
def test_facets_that_reflect_all_lose_nothing(alpha, cosine):
    """White furnace: with F = 1 every photon leaves, with all of its flux."""
    directions, factors = draws(*surface((1, 1, 1), alpha, 0.0), cosine, 5000)
    assert (factors == 1).all() and (directions[:, 2] > 0).all()


@pytest.mark.parametrize("alpha", [0.15, 0.5, 0.81, 1.0])
@pytest.mark.parametrize("f0, base", [(GOLD, 0.0), ((0.04, 0.04, 0.04), 0.8)])
def test_draws_follow_the_value(alpha, f0, base):
    """Means of factors over parts of the hemisphere equal integrals of f cos, within 4 standard errors + 0.003."""
    lobe, rho = surface(f0, alpha, base)
    for cosine in (0.3, 0.8):
        i = math.sqrt(1 - cosine**2), 0.0, cosine
        directions, factors = draws(lobe, rho, cosine)
        assert factors.min() >= 0 and factors.max() <= 1
        assert np.linalg.norm(directions, axis=1) == pytest.approx(1)
        n = 400
        z, phi = (a.reshape(-1) for a in np.meshgrid((np.arange(n) + 0.5) / n, 2 * np.pi * (np.arange(n) + 0.5) / n))
        way = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], axis=1)
        f = np.array([ggx.value(TABLE, lobe, rho, *i, *o) for o in way[::4]]) * way[::4, 2:] * 2 * np.pi / len(way[::4])

        def part(o):
            return np.minimum((o[:, 2] * 4).astype(int), 3) * 2 + (o[:, 0] < 0)

        for k in range(8):
            inside = (part(directions) == k)[:, None] * factors
            error = inside.std(axis=0) / math.sqrt(len(inside))
            assert (np.abs(inside.mean(axis=0) - f[part(way[::4]) == k].sum(axis=0)) < 4 * error + 0.003).all()


@pytest.mark.parametrize("alpha", [0.15, 0.81])
def test_values_are_reciprocal(alpha):
    lobe, rho = surface(GOLD, alpha, 0.2)
    rng = np.random.default_rng(1)
    for _ in range(50):
        i, o = (a / np.linalg.norm(a) for a in rng.random((2, 3)) + 0.01)
        assert ggx.value(TABLE, lobe, rho, *i, *o) == pytest.approx(ggx.value(TABLE, lobe, rho, *o, *i), rel=1e-9)


@pytest.mark.parametrize("alpha", [0.17, 0.45, 0.97])
def test_hemispherical_albedo_is_that_of_draws(alpha):
    """Gloss and base together, within 0.5 %; rough metal is darker and of a deeper colour than one reflection."""
    lobe, rho = surface(GOLD, alpha, 0.0)
    cosines = np.sqrt((np.arange(40) + 0.5) / 40)
    found = np.mean([draws(lobe, rho, c, 4000)[1].mean(axis=0) for c in cosines], axis=0)
    assert rho + ggx.gloss_albedo(lobe[None])[0] == pytest.approx(found, abs=0.005)


def test_further_reflections_follow_kulla_and_conty():
    """Closed form at alpha 1: F^2 A (1 - A) / (1 - F (1 - A)), with the quadrature's A of 0.409."""
    lobe = np.array([[0.8, 0.3, 0.0, 0.0, 1.0]])
    F, A = np.array([0.8, 0.3, 0.0]) * 20 / 21, 0.409
    assert ggx.further_albedo(lobe)[0] == pytest.approx(F**2 * A * (1 - A) / (1 - F * (1 - A)), abs=2e-3)
    assert (ggx.further_albedo(np.array([[0.9, 0.9, 0.9, 1.0, 0.0], [math.nan] * 5])) == 0).all()


def walk(lobe: np.ndarray, cosine: float, count: int = 20_000, most: int = 12) -> np.ndarray:
    """Return the share (most, 3) of light that leaves after 1, 2, ... facets, by random walks between them.

    Heitz, Hanika, d'Eon, Dachsbacher, Multiple-scattering microfacet BSDFs with the Smith model, 2016; even heights.
    """
    rng, f0, f90, alpha = np.random.default_rng(5), lobe[:3], lobe[3], lobe[4]
    way = np.tile([-math.sqrt(1 - cosine**2), 0.0, -cosine], (count, 1))
    below, weight, out = np.ones(count), np.ones((count, 3)), np.zeros((most + 1, 3))  # share of heights below
    for k in range(most + 1):
        z = np.clip(way[:, 2], -0.99999, 0.99999)
        smith = 0.5 * (np.sign(z) * np.sqrt(1 + alpha**2 * (1 / z**2 - 1)) - 1)
        u, stays = rng.random(len(z)), np.ones(len(z), bool)
        up = z > 0
        stays[up] = u[up] <= 1 - below[up] ** smith[up]
        out[k] = weight[~stays].sum(axis=0) / count
        i, smith, u, below, weight = -way[stays], smith[stays], u[stays], below[stays], weight[stays]
        below = np.minimum(below / (1 - u) ** (1 / smith), 1.0)
        numbers = rng.random((len(i), 2))
        half = np.array([ggx.visible_half(alpha, *d, *pair) for d, pair in zip(i, numbers, strict=True)]).reshape(-1, 3)
        c = np.clip((i * half).sum(axis=1), 0, 1)[:, None]
        weight, way = weight * (f0 + (f90 - f0) * (1 - c) ** 5), 2 * c * half - i
    return out[1:]


@pytest.mark.parametrize("alpha, off", [(0.25, 0.01), (0.64, 0.02), (1.0, 0.045)])
def test_albedo_is_near_that_of_walks_between_facets(alpha, off):
    """One reflection agrees within 0.006; Kulla and Conty's sum of further ones lies up to 0.04 below."""
    lobe, rho = surface((0.8, 0.5, 0.2), alpha, 0.0)
    found = np.mean([walk(lobe, c) for c in np.sqrt((np.arange(5) + 0.5) / 5)], axis=0)
    once = ggx.gloss_albedo(lobe[None])[0]
    assert once == pytest.approx(found[0], abs=0.006)
    assert (found.sum(axis=0) - off < once + rho).all() and (once + rho < found.sum(axis=0) + 0.003).all()

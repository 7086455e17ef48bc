"""Noise is removed, edges stay, and the remaining noise is reported correctly."""

import numpy as np
import pytest

from gi_core.gather.denoise import denoise, smooth, smoothed_by_subset
from gi_core.geometry.mesh_neighbours import neighbours
from tests.support.scene_builders import quad

N = 60  # vertices along each side of a square
CORNERS = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (N - 1, N - 1)).faces
P = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (N - 1, N - 1)).vertices
NEAR = neighbours(CORNERS, len(P))
WEIGHTS = np.ones(len(P))


def grainy(light: np.ndarray, sigma, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return grey light (n,) with noise of a standard deviation, and that deviation, (n, 3) each."""
    sigma = np.broadcast_to(sigma, light.shape)
    noise = np.random.default_rng(seed).standard_normal(len(light)) * sigma
    return np.repeat((light + noise)[:, None], 3, axis=1), np.repeat(sigma[:, None], 3, axis=1)


def off(E: np.ndarray, light: np.ndarray) -> float:
    return float(np.abs(E[:, 1] - light).mean() / light.mean())


def rms(E: np.ndarray, light: np.ndarray) -> float:
    return float(np.sqrt(np.square(E[:, 1] - light).mean()))


def test_neighbours_are_the_ends_of_edges_each_once():
    expected = {(int(i), int(j)) for face in CORNERS for i in face for j in face if i != j}
    found = [(i, int(j)) for i in range(len(P)) for j in NEAR.of[NEAR.first[i] : NEAR.first[i + 1]]]
    assert len(found) == len(set(found)) and set(found) == expected


def test_noise_on_even_light_falls_to_a_third_and_is_reported():
    light = 1 + 0.2 * P[:, 0]
    E, sigma = grainy(light, 0.05 * light)
    s = denoise(E, sigma, NEAR, 0, 1)
    assert off(s.irradiance, light) < 0.36 * off(E, light)
    assert s.share(WEIGHTS) == pytest.approx(rms(s.irradiance, light) / rms(E, light), rel=0.2)


def test_shadow_edge_stays_in_place():
    light = np.where(P[:, 0] < 0.5, 1.0, 0.3)
    E, sigma = grainy(light, 0.05)
    s = denoise(E, sigma, NEAR, 0, 1)
    beside = np.abs(P[:, 0] - 0.5) < 1.5 / N
    assert beside.sum() >= 2 * N
    assert np.abs(s.irradiance[beside, 1] - light[beside]).mean() < 0.05
    assert off(s.irradiance, light) < 0.45 * off(E, light)
    assert s.share(WEIGHTS) == pytest.approx(rms(s.irradiance, light) / rms(E, light), rel=0.2)


@pytest.mark.parametrize("height", [0.02, 0.1, 0.3])
def test_detail_at_vertex_scale_is_never_made_worse(height):
    light = 1 + height * np.sin(40 * np.pi * P[:, 0]) * np.sin(34 * np.pi * P[:, 1])
    E, sigma = grainy(light, 0.05)
    s = denoise(E, sigma, NEAR, 0, 1)
    assert rms(s.irradiance, light) < 1.03 * rms(E, light)
    assert s.share(WEIGHTS) == pytest.approx(rms(s.irradiance, light) / rms(E, light), rel=0.2)


def test_a_few_bright_receivers_do_not_state_the_noise_of_all():
    """A bright strip has most squared noise, and loses it; detail elsewhere keeps its noise. By squares: 0.63."""
    bright = P[:, 0] > 0.9
    detail = 0.45 * np.sin(40 * np.pi * P[:, 0]) * np.sin(34 * np.pi * P[:, 1])
    light = np.where(bright, 10.0, 1 + detail)
    E, sigma = grainy(light, np.where(bright, 1.0, 0.15))
    s = denoise(E, sigma, NEAR, 0, 1)
    assert s.share(WEIGHTS) == pytest.approx(off(s.irradiance, light) / off(E, light), rel=0.12)


def test_without_noise_nothing_changes():
    light = 1 + P[:, 0] * P[:, 1]
    E, sigma = grainy(light, 0.0)
    s = denoise(E, sigma, NEAR, 0, 1)
    assert np.array_equal(s.irradiance, E) and s.share(WEIGHTS) == 1


def test_black_receivers_stay_black_and_darken_nobody():
    light = np.where(P[:, 0] < 0.5, 1.0, 0.0)
    E, sigma = grainy(light, 0.1 * light)
    s = denoise(E, sigma, NEAR, 0, 1)
    assert not s.irradiance[light == 0].any()
    assert abs(s.irradiance[light > 0, 1].mean() - 1) < 0.01
    dark = denoise(0 * E, 0 * sigma, NEAR, 0, 1)
    assert not dark.irradiance.any()


def test_the_same_bits_with_any_number_of_threads():
    near = neighbours(np.concatenate([CORNERS, CORNERS + len(P), CORNERS + 2 * len(P)]), 3 * len(P))
    E, sigma = grainy(np.tile(1 + P[:, 0], 3), 0.1)
    one, two = (denoise(E, sigma, near, 3, threads) for threads in (1, 2))
    assert np.array_equal(one.irradiance, two.irradiance) and one.share(np.ones(len(E))) == two.share(np.ones(len(E)))


def test_each_place_takes_its_own_reach():
    """One half has detail of the size of its noise, the other is even: one reach for both would harm one of them."""
    detailed = P[:, 0] < 0.5
    light = 1 + np.where(detailed, 0.3 * np.sin(40 * np.pi * P[:, 0]) * np.sin(34 * np.pi * P[:, 1]), 0.0)
    E, sigma = grainy(light, 0.05)
    s = denoise(E, sigma, NEAR, 0, 1)
    inner = np.abs(P[:, 0] - 0.5) > 0.1
    left, right = (rms(s.irradiance[k], light[k]) / rms(E[k], light[k]) for k in (detailed & inner, ~detailed & inner))
    assert left < 1.05 and right < 0.4


def test_a_small_change_is_carried_as_the_derivative():
    """Against central differences: weights change too. Variances count as constant."""
    rng, step = np.random.default_rng(2), 1e-5
    grey, variance = np.repeat(rng.standard_normal((len(P), 1)), 3, axis=1), rng.uniform(0.1, 1.0, (len(P), 1))
    start = np.concatenate([grey, variance], axis=1)
    change = rng.standard_normal(len(P))
    moved = []
    for sign in (1, -1):
        light = start.copy()
        light[:, :3] += sign * step / 3 * change[:, None]
        smooth(light, 4.0, NEAR, 1)
        moved.append(light[:, :3].sum(axis=1))
    carried, fixed = (np.concatenate([start, change[:, None]], axis=1) for _ in range(2))
    smooth(carried, 4.0, NEAR, 1, responds=True)
    smooth(fixed, 4.0, NEAR, 1)
    expected = (moved[0] - moved[1]) / (2 * step)
    off_carried, off_fixed = (np.sqrt(np.mean((light[:, 4] - expected) ** 2)) for light in (carried, fixed))
    assert np.array_equal(carried[:, :4], fixed[:, :4]) and off_carried < 0.2 * off_fixed


def test_receivers_that_light_cannot_reach_stay_dark_and_darken_none():
    rng = np.random.default_rng(1)
    reached = rng.random(len(P)) > 0.1
    E = np.ones((len(P), 3)) * reached[:, None]
    fewer = E * rng.uniform(0.0, 2.0, (len(P), 1))  # so much noise that edges are smoothed too
    light, _ = smoothed_by_subset(E, fewer, 2.0, 4.0, NEAR, reached, WEIGHTS, 2)
    assert np.allclose(light, E)
    light, _ = smoothed_by_subset(E, fewer, 2.0, 4.0, NEAR, np.ones(len(P), bool), WEIGHTS, 2)
    assert light[reached].min() < 0.9 and light[~reached].max() > 0.1

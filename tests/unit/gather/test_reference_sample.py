"""Receivers drawn by area, the reference there, and errors without its noise."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.gather.reference import ReferenceRounds
from gi_core.gather.reference_sample import ReferenceSample, draw_by_area, gather_sample, gather_until
from gi_core.geometry.error import relative_error
from gi_core.model import Model
from tests.support.scene_builders import ROOM_POINTS, coloured_room, plane_scene


def test_draws_are_by_area_with_repeats():
    areas = np.array([0.0, 1.0, 3.0, 0.0, 4.0])
    rows, times = draw_by_area(np.array([1, 2, 4]), areas, 8000, 1)
    assert rows.tolist() == [1, 2, 4] and times.sum() == 8000
    assert np.abs(times - [1000, 3000, 4000]).max() < 200  # four deviations


def test_a_sum_over_draws_has_the_mean_of_the_sum_by_area():
    random = np.random.default_rng(1)
    areas, f = random.exponential(size=400), random.random(400)
    means = []
    for seed in range(300):
        rows, times = draw_by_area(np.arange(400), areas, 60, seed)
        means.append((times * f[rows]).sum() / 60)
    error = np.std(means, ddof=1) / np.sqrt(len(means))
    assert abs(np.mean(means) - (areas * f).sum() / areas.sum()) < 4 * error


def test_reference_noise_is_subtracted():
    random = np.random.default_rng(2)
    noisy = 1 + 0.05 * random.standard_normal((4000, 1)) * np.ones(3)
    sample = ReferenceSample(np.arange(4000), np.ones(4000), noisy, 0.05 * np.sqrt(2 / np.pi), 1.0)
    assert sample.error(np.ones((4000, 3))) < 0.01
    wrong = 1 + 0.1 * random.standard_normal((4000, 1)) * np.ones(3)
    assert sample.error(wrong) == pytest.approx(0.1 * np.sqrt(2 / np.pi), rel=0.05)
    assert sample._replace(irradiance=np.zeros((4000, 3))).squared_error(wrong) == 0


def test_gathering_ends_at_the_noise_at_the_paths_and_without_light():
    scene, weights = coloured_room(), np.ones(len(ROOM_POINTS[0]))
    rounds = ReferenceRounds(scene, *ROOM_POINTS, 3, weights)
    *on_the_way, last = gather_until(rounds, weights, 0.02)
    assert on_the_way and last.noise <= 0.02 and last.fraction == 1 and rounds.state is last.state
    assert len(list(gather_until(rounds, weights, 0.02))) == 1, "good enough: nothing is gathered"
    *_, few = gather_until(ReferenceRounds(scene, *ROOM_POINTS, 3, weights), weights, 1e-9, 500)
    assert few.noise > 0.02 and few.state.rounds > 1
    dark = ReferenceRounds(plane_scene(), *ROOM_POINTS, 3, weights)
    *_, none = gather_until(dark, weights, 0.02)
    assert np.isnan(none.noise)


def test_a_sample_is_the_reference_at_its_receivers():
    model = Model(coloured_room())
    rows, weights = draw_by_area(np.arange(len(model.object_receivers.areas)), model.object_receivers.areas, 50, 0)
    a, b = ([*gather_sample(model, model.start_poses(), rows, weights, seed, 0.03)][-1] for seed in (1, 2))
    both = np.hypot(a.noise, b.noise)
    assert 0.3 * both < relative_error(a.irradiance, b.irradiance, weights).l1 < 2 * both

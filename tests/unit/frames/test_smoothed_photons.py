"""The light of photons, averaged along surfaces in proportion to its noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.draw.fine_mesh import takes_fine_points
from gi_core.frames.control_variate import REACH
from gi_core.frames.static_light import NEAR, smooth_photons
from gi_core.gather.denoise import smoothed_by_subset
from gi_core.gather.estimate import Estimate
from gi_core.gather.reference_sample import ReferenceSample, draw_by_area, gather_sample
from gi_core.lights.lamps import mix, sum_of_lamps
from gi_core.photons.flux_sums import LOWEST
from gi_core.scene import PointLight, Pose
from gi_core.solver import Solver
from tests.support.receiver_samples import static_areas
from tests.support.scene_builders import box_mobile, coloured_room, solve

BULBS = PointLight("left", (0.2, 0.8, 0.4), (1.0, 0.6, 0.3)), PointLight("right", (0.8, 0.2, 0.8), (0.3, 0.6, 1.0))
PHOTONS = 1 << 14
POSE = Pose((0.55, 0.5, 0.35))


def solved(photons: int = PHOTONS, **given) -> Solver:
    scene = replace(coloured_room((box_mobile(size=0.1),), grid=30), lights=BULBS)
    return solve(scene, photons=photons, radius=0.06, light="best", **given)


@pytest.fixture(scope="module")
def solver() -> Solver:
    return solved()


@pytest.fixture(scope="module")
def truth(solver) -> ReferenceSample:
    """Whole paths at 300 static receivers, of 1.5 % noise, without mobiles."""
    static, areas = solver.surfaces.receiver_range(0), solver.receivers.areas
    rows, times = draw_by_area(np.arange(static.stop), areas, 300, 5)
    away = {"box": Pose((50.0, 50.0, 50.0))}
    *_, found = gather_sample(solver.model, away, rows, times, 77, 0.015)
    return found


def smoothed(solver: Solver) -> Estimate:
    return solver.frame_light.static.of_photons(solver.frame.background)


def error(solver: Solver, truth: ReferenceSample, E: np.ndarray) -> float:
    return truth.error(np.r_[E, np.zeros((len(solver.receivers.areas) - len(E), 3))])


def test_smoothed_light_has_less_error(solver, truth):
    raw, found = solver.frame.background.irradiance(PHOTONS), smoothed(solver)
    assert error(solver, truth, raw) > 0.06
    assert error(solver, truth, found.irradiance) < 0.75 * error(solver, truth, raw)
    w = static_areas(solver)
    assert w @ found.irradiance == pytest.approx(w @ raw, rel=0.01), "light is moved, not made"


def test_points_bring_direct_light_of_less_error(solver, truth):
    """Photons blur its borders. Pictures have fine points in this light, but not in that of photons alone."""
    b, around = solver.frame.background, solver.frame_light.static.around(NEAR * 0.06)
    blurred = smooth_photons(b, around, static_areas(solver)).irradiance
    assert error(solver, truth, smoothed(solver).irradiance) < 0.75 * error(solver, truth, blurred)
    assert takes_fine_points(solver)
    alone = solved()
    alone.configure(light="photons")
    alone.solve()
    assert not takes_fine_points(alone)


def test_stated_noise_is_that_between_seeds(solver):
    others = [smoothed(solved(seed=seed)).irradiance for seed in range(1, 7)]
    mean, w = sum(others) / len(others), static_areas(solver)
    spread = [float((w * np.abs((E - mean).mean(axis=1))).sum() / (w @ mean.mean(axis=1))) for E in others]
    assert smoothed(solver).noise == pytest.approx(np.mean(spread) * math.sqrt(6 / 5), rel=0.35)


def test_frames_change_the_smoothed_light(solver):
    b = solver.frame.background
    assert np.array_equal(solver.frame_light.static_irradiance(b, PHOTONS), smoothed(solver).irradiance)
    assert not np.array_equal(smoothed(solver).irradiance, b.irradiance(PHOTONS))
    solver.move("box", Pose((50.0, 50.0, 50.0)))
    static = solver.surfaces.receiver_range(0)
    assert np.array_equal(solver.irradiance[static], smoothed(solver).irradiance)
    solver.move("box", POSE)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    other = solved(threads=3)
    other.move("box", POSE)
    assert np.array_equal(solver.irradiance, other.irradiance)


def test_photons_alone_are_shown_as_they_are():
    solver = solved()
    solver.configure(light="photons")
    solver.solve()
    static, b = solver.surfaces.receiver_range(0), solver.frame.background
    solver.move("box", Pose((50.0, 50.0, 50.0)))
    assert np.array_equal(solver.irradiance[static], b.irradiance(PHOTONS))


def test_lamps_share_the_averages_of_their_sum(solver):
    per_lamp = solver.frame_light.static.of_photons(solver.frame.background, per_lamp=True).light
    assert np.allclose(sum_of_lamps(per_lamp), smoothed(solver).irradiance, rtol=1e-9, atol=1e-12)
    levels = np.ones_like(solver.levels)
    levels[1:] = 0.25
    dimmed = solved()
    dimmed.set_lamps({lamp: 0.25 for lamp in dimmed.lamps.names[1:]})
    assert np.array_equal(dimmed.levels, levels)
    shown = dimmed.frame_light.static_irradiance(dimmed.frame.background, PHOTONS)
    assert np.allclose(shown, mix(per_lamp, levels), rtol=1e-12), "dimming is a sum over lamps"
    dimmed.set_lamps({lamp: 0.5 for lamp in dimmed.lamps.names})
    half = dimmed.frame_light.static_irradiance(dimmed.frame.background, PHOTONS)
    assert np.array_equal(half, 0.5 * smoothed(solver).irradiance)
    dimmed.move("box", POSE)
    assert np.array_equal(dimmed.irradiance, dimmed.from_scratch())


def test_few_photons_have_no_known_noise():
    solver = solved(photons=LOWEST)
    found, b = smoothed(solver), solver.frame.background
    direct = solver.frame_light.static.direct_for(b)
    light = b.irradiance_per_lamp(LOWEST, direct=False) + direct
    assert math.isinf(found.noise) and np.allclose(found.irradiance, sum_of_lamps(light), rtol=1e-12)


def test_receivers_that_light_cannot_reach_stay_dark_and_darken_none(solver):
    b = solver.frame.background
    around, n, rng = (
        solver.frame_light.static.around(NEAR * b.setting.radius),
        len(static_areas(solver)),
        np.random.default_rng(1),
    )
    reached = rng.random(n) > 0.1
    E = np.ones((n, 3)) * reached[:, None]
    fewer = E * rng.uniform(0.0, 2.0, (n, 1))  # so much noise that edges are smoothed too
    light, _ = smoothed_by_subset(E, fewer, 2.0, REACH, around, reached, np.ones(n), 2)
    assert np.allclose(light, E)
    light, _ = smoothed_by_subset(E, fewer, 2.0, REACH, around, np.ones(n, bool), np.ones(n), 2)
    assert light[reached].min() < 0.9 and light[~reached].max() > 0.1

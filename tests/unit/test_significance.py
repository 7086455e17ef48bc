"""The tests' own statistics: their rates of false alarms and of detection are as stated."""

import numpy as np
import pytest

from tests.support import closed_form
from tests.support import significance as sig


def test_sidak_keeps_the_level_of_all_together():
    each = sig.sidak(0.01, 50)
    assert 1 - (1 - each) ** 50 == pytest.approx(0.01)
    assert sig.sidak(0.01, 1) == pytest.approx(0.01)


def test_p_values_are_uniform_where_the_mean_is_right():
    rng = np.random.default_rng(1)
    samples = rng.normal(3.0, 2.0, (6, 20000))
    p = sig.p_values(samples.mean(axis=0), 3.0, 2 / np.sqrt(6))
    sig.chi_square(np.histogram(p, 20, (0, 1))[0], np.full(20, 1000.0), "p of the normal")
    p = sig.p_values(samples.mean(axis=0), 3.0, samples.std(axis=0, ddof=1) / np.sqrt(6), degrees=5)
    sig.chi_square(np.histogram(p, 20, (0, 1))[0], np.full(20, 1000.0), "p of Student's t")


def test_z_test_passes_the_truth_and_reports_its_numbers_otherwise():
    sig.z_test([1.0, 2.0], [1.01, 2.01], 0.01, "fine")
    with pytest.raises(AssertionError, match=r"lamp: mean 1 \+- 0\.01, expected 1\.1 .* p = "):
        sig.z_test(1.0, 1.1, 0.01, "lamp")


def test_no_spread_means_equality():
    sig.z_test(0.0, 0.0, 0.0)
    sig.z_test(1.0 + 1e-8, 1.0, 0.0)
    with pytest.raises(AssertionError):
        sig.z_test(1.0001, 1.0, 0.0)
    with pytest.raises(AssertionError):
        sig.z_test(1e-12, 0.0, 0.0, "a leak")


def test_photons_for_power_sees_two_percent_99_times_in_100():
    p = 0.05
    n = sig.photons_for_power(sig.crossing_deviation(p))
    rng = np.random.default_rng(2)
    error = np.sqrt(p * (1 - p) / n)
    seen = sig.p_values(rng.binomial(n, 1.02 * p, 4000) / n, p, error) < sig.SIGNIFICANCE
    wrong = sig.p_values(rng.binomial(n, p, 4000) / n, p, error) < sig.SIGNIFICANCE
    assert 0.98 < seen.mean() < 1.0
    assert wrong.mean() < 0.02
    assert sig.sees(error, p) and not sig.sees(1.05 * error, p)


def test_sees_accounts_for_degrees_of_freedom():
    assert sig.sees(0.003, 1.0, tests=1)
    assert not sig.sees(0.003, 1.0, tests=1, degrees=3)


def test_chi_square_finds_a_bent_distribution():
    rng = np.random.default_rng(3)
    expected = np.full(10, 1000.0)
    sig.chi_square(np.bincount(rng.integers(0, 10, 10000), minlength=10), expected)
    bent = rng.choice(10, 10000, p=np.r_[0.12, np.full(9, 0.88 / 9)])
    with pytest.raises(AssertionError, match="chi-square"):
        sig.chi_square(np.bincount(bent, minlength=10), expected)


# -- closed forms against each other: two derivations that meet ------------------------------------


def test_rectangle_by_corners_is_lambert_s_polygon():
    polygon = [(-0.5, -0.5, 1), (0.5, -0.5, 1), (0.5, 0.5, 1), (-0.5, 0.5, 1)]
    for x, y in ((0.0, 0.0), (0.3, -0.2), (0.5, 0.5), (0.9, 0.1), (-0.7, 0.8)):
        four = closed_form.parallel_rectangle(2.0, -0.5, 0.5, -0.5, 0.5, 1.0, x, y)
        assert four == pytest.approx(closed_form.lambert_polygon(2.0, polygon, (x, y, 0), (0, 0, 1)), rel=1e-12)


def test_disc_over_floor_is_a_polygon_of_many_corners():
    phi = 2 * np.pi * np.arange(2000) / 2000
    polygon = np.stack([0.4 * np.cos(phi), 0.4 * np.sin(phi), np.full(2000, 0.7)], axis=1)
    for x in (0.0, 0.2, 0.9):
        E = closed_form.lambert_polygon(3.0, polygon, (x, 0, 0), (0, 0, 1))
        assert closed_form.disc_over_floor(3.0, 0.4, 0.7, x) == pytest.approx(E, rel=1e-5)
    assert closed_form.disc_over_floor(3.0, 0.4, 0.7, 0.0) == pytest.approx(3 * np.pi * 0.16 / (0.16 + 0.49))


def test_surrounding_polygon_is_the_sky_and_one_below_the_horizon_zero():
    far = 1e5
    square = np.array([(-far, -far, 1), (far, -far, 1), (far, far, 1), (-far, far, 1)])
    assert closed_form.lambert_polygon(1.0, square, (0, 0, 0), (0, 0, 1)) == pytest.approx(closed_form.sky(1.0), 1e-4)
    tilted = (np.sin(0.5), 0, np.cos(0.5))
    assert closed_form.lambert_polygon(1.0, square, (0, 0, 0), tilted) == pytest.approx(
        closed_form.sky(1.0, np.cos(0.5)), 1e-4
    )
    assert closed_form.lambert_polygon(1.0, square, (0, 0, 0), (0, 0, -1)) == 0.0


def test_an_endless_wall_fills_half_the_view_of_the_edge():
    far = 1e4
    wall = [(0, -far, 0), (0, far, 0), (0, far, far), (0, -far, far)]
    E = closed_form.lambert_polygon(1.0, wall, (0.01, 0, 0), (0, 0, 1))
    assert E == pytest.approx(np.pi * closed_form.corner_view(np.pi / 2), rel=1e-3)


def test_disc_mean_of_a_quadratic_is_its_centre_plus_r2_over_8_laplacian():
    field = lambda p: 1 + 2 * p[:, 0] + 3 * p[:, 0] ** 2 + p[:, 1] ** 2  # noqa: E731
    assert closed_form.disc_mean(field, (0, 0, 0), (0, 0, 1), 0.3) == pytest.approx(1 + 0.09 / 4 * 4)
    # Mean of x^2 over the disc is r^2 / 4.


def test_disc_mean_and_triangle_mean_agree_with_brute_force():
    field = lambda p: closed_form.point_over_plane(1.0, 0.5, np.hypot(p[:, 0], p[:, 1]))  # noqa: E731
    rng = np.random.default_rng(4)
    r, phi = 0.2 * np.sqrt(rng.random(200000)), 2 * np.pi * rng.random(200000)
    points = np.stack([0.3 + r * np.cos(phi), r * np.sin(phi), 0 * r], axis=1)
    values = field(points)
    sig.z_test(values.mean(), closed_form.disc_mean(field, (0.3, 0, 0), (0, 0, 1), 0.2), values.std() / 447.2)
    corners = np.array([(0, 0, 0), (0.2, 0, 0), (0.1, 0.3, 0)])
    s, t = np.sqrt(rng.random(200000)), rng.random(200000)
    w = np.stack([1 - s, s * (1 - t), s * t], axis=1)
    values = field(w @ corners)
    assert closed_form.triangle_mean(field, corners) == pytest.approx(values.mean(), rel=2e-3)


def test_flux_through_a_plane_under_a_point_light_is_half():
    x = np.linspace(0, 400, 4_000_001)
    E = closed_form.point_over_plane(1.0, 1.0, x)
    assert np.trapezoid(2 * np.pi * x * E, x) == pytest.approx(2 * np.pi, rel=1e-2)

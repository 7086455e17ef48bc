"""The tests' own statistics: their rates of false alarms and of detection are as stated."""

import numpy as np
import pytest

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

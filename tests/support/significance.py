"""Statements about random results: z-tests, chi-square, and how many photons they need.

A test fails at random with probability SIGNIFICANCE at most, over all its numbers together
(Sidak). Seeds are fixed, so a test that passes keeps passing until the code changes.
"""

import math

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri, stdtr

SIGNIFICANCE = 0.01
EFFECT = 0.02  # relative error that must not go unseen
POWER = 0.99
ROUNDING = 1e-6  # relative: float32 positions and fixed-point flux, where a result is not random at all


def sidak(significance: float, tests: int) -> float:
    """Return the level per test that keeps the family-wise level of independent tests (Sidak)."""
    return -math.expm1(math.log1p(-significance) / max(tests, 1))


def p_values(mean, expected, standard_error, degrees: int | None = None) -> np.ndarray:
    """Return two-sided p values; `degrees` of freedom make it Student's t instead of the normal."""
    mean, expected, error = np.broadcast_arrays(*(np.asarray(a, np.float64) for a in (mean, expected, standard_error)))
    error = np.hypot(error, ROUNDING * np.abs(expected))
    off = np.abs(mean - expected)
    z = np.where(off > 0, off / np.where(error > 0, error, 1e-300), 0.0)
    return 2 * (ndtr(-z) if degrees is None else stdtr(degrees, -z))


def z_test(mean, expected, standard_error, what: str = "", degrees: int | None = None, significance=SIGNIFICANCE):
    """Assert that means agree with expected values; the message prints mean, expected value and p.

    All arguments broadcast. A standard error of 0 demands equality to ROUNDING.
    """
    p = p_values(mean, expected, standard_error, degrees).reshape(-1)
    level = sidak(significance, p.size)
    worst = int(np.argmin(p))
    m, e, s = (
        np.broadcast_to(np.asarray(a, np.float64), np.broadcast(mean, expected, standard_error).shape).reshape(-1)
        for a in (mean, expected, standard_error)
    )
    assert p[worst] >= level, (
        f"{what}: mean {m[worst]:.6g} +- {s[worst]:.2g}, expected {e[worst]:.6g} "
        f"({m[worst] / e[worst] - 1 if e[worst] else math.inf:+.2%}), p = {p[worst]:.2g} < {level:.2g} "
        f"(number {worst} of {p.size}; {int((p < level).sum())} fail)"
    )


def seeds_test(samples, expected, what: str = "", significance=SIGNIFICANCE):
    """Assert that the mean over runs of different seeds (seeds, ...) agrees with the expected value.

    The standard error comes from the runs themselves, so correlations inside a run do not matter.
    """
    samples = np.asarray(samples, np.float64)
    n = len(samples)
    error = samples.std(axis=0, ddof=1) / math.sqrt(n)
    z_test(samples.mean(axis=0), expected, error, what, degrees=n - 1, significance=significance)


def sees(standard_error, expected, effect=EFFECT, tests: int = 1, degrees: int | None = None) -> bool:
    """Return whether a test with this standard error detects the effect with probability POWER."""
    level = sidak(SIGNIFICANCE, tests)
    critical = -ndtri(level / 2) if degrees is None else _t_critical(degrees, level)
    return bool(np.all(effect * np.abs(expected) >= (critical + ndtri(POWER)) * np.asarray(standard_error)))


def _t_critical(degrees: int, level: float) -> float:
    low, high = 0.0, 1e4
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if 2 * stdtr(degrees, -middle) > level else (low, middle)
    return high


def photons_for_power(relative_deviation: float, effect=EFFECT, power=POWER, tests: int = 1) -> int:
    """Return how many photons a z-test needs to see a relative error `effect` with probability `power`.

    `relative_deviation` is that of one photon's contribution: its standard deviation over its mean.
    N photons leave sigma / sqrt(N); effect = (z(level / 2) + z(power)) sigma / sqrt(N). A disc that a
    photon crosses with probability p has sigma = sqrt((1 - p) / p).
    """
    z = -ndtri(sidak(SIGNIFICANCE, tests) / 2) + ndtri(power)
    return math.ceil((z * relative_deviation / effect) ** 2)


def crossing_deviation(probability: float) -> float:
    """Return the relative standard deviation of one photon that crosses with this probability."""
    return math.sqrt((1 - probability) / probability)


def chi_square(observed, expected, what: str = "", significance=SIGNIFICANCE, fewest: float = 5.0):
    """Assert that counts come from the expected distribution; cells below `fewest` are pooled."""
    observed, expected = np.asarray(observed, np.float64).reshape(-1), np.asarray(expected, np.float64).reshape(-1)
    assert not observed[expected == 0].any(), f"{what}: counts where none can be"
    small = expected < fewest
    o = np.append(observed[~small], observed[small].sum())
    e = np.append(expected[~small], expected[small].sum())
    o, e = o[e > 0], e[e > 0]
    statistic = float(((o - e) ** 2 / e).sum())
    p = float(chdtrc(len(e) - 1, statistic))
    worst = int(np.argmax(np.abs(o - e) / np.sqrt(e)))
    assert p >= significance, (
        f"{what}: chi-square {statistic:.1f} of {len(e) - 1} degrees, p = {p:.2g} < {significance:.2g}; "
        f"worst cell {worst}: {o[worst]:.0f}, expected {e[worst]:.1f}"
    )

"""What every test file shares: strict numpy, hypothesis profiles, fixtures over the registries."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from gi_core.estimators import ESTIMATORS

settings.register_profile(
    "gi", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)
settings.load_profile("gi")


@pytest.fixture(autouse=True)
def numpy_raises():
    """Overflow, invalid operations and divisions by zero are errors in tests."""
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        yield


@pytest.fixture(params=ESTIMATORS)
def estimator(request) -> str:
    return request.param

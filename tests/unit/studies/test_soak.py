"""The soak's criterion: memory may grow while it warms up, not afterwards."""

import numpy as np
import pytest

from studies.soak import settled

SECONDS = 300.0
TIMES = np.arange(0.0, SECONDS, 5.0)


def test_growth_in_the_warm_up_is_left_out():
    notes = [(s, 400 + min(s, 60.0)) for s in TIMES]
    assert settled(notes, SECONDS) == (460.0, 0.0)


def test_leak_is_detected():
    level, growth = settled([(s, 400 + s) for s in TIMES], SECONDS)
    assert level > 570 and growth == pytest.approx(80, abs=5)
